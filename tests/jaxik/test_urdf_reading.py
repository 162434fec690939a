"""URDF files as other programs write them: what kinematics does not need never stops the reading."""

import warnings

import numpy as np
import pytest

import jaxik
from jaxik.arm import deviation_of
from jaxik.errors import ArmClassError, FileFormatError, JaxikWarning
from tests.helpers.arms import same_bits
from tests.helpers.pinocchio_oracle import fk_errors
from tests.helpers.urdf_text import arm_urdf, iiwa_urdf, joint, link, robot

SHAPE = '<visual><geometry><mesh filename="package://nowhere/none.stl"/></geometry></visual>'


@pytest.fixture
def write(tmp_path):
    def _write(text: str | bytes):
        path = tmp_path / "arm.urdf"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return _write


def inside(more: str) -> str:
    """The iiwa with more elements in its robot."""
    return iiwa_urdf(7).replace("</robot>", f"{more}</robot>")


HARMLESS = {
    "capsule": iiwa_urdf(7).replace(
        SHAPE, '<collision><geometry><capsule radius="1" length="2"/></geometry></collision>'
    ),
    "unknown shape": iiwa_urdf(7).replace(SHAPE, "<visual><geometry><torus/></geometry></visual>"),
    "empty shape": iiwa_urdf(7).replace(SHAPE, "<visual><geometry/></visual>"),
    "bad numbers of a shape": iiwa_urdf(7).replace(SHAPE, '<visual><geometry><box size="a b"/></geometry></visual>'),
    "undeclared prefix": inside('<gazebo><sensor:camera a:b="1"><x:y/></sensor:camera></gazebo>'),
    "prefix in a link": iiwa_urdf(7).replace(SHAPE, "<sensor:ray/>"),
    "xacro leftovers": inside('<xacro:property name="a" value="1"/><xacro:if value="0"><link name="x"/></xacro:if>'),
    "odd version": iiwa_urdf(7).replace('version="1.0"', 'version="0.0"'),
    "no declaration": iiwa_urdf(7).split("?>", 1)[1],
    "late declaration": "\n  " + iiwa_urdf(7),
    "hyphens in a comment": inside("<!-- a -- b --- c -->"),
    "ampersand": inside('<gazebo a="this & that">&nbsp; & &amp;</gazebo>'),
    "no name": iiwa_urdf(7).replace('<robot name="iiwa7">', "<robot>"),
    "material without color": inside('<material name="red"/><material/>'),
    "transmission": inside('<transmission name="t"><joint name="joint_1"/><joint/></transmission>'),
    "nameless link": inside("<link/>"),
    "bad numbers off the chain": inside(
        link("camera") + joint("c", "link_0", "camera", kind="fixed").replace('rpy="0 0 0"', 'rpy="low"')
    ),
    "axis of a fixed joint": inside(
        link("camera")
        + joint("c", "link_0", "camera", kind="fixed", axis=(0, 0, 0))
        + joint("d", "z", "y", axis=(0, 0, 0))
    ),
    "quoted entities": inside("<![CDATA[ <link> ]]>"),
    "document type": iiwa_urdf(7).replace("<robot", '<!DOCTYPE robot SYSTEM "urdf.dtd"><robot', 1),
}


@pytest.mark.parametrize("case", HARMLESS)
def test_what_kinematics_does_not_need_does_not_matter(write, case):
    expected = jaxik.load_urdf(write(iiwa_urdf(7)), "link_0", "flange")
    found = jaxik.load_urdf(write(HARMLESS[case]), "link_0", "flange")
    assert same_bits(found.arm, expected.arm)
    assert ("xacro" in " ".join(found.notes)) == ("xacro" in case)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-8-sig", "latin-1"])
def test_encodings(write, encoding):
    text = iiwa_urdf(7).replace("<robot", "<!-- año --><robot", 1)
    path = write(text.encode(encoding))
    assert jaxik.load_urdf(path, "link_0", "flange").arm.n_joints == 7
    declared = write(text.replace("?>", ' encoding="ISO-8859-1"?>', 1).replace("joint_1", "brazoñ").encode("latin-1"))
    assert jaxik.load_urdf(declared, "link_0", "flange").joint_names[0] == "brazoñ"


