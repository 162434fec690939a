"""URDF chains against pinocchio, on files made here and on real robots' files."""

import logging
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from jaxik.arm.urdf import load_urdf
from jaxik.errors import ArmClassError, FileFormatError
from tests.helpers.pinocchio_oracle import assert_masses_match, fk_errors
from tests.helpers.urdf_text import arm_urdf, iiwa_urdf, joint, link, robot


@pytest.fixture(scope="module")
def robots() -> Path:
    """Folder with the real robots that the example-robot-data package ships."""
    folders = [Path(p, "cmeel.prefix/share/example-robot-data/robots") for p in sys.path]
    found = [f for f in folders if f.is_dir()]
    if not found:
        pytest.skip("example-robot-data is not installed: pip install example-robot-data")
    return found[0]


@pytest.fixture
def write(tmp_path):
    def _write(text: str) -> Path:
        path = tmp_path / "arm.urdf"
        path.write_text(text, encoding="utf-8")
        return path

    return _write


def rounding_bound(model) -> tuple[float, float]:
    """The bound that the model's note states, in m and rad; zero without a note."""
    for note in model.notes:
        if note.startswith("Rounded to the nearest exact"):
            words = note.split("at most ")[1].split()
            return 1e-3 * float(words[0]), float(np.radians(float(words[3].rstrip("°"))))
    return 0.0, 0.0


REAL_MEMBERS = [
    ("icub_description/robots/icub.urdf", "chest", "l_hand"),
    ("icub_description/robots/icub.urdf", "chest", "r_hand"),
    ("romeo_description/urdf/romeo_small.urdf", "torso", "l_wrist"),
    ("romeo_description/urdf/romeo.urdf", "torso", "r_wrist"),
    ("human_description/robots/human.urdf", "left_clavicle", "left_hand"),
    ("simple_humanoid_description/urdf/simple_humanoid.urdf", "torso", "r_wrist"),
    ("simple_humanoid_description/urdf/simple_humanoid.urdf", "BODY", "l_ankle"),  # a leg, with six joints
]


@pytest.mark.parametrize(("file", "base", "tip"), REAL_MEMBERS)
def test_real_members_match_pinocchio(robots, file, base, tip):
    model = load_urdf(robots / file, base, tip)
    position, rotation = fk_errors(robots / file, base, tip, model)
    position_bound, rotation_bound = rounding_bound(model)
    assert position <= 1e-12 + position_bound
    assert rotation <= 1e-12 + rotation_bound
    assert position_bound < 1e-6


def test_exact_real_members_have_no_rounding_note(robots):
    exact = [m for m in REAL_MEMBERS if "icub" not in m[0]]
    assert not any(any(rounding_bound(load_urdf(robots / file, base, tip))) for file, base, tip in exact)


@pytest.mark.parametrize(
    ("file", "base", "tip", "number"),
    [
        ("baxter_description/urdf/baxter.urdf", "left_arm_mount", "left_hand_link", "pass each other at 69 mm.* 10 mm"),
        ("g1_description/urdf/g1_29dof_rev_1_0.urdf", "torso_link", "left_wrist_yaw_link", "13.831 mm.*46 mm"),
    ],
)
def test_real_arms_outside_the_class_say_by_how_much(robots, file, base, tip, number):
    model = load_urdf(robots / file, base, tip)
    assert model.kinematic_class.startswith("near ")
    assert re.search(number, model.notes[0])


@pytest.mark.parametrize(
    ("file", "base", "tip", "kinematic_class"),
    [
        ("panda_description/urdf/panda.urdf", "panda_link0", "panda_link8", "U-R wrist"),
        ("xarm_description/urdf/xarm7.urdf", "link_base", "link7", "U-R wrist"),
        ("talos_data/robots/talos_reduced.urdf", "torso_2_link", "arm_left_7_link", "R-U shoulder"),
        ("tiago_description/robots/tiago.urdf", "torso_lift_link", "arm_7_link", "R-U shoulder"),
    ],
)
def test_real_arms_with_an_outer_joint_match_pinocchio(robots, file, base, tip, kinematic_class):
    model = load_urdf(robots / file, base, tip)
    position, rotation = fk_errors(robots / file, base, tip, model)
    position_bound, rotation_bound = rounding_bound(model)
    assert model.kinematic_class == kinematic_class
    assert position <= 1e-12 + position_bound < 1e-4
    assert rotation <= 1e-12 + rotation_bound < 1e-4


