"""Presets: kinematics against pinocchio or by hand, limits, keep-outs and references where the notes say they are."""

import json

import numpy as np
import pytest

from jaxik import Pointing, joint_positions, solve_ik
from jaxik.arm import presets
from tests.helpers.arms import ALL_PRESETS, random_angles, reference_fk
from tests.helpers.pinocchio_oracle import assert_masses_match, fk_errors
from tests.helpers.urdf_text import LIMITS_DEG, iiwa_urdf

PAPER_Q_DEG = (9.73561032, 120.0, 70.52877937, 60.0, 51.58933962, 31.39971481)


@pytest.mark.parametrize("name", ALL_PRESETS)
def test_every_preset_says_what_it_is(name):
    model = ALL_PRESETS[name]()
    arm = model.arm
    assert model.name == name
    assert model.source
    assert model.notes
    assert len(model.joint_names) == len(set(model.joint_names)) == arm.n_joints
    assert json.dumps(model.notes)
    zero = np.zeros(arm.n_joints)
    assert np.all(arm.lower <= zero)
    assert np.all(zero <= arm.upper)
    assert np.all(np.asarray(arm.upper - arm.lower) < 2 * np.pi)


@pytest.mark.parametrize("name", ALL_PRESETS)
def test_elbow_can_satisfy_and_violate_the_keep_out(name):
    arm = ALL_PRESETS[name]().arm
    q = random_angles(arm, np.random.default_rng(0), 500)
    elbows = np.stack([elbow_of(arm, row) for row in q])
    inside = np.all(elbows @ np.asarray(arm.keep_out.normal).T <= np.asarray(arm.keep_out.offset), axis=1)
    assert inside.any()
    assert inside.all() == (len(arm.keep_out.offset) == 0)


def elbow_of(arm, q):
    """Elbow point: the tool point of an arm whose tool is the elbow, wrist angles ignored."""
    at_elbow = type(arm)(**{**vars(arm), "tool_position": arm.elbow})
    return reference_fk(at_elbow, np.where(np.arange(len(q)) < 3, q, 0.0))[0][0]


def test_paper_arm_reads_off_the_worked_example():
    arm = presets.paper_arm().arm
    q = np.radians(PAPER_Q_DEG)
    position, rotation = reference_fk(arm, q)
    assert np.allclose(position[0], (3, 4, -3), atol=1e-8)
    assert np.allclose(rotation[0][:, 2], (0, 1, 0), atol=1e-8)
    assert np.allclose(elbow_of(arm, q), (2.560660171779821, 0.4393398282201787, -1.5), atol=1e-8)
    assert np.all(arm.lower < q)
    assert np.all(q < arm.upper)
    assert np.all(arm.upper - arm.lower <= np.pi + 1e-12)


def circle(wrist, t):
    """Elbow of the paper's arm from its eqs. (20)-(37)."""
    n = wrist / np.linalg.norm(wrist)
    a1 = np.array([-n[1], n[0], 0]) / np.hypot(n[0], n[1])
    b1 = np.cross(a1, n)
    radius = np.sqrt(9 - wrist @ wrist / 4)
    return wrist / 2 + radius * (np.cos(t)[:, None] * a1 + np.sin(t)[:, None] * b1)


@pytest.mark.parametrize("wrist", [(3, 3, -3), (2, 2, 1), (0.5, 0.5, -4)])
def test_paper_keep_out_is_the_arc_of_figure_18(wrist):
    keep_out = presets.paper_arm().arm.keep_out
    t = np.linspace(0, 2 * np.pi, 721)[:-1] + 1e-3
    allowed = circle(np.array(wrist, float), t) @ np.asarray(keep_out.normal[0]) <= keep_out.offset[0]
    assert np.array_equal(allowed, (t >= np.pi / 2) & (t <= 3 * np.pi / 2))


def test_paper_arc_is_the_range_of_upper_arm_roll():
    arm = presets.paper_arm().arm
    q = random_angles(arm, np.random.default_rng(3), 50)
    for row in q:  # the joint ranges put the elbow on the arc's side, wherever the wrist is
        elbow = elbow_of(arm, row)
        wrist_arm = type(arm)(**{**vars(arm), "tool_position": arm.wrist})
        w = reference_fk(wrist_arm, row)[0][0]
        assert (elbow - w / 2) @ (-w[1], w[0], 0) <= 1e-12
    assert np.allclose(arm.lower[2], 0)
    assert np.allclose(arm.upper[2], np.pi)


def test_paper_example_has_a_solution_at_every_swivel_of_its_arc():
    t = np.linspace(np.pi / 2, 3 * np.pi / 2, 181)[1:-1]
    arm = presets.paper_arm().arm
    solved = solve_ik(arm, Pointing(np.array([3.0, 4.0, -3.0]), np.array([0.0, 1.0, 0.0])), t)
    assert np.all(np.any(solved.status == 0, axis=-1))


def test_paper_reference_on_its_singular_line_is_the_limit_from_the_worked_plane():
    reference = presets.paper_arm().arm.reference
    near = np.array([1e-9, 1e-9, -4])
    r = np.cross(reference.axis, near)
    assert np.allclose(r / np.linalg.norm(r), reference.fallback, atol=1e-12)