@pytest.mark.parametrize("numbers", ["0, 0 , 0.3", "0,0,0.3", "0,\t0, 0.3,", "  0\n0 3e-1 ", "+0 -0. .3"])
def test_numbers_between_commas(write, numbers):
    text = arm_urdf()
    assert text.count('xyz="0 0 0.29999999999999999"') == 2
    path = write(text.replace('xyz="0 0 0.29999999999999999"', f'xyz="{numbers}"', 1))
    expected = jaxik.load_urdf(write(text), "base", "tip").arm if path is None else None
    found = jaxik.load_urdf(path, "base", "tip").arm
    np.testing.assert_allclose(found.elbow, [0, 0, 0.3], atol=1e-15)
    assert expected is None


@pytest.mark.parametrize(
    "numbers", ["0,5 0,1 0,3", "0,5 1", "0 0", "0 0 nan", "0 0 inf", "0 0 1e12", "", "1_0 0 0", "0;0;1"]
)
def test_ambiguous_or_wrong_numbers_are_refused(write, numbers):
    path = write(arm_urdf().replace('xyz="0 0 0.29999999999999999"', f'xyz="{numbers}"', 1))
    with pytest.raises(FileFormatError, match=r'line 11: j4: origin xyz=".*" should be 3 finite numbers'):
        jaxik.load_urdf(path, "base", "tip")


def test_origins_by_quaternion(write):
    turned = 'rpy="0 0 0"/><axis xyz="0 1 0"/><limit lower="-2.0"'
    half = 0.5**0.5
    text = arm_urdf().replace(turned, f'quat_xyzw="{half} 0 0 {half}"/><axis xyz="0 0 -1"/><limit lower="-2.0"', 1)
    text = text.replace('rpy="0 0 0"/><axis xyz="0 0 1"', f'quat_xyzw="{-half} 0 0 {half}"/><axis xyz="0 0 1"', 2)
    text = text.replace(f'quat_xyzw="{-half} 0 0 {half}"', 'rpy="0 0 0"', 1)
    assert text.count("quat_xyzw") == 2
    found, plain = (jaxik.load_urdf(write(t), "base", "tip").arm for t in (text, arm_urdf()))
    np.testing.assert_allclose(found.axes, plain.axes, atol=1e-15)


def test_pinocchio_reads_the_same(write):
    keys = ("capsule", "undeclared prefix", "xacro leftovers", "late declaration", "material without color")
    for key in keys:
        path = write(HARMLESS[key].lstrip())
        model = jaxik.load_urdf(path, "link_0", "flange")
        assert max(fk_errors(path, "link_0", "flange", model)) <= 1e-12


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (inside(link("link_3", 9.0)), r"line 20: a second link link_3, the first is on line 8; rename or remove one"),
        (inside(joint("joint_2", "flange", "x")), r"line 20: a second joint joint_2, the first is on line 7; rename"),
        (
            iiwa_urdf(7).replace('xyz="0 0 1"', 'xyz="0e0 -0.0 0"', 1),
            r"joint joint_1 has the axis 0e0 -0.0 0, which has",
        ),
        (iiwa_urdf(7).replace('value="2.7"', 'value="-2.7"'), r"link link_4 has a negative mass, -2.7 kg"),
        (iiwa_urdf(7).replace('value="2.7"', 'value="nan"'), r"link link_4: mass value=\"nan\" should be a number"),
        (iiwa_urdf(7).replace('value="2.7"', 'value="inf"'), r"link link_4: mass value=\"inf\" should be a number"),
        (iiwa_urdf(7).replace('ixx="0.08"', 'ixx="x"'), r"link link_3: inertia ixx=\"x\" should be a number"),
        (iiwa_urdf(7).replace('lower="-2', 'lower="nan', 1), r"joint_1: limit lower=\"nan.*\" should be a number"),
        (iiwa_urdf(7).replace('type="revolute"', "", 1), "joint joint_1 in the chain is without a type"),
        (iiwa_urdf(7).replace('name="joint_1"', "", 1), "the joint above link_1, on line 5, has no name"),
        (
            iiwa_urdf(7).replace('rpy="0 0 0"', 'rpy="${pi} 0 0"', 1),
            r"this is a xacro expression, expand the file first",
        ),
        (inside("<a>"), r"line 20: not well-formed XML: mismatched tag"),
        (iiwa_urdf(7)[:-100], r"line 19: not well-formed XML"),
    ],
)
def test_what_would_be_wrong_is_refused_by_name(write, text, message):
    with pytest.raises((FileFormatError, ArmClassError), match=message) as caught:
        jaxik.load_urdf(write(text), "link_0", "flange")
    assert "\n" not in str(caught.value)