def test_an_offset_of_one_outer_joint_makes_an_exact_arm_of_another_class(write):
    shoulder = load_urdf(write(arm_urdf(shifts={2: (0.002, 0, 0.1)})), "base", "tip")
    assert shoulder.kinematic_class == "R-U shoulder"
    assert not any(rounding_bound(shoulder))
    assert load_urdf(write(arm_urdf(shifts={7: (0, 0.004, 0)})), "base", "tip").kinematic_class == "U-R wrist"


def test_loading_is_silent_and_needs_no_meshes(robots, write, caplog, capfd):
    caplog.set_level(logging.DEBUG)
    load_urdf(write(arm_urdf()), "base", "tip")
    load_urdf(robots / REAL_MEMBERS[0][0], "chest", "l_hand")
    assert not caplog.records
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("size", [7, 14])
def test_iiwa_matches_pinocchio_and_its_inertias(write, size):
    path = write(iiwa_urdf(size))
    model = load_urdf(path, "link_0", "flange")
    assert max(fk_errors(path, "link_0", "flange", model)) <= 1e-12
    assert rounding_bound(model) == (0.0, 0.0)
    assert_masses_match(path, model)


@pytest.mark.parametrize(("digits", "largest"), [(7, 3e-6), (6, 3e-5), (5, 3e-5)])
def test_printed_digits_are_rounded_away_within_the_noted_bound(write, digits, largest):
    path = write(iiwa_urdf(14, digits=digits))
    model = load_urdf(path, "link_0", "flange")
    position, rotation = fk_errors(path, "link_0", "flange", model)
    position_bound, rotation_bound = rounding_bound(model)
    assert 1e-12 < position <= position_bound < 20 * position + 1e-9
    assert 1e-12 < rotation <= rotation_bound <= largest
    axes = np.asarray(model.arm.axes)
    assert max(abs(axes[i] @ axes[i + 1]) for i in (0, 1, 4, 5)) <= 1e-15


def test_three_digits_are_kept_unless_they_may_be_rounded(write):
    path = write(iiwa_urdf(7, digits=3))
    model = load_urdf(path, "link_0", "flange")
    assert model.kinematic_class == "near U-R wrist"
    assert "off the right angle" in model.notes[0]
    assert rounding_bound(load_urdf(path, "link_0", "flange", tolerance=0.02))[1] > 1e-3


def test_numbers_come_from_the_file(write):
    model = load_urdf(write(arm_urdf(kinds={1: "continuous"})), "base", "tip")
    arm = model.arm
    assert model.joint_names == tuple(f"j{i}" for i in range(1, 8))
    assert model.source == "arm.urdf, base to tip"
    assert np.allclose(arm.upper[1:], 2.0)
    assert arm.upper[0] - arm.lower[0] > 4 * np.pi
    assert np.allclose(arm.velocity_limit, 3.0)
    assert np.allclose(arm.torque_limit, 10.0)
    assert np.allclose(arm.links.mass, 1.0)
    assert np.allclose(arm.links.center_of_mass[:, 2], [0.1, 0.1, 0.1, 0.4, 0.7, 0.7, 0.7])
    assert np.allclose(arm.tool_position, [0, 0, 0.7])


def test_side_branches_are_carried_and_the_base_is_not(write):
    more = link("finger", 2.0, (0, 0, 0), (0.02, 0.02, 0.02)) + joint(
        "jf", "l7", "finger", kind="prismatic", xyz=(0, 0.3, 0), rpy=(0.3, 0, 0)
    )
    plain = load_urdf(write(arm_urdf()), "base", "tip").arm
    path = write(
        arm_urdf(more=more).replace('<link name="base">', '<link name="base"><inertial><mass value="9"/></inertial>')
    )
    arm = load_urdf(path, "base", "tip").arm
    assert np.allclose(arm.links.mass, [1, 1, 1, 1, 1, 1, 3])
    assert np.allclose(arm.links.center_of_mass[6], (plain.links.center_of_mass[6] + 2 * np.array([0, 0.3, 0.6])) / 3)
    # Reduced mass 2/3 at distance hypot(0.3, 0.1) adds to both bodies' own inertia about x.
    assert np.isclose(arm.links.inertia[6][0, 0], 0.03 + 2 / 3 * (0.3**2 + 0.1**2))


def test_gravity_is_turned_into_the_base_link(write):
    text = arm_urdf(more=link("world") + joint("mount", "world", "base", kind="fixed", rpy=(np.pi / 2, 0, 0)))
    assert np.allclose(load_urdf(write(text), "base", "tip").arm.gravity, [0, -9.81, 0])