@pytest.mark.parametrize("size", [7, 14])
def test_iiwa_matches_pinocchio_and_its_inertias(tmp_path, size):
    path = tmp_path / "iiwa.urdf"
    path.write_text(iiwa_urdf(size))
    model = presets.iiwa7() if size == 7 else presets.iiwa14()
    assert max(fk_errors(path, "link_0", "flange", model)) <= 1e-12
    assert_masses_match(path, model)
    assert np.allclose(model.arm.upper, np.radians(LIMITS_DEG))


@pytest.mark.parametrize(("build", "upper", "fore"), [(presets.iiwa7, 0.4, 0.4), (presets.iiwa14, 0.42, 0.4)])
def test_iiwa_lengths(build, upper, fore):
    arm = build().arm
    assert np.isclose(np.linalg.norm(arm.elbow - arm.shoulder), upper, atol=1e-15)
    assert np.isclose(np.linalg.norm(arm.wrist - arm.elbow), fore, atol=1e-15)
    assert np.isclose(np.linalg.norm(arm.tool_position - arm.wrist), 0.126, atol=1e-15)


@pytest.mark.parametrize("side", ["left", "right"])
def test_meccanoid_moves_as_its_docstring_says(side):
    model = presets.meccanoid(side)
    arm, out = model.arm, 1.0 if side == "left" else -1.0
    cases = {
        (0, 0, 0, 0, 0, 0): (0, 0, -0.42),  # hanging down
        (90, 0, 0, 0, 0, 0): (0.42, 0, 0),  # swing: forward
        (0, 90, 0, 0, 0, 0): (0, out * 0.42, 0),  # lift: outward
        (0, 0, 90, 90, 0, 0): (0, out * 0.25, -0.17),  # roll: the flexed forearm goes outward
        (0, 0, 0, 90, 0, 0): (0.25, 0, -0.17),  # flexion: forward
        (0, 0, 0, 0, 90, 90): (0, out * 0.10, -0.32),  # wrist roll likewise
        (0, 0, 0, 0, 0, 90): (0.10, 0, -0.32),
    }
    for q, expected in cases.items():
        assert np.allclose(reference_fk(arm, np.radians(q))[0][0], expected, atol=1e-15)
    assert all(name.startswith(side) for name in (*model.joint_names, model.gripper.name))


def test_meccanoid_sides_are_mirror_images():
    left, right = presets.meccanoid("left").arm, presets.meccanoid("right").arm
    mirror = np.diag([1.0, -1.0, 1.0])
    q = random_angles(left, np.random.default_rng(1), 20)
    (p_left, r_left), (p_right, r_right) = reference_fk(left, q), reference_fk(right, q)
    assert np.allclose(p_left, p_right @ mirror, atol=1e-15)
    assert np.allclose(r_left, mirror @ r_right @ mirror, atol=1e-15)
    assert np.allclose(left.keep_out.normal, right.keep_out.normal @ mirror)
    for a, b in zip(left.reference.vectors(), right.reference.vectors(), strict=True):
        assert np.allclose(a, b @ mirror, atol=1e-16)


@pytest.mark.parametrize("side", ["left", "right"])
def test_meccanoid_swivel_zero_is_where_the_note_says(side):
    reference = presets.meccanoid(side).arm.reference
    out = 1.0 if side == "left" else -1.0
    pole, zero = np.asarray(reference.pole), np.asarray(reference.zero)
    for n, expected in (((1, 0, 0), (0, 0.8 * out, -0.6)), ((0, 0, -1), (-0.936, -0.352 * out, 0))):
        m = np.array(n) - pole
        assert np.allclose(zero - 2 * m * (m @ zero) / (m @ m), expected, atol=1e-12)


@pytest.mark.parametrize("side", ["left", "right"])
def test_meccanoid_rest_pose_is_allowed(side):
    arm = presets.meccanoid(side).arm
    rest = np.zeros(6)
    assert np.all((arm.lower <= rest) & (rest <= arm.upper))
    assert np.all(arm.keep_out.normal @ arm.elbow < arm.keep_out.offset)
    assert np.all(arm.upper - arm.lower <= np.pi + 1e-12)


@pytest.mark.parametrize("side", ["left", "right"])
def test_meccanoid_elbow_may_go_outward_and_not_into_the_body(side):
    arm = presets.meccanoid(side).arm
    for lift_deg, allowed in ((90, True), (0, True), (-5, True), (-15, False)):
        elbow = elbow_of(arm, np.radians([0, lift_deg, 0, 0, 0, 0]))
        assert bool(np.all(arm.keep_out.normal @ elbow <= arm.keep_out.offset)) == allowed


@pytest.mark.parametrize("side", ["left", "right"])
def test_meccanoid_wrist_stays_clear_of_the_singular_half_line(side):
    arm = presets.meccanoid(side).arm
    q = np.random.default_rng(2).uniform(arm.lower, arm.upper, (20_000, 6))
    points = np.asarray(joint_positions(arm, q))
    allowed = np.all(points[:, 1] @ np.asarray(arm.keep_out.normal).T <= np.asarray(arm.keep_out.offset), axis=1)
    reach = points[allowed, 2]
    angle = np.arccos(reach @ np.asarray(arm.reference.pole) / np.linalg.norm(reach, axis=1))
    assert np.degrees(angle.min()) > 20


def test_iiwa_reference_is_singular_only_inside_its_base():
    arm = presets.iiwa14().arm
    assert np.allclose(arm.reference.pole, (0, 0, -1))


def test_meccanoid_sides_are_two(without_type_checks):
    with pytest.raises(ValueError, match='side must be "left" or "right", got \'both\''):
        presets.meccanoid("both")