def test_a_xacro_file_is_named_where_its_links_are_missing(write):
    text = robot('<link name="base"/><xacro:arm parent="base"/>')
    with pytest.raises(
        ValueError, match=r"no link tip .*xacro elements are left in it: expand it first, xacro arm.urdf"
    ):
        jaxik.load_urdf(write(text), "base", "tip")


def limited(low: float, high: float) -> str:
    return arm_urdf().replace('lower="-2.0" upper="2.0"', f'lower="{low}" upper="{high}"', 1)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (limited(-170, 170), r"arm.urdf: the limits of j1 \(-170 to 170\) look like degrees; URDF has radians"),
        (limited(0, 45), r"the limits of j1 \(0 to 45\) look like degrees"),
        (
            arm_urdf(shifts={4: (0, 0, 300), 5: (0, 0, 300)}),
            r"the origin xyz of j4 \(300 m\), j5 \(300 m\) looks like mil",
        ),
        (arm_urdf().replace('rpy="0 0 0"', 'rpy="360 0 0"', 1), r"the origin rpy of j1 \(360 0 0\) looks like degrees"),
    ],
)
def test_numbers_with_a_wrong_unit_are_taken_with_a_warning(write, text, message):
    with pytest.warns(JaxikWarning, match=message) as caught:
        model = jaxik.load_urdf(write(text), "base", "tip")
    assert model.arm.n_joints == 7
    assert len(caught) == 1


@pytest.mark.parametrize(
    "limit", [(-2 * np.pi, 2 * np.pi), (-12.57, 12.57), (-1e9, 1e9), (-float("inf"), float("inf"))]
)
def test_many_turns_and_none_are_no_degrees(write, limit):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        arm = jaxik.load_urdf(write(limited(*limit)), "base", "tip").arm
    np.testing.assert_allclose(arm.upper[0], min(limit[1], 200 * np.pi))


def test_every_gap_is_named_with_the_tolerance_that_would_do(write):
    path = write(arm_urdf(shifts={2: (0.002, 0, 0.1), 3: (0, 0, 0.003), 7: (0, 0.004, 0)}))
    said = jaxik.load_urdf(path, "base", "tip").notes[0]
    for gap in (
        "(j1) and 2 (j2) pass each other at 2 mm",
        "(j5) and 7 (j7) meet axis 6 (j6) in two points apart by 4 mm",
    ):
        assert gap in said
    tolerance = float(said.split("tolerance=")[1].split()[0])
    assert jaxik.load_urdf(path, "base", "tip", tolerance=tolerance).arm.n_joints == 7
    assert jaxik.load_urdf(path, "base", "tip", tolerance=tolerance).kinematic_class == "S-R-S"
    assert jaxik.load_urdf(path, "base", "tip", tolerance=0.3 * tolerance).kinematic_class.startswith("near ")


def test_a_large_gap_is_no_matter_of_tolerance(write):
    path = write(arm_urdf(shifts={2: (0.1, 0, 0.1), 7: (0, 0.1, 0)}))
    said = jaxik.load_urdf(path, "base", "tip").notes[0]
    assert "pass each other at 100 mm" in said
    assert "tolerance=" not in said


def waist() -> str:
    """The arm on a torso of two joints, with a hand of fixed links and a leg of six joints."""
    more = [link(name) for name in ("pelvis", "chest", "hand", "tcp")]
    more += [joint("waist", "pelvis", "chest"), joint("lean", "chest", "base", axis=(0, 1, 0), xyz=(0.2, 0, 0))]
    more += [joint("h", "tip", "hand", kind="fixed"), joint("t", "hand", "tcp", kind="fixed")]
    parent = "pelvis"
    for i, axis in enumerate([(1, 0, 0), (0, 0, 1), (0, 1, 0), (0, 1, 0), (0, 1, 0), (1, 0, 0)]):
        more += [
            link(f"leg{i}"),
            joint(f"r{i}", parent, f"leg{i}", axis=axis, xyz=(0, 0.05 * (i == 0), -0.4 * (i > 2))),
        ]
        parent = f"leg{i}"
    return arm_urdf(more="".join(more))