def test_six_joints(write):
    model = load_urdf(write(arm_urdf("zyzyzy")), "base", "tip")
    assert model.arm.n_joints == 6
    with pytest.raises(ArmClassError, match=r"50 mm off the line through the wrist"):
        load_urdf(write(arm_urdf("zyzyzy").replace('xyz="0 0 0.1', 'xyz="0.05 0 0.1')), "base", "tip")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (arm_urdf("zyzyz"), r"has 5 revolute joints \(j1, j2, j3, j4, j5\)"),
        (arm_urdf("zyzyzyzy"), "has 8 revolute joints"),
        (arm_urdf(kinds={3: "prismatic"}), "joint j3 in the chain is prismatic"),
        (arm_urdf(extra={5: '<mimic joint="j1"/>'}), "joint j5 in the chain mimics j1"),
        (arm_urdf("zzzyzyz"), r"axes 1 \(j1\) and 2 \(j2\) are parallel, where a right angle is needed"),
        (arm_urdf(shifts={2: (0, 0.002, 0), 3: (0, -0.002, 0)}), ""),  # along axis 2 and back: harmless
        (arm_urdf("zyzzzyz"), "the shoulder is 0 mm from axis 4"),
        (arm_urdf(more=joint("again", "base", "l4")), "link l4 closes a loop"),
        (arm_urdf(more=link("z0") + joint("back", "l7", "base")), ""),  # a loop outside the chain does not matter
    ],
)
def test_membership(write, text, message):
    path = write(text)
    if not message:
        assert load_urdf(path, "base", "tip").kinematic_class == "S-R-S"
        return
    with pytest.raises(ArmClassError, match=message):
        load_urdf(path, "base", "tip")


def test_a_chain_of_no_class_is_kept_and_says_what_it_misses(write):
    model = load_urdf(write(arm_urdf(shifts={2: (0.002, 0, 0.1), 7: (0, 0.004, 0)})), "base", "tip")
    assert model.kinematic_class == "near U-R wrist"
    assert re.search(
        r"axes 1 \(j1\) and 2 \(j2\) pass each other at 2 mm.*axes 5 \(j5\) and 7 \(j7\) meet axis 6 \(j6\) in two "
        r"points apart by 4 mm.*; nor an arm with only joint . \(j.\) offset: axes",
        model.notes[0],
    )


def test_unknown_links_are_named_with_what_there_is(write):
    path = write(arm_urdf())
    with pytest.raises(ValueError, match=r"no link tipp \(tip_link\); did you mean tip\? Its links are: base, l1"):
        load_urdf(path, "base", "tipp")
    with pytest.raises(ValueError, match=r"no link floor \(base_link\); Its links are"):
        load_urdf(path, "floor", "tip")
    with pytest.raises(ValueError, match="tip is not above base: going up from the tip ends at base"):
        load_urdf(path, "tip", "base")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (robot(link("base")).replace("</robot>", ""), r"arm\.urdf, line 5: not well-formed XML"),
        ("", r"arm\.urdf, line \d: not well-formed XML"),
        ("<html/>", "line 1: expected <robot>, found <html>"),
        ('<robot name="a" xmlns:xacro="urn:xacro"><xacro:include/></robot>', "this is a xacro file"),
        ("<robot/>", "line 1: the robot has no links; expected <link>"),
        (arm_urdf().replace('lower="-2.0"', 'lower="low"', 1), r'line 5: j1: limit lower="low" should be a number'),
        (
            arm_urdf().replace('xyz="0 0 0.29', 'xyz="0.29', 1),
            r'line 11: j4: origin xyz=".*" should be 3 finite numbers',
        ),
        (arm_urdf().replace('axis xyz="0 0 1"', 'axis xyz="0 0 0"', 1), "line 5: joint j1 has the axis 0 0 0"),
        (arm_urdf().replace('<parent link="base"/>', ""), "line 5: joint j1 has no parent link"),
        (arm_urdf().replace('lower="-2.0" upper="2.0"', "", 1), "joint j1 has an empty range"),
    ],
)
def test_broken_files_name_the_line(write, text, message):
    with pytest.raises(FileFormatError, match=message):
        load_urdf(write(text), "base", "tip")


def test_missing_file(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none\.urdf"):
        load_urdf(tmp_path / "none.urdf", "base", "tip")


def test_impossible_inertia_is_noted(write):
    model = load_urdf(write(arm_urdf().replace('ixx="0.01" ixy="0"', 'ixx="0.01" ixy="0.03"', 1)), "base", "tip")
    assert any("what j1 carries is impossible (principal moment -0.02" in note for note in model.notes)
    assert np.linalg.eigvalsh(np.asarray(model.arm.links.inertia[0])).min() >= -1e-15


def test_it_needs_no_extra(write, monkeypatch):
    for name in ("trimesh", "lxml"):
        monkeypatch.setitem(sys.modules, name, None)
    assert load_urdf(write(arm_urdf()), "base", "tip").arm.n_joints == 7