def test_the_arms_in_a_file_are_listed(write):
    arm, leg = jaxik.list_arms(write(waist()))
    assert arm.ok
    assert (arm.base_link, arm.tip_link) == ("base", "tcp")
    assert arm.joint_names == tuple(f"j{i}" for i in range(1, 8))
    assert jaxik.load_urdf(write(waist()), arm.base_link, arm.tip_link).arm.n_joints == 7
    assert not leg.ok
    assert (leg.base_link, leg.tip_link, len(leg.joint_names)) == ("pelvis", "leg5", 6)
    assert leg.problem.startswith("not an S-R-S arm: ")


def humanoid() -> str:
    """A waist of three joints and an arm of seven, neither of which is in a class."""
    turns = [("waist_yaw", (0, 0, 1)), ("waist_roll", (1, 0, 0)), ("waist_pitch", (0, 1, 0))]
    turns += [(f"shoulder_{x}", axis) for x, axis in zip("pry", ((0, 0.96, 0.28), (1, 0, 0), (0, 0, 1)), strict=True)]
    turns += [("elbow", (0, 1, 0)), ("wrist_roll", (1, 0, 0)), ("wrist_pitch", (0, 1, 0)), ("wrist_yaw", (0, 0, 1))]
    shifts = [(0, 0, 0), (0, 0.0005, 0.044), (0, 0, 0), (0, 0.1, 0.25), (0, 0.01, 0), (0, 0, -0.1), (0.016, 0, -0.08)]
    shifts += [(0.1, 0.002, -0.01), (0.038, 0, 0.005), (0.046, 0, 0)]
    parts, parent = [link("pelvis")], "pelvis"
    for (name, axis), shift in zip(turns, shifts, strict=True):
        parts += [link(name), joint(f"{name}_joint", parent, name, axis=axis, xyz=shift)]
        parent = name
    parts += [link("rubber_hand"), joint("to_hand", parent, "rubber_hand", kind="fixed", xyz=(0.04, 0, 0))]
    return robot(*parts)


def test_the_chain_to_the_hand_goes_before_that_through_the_waist(write):
    through_waist = jaxik.load_urdf(write(humanoid()), "pelvis", "elbow").arm
    (arm,) = jaxik.list_arms(write(humanoid()))
    assert (arm.base_link, arm.tip_link) == ("waist_pitch", "rubber_hand")
    assert deviation_of(through_waist).position < arm.deviation  # what it was chosen by before


def test_a_six_joint_arm_is_listed_with_a_tip_that_makes_it_one(write):
    text = arm_urdf("zyzyzy", more=link("tool") + joint("s", "l6", "tool", kind="fixed", xyz=(0.1, 0, 0.1)))
    (arm,) = jaxik.list_arms(write(text))
    assert arm.ok
    assert arm.tip_link == "tip"
    assert jaxik.load_urdf(write(text), arm.base_link, arm.tip_link).arm.n_joints == 6


@pytest.mark.parametrize(
    ("base", "tip", "message"),
    [
        ("pelvis", "tcp", r"has 9 revolute joints .*; from base to tcp there is an arm of 7 joints"),
        ("chest", "l6", r"; from base to tcp there is an arm of 7 joints"),
        ("base", "l4", r"has 4 revolute joints .*; from base to tcp there is an arm of 7 joints"),
        ("tcp", "base", r"base and tip are swapped: the base is base, the tip tcp"),
        ("pelvis", "leg5", r"; `jaxik info arm.urdf` lists the arms in the file"),
    ],
)
def test_waist_joints_and_swapped_ends_are_told(write, base, tip, message):
    with pytest.raises(ValueError, match=message):
        jaxik.load_urdf(write(waist()), base, tip)


@pytest.mark.parametrize(
    "more", [joint("back", "l7", "base"), joint("self", "l3", "l3"), joint("x", "a", "b") + joint("y", "b", "a")]
)
def test_loops_end_the_listing_too(write, more):
    jaxik.list_arms(write(arm_urdf(more=more)))
