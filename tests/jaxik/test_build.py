"""make_arm: what it accepts, what it rounds, and what each refusal says."""

import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxik.arm.arm import HalfSpaces, LinkInertia, Motors
from jaxik.arm.builder import CONTINUOUS, UNLIMITED, floats, make_arm
from jaxik.arm.swivel_reference import PaperReference, StereographicReference
from jaxik.errors import ArmClassError
from jaxik.kinematics.forward import forward_kinematics
from tests.helpers.arms import random_angles, random_arm, reference_fk, rotation_about, same_bits

X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
SEVEN = {
    "axes": [Z, Y, Z, Y, Z, Y, Z],
    "shoulder": (0, 0, 0),
    "elbow": (0, 0, 0.3),
    "wrist": (0, 0, 0.6),
    "tool_position": (0, 0, 0.7),
}
SIX = {**SEVEN, "axes": [Z, Y, Z, Y, Z, Y]}


def turned(axis, about, degrees):
    return tuple(rotation_about(np.array(about), np.radians(degrees)) @ np.array(axis))


def with_axis(base, number, axis):
    return {**base, "axes": [*base["axes"][: number - 1], axis, *base["axes"][number:]]}


def test_defaults():
    arm = make_arm(**SEVEN)
    assert arm.n_joints == 7
    assert arm.axes.dtype == jnp.float64
    assert np.all(arm.upper == CONTINUOUS)
    assert np.all(arm.lower == -CONTINUOUS)
    assert np.all(arm.velocity_limit == UNLIMITED)
    assert np.all(arm.torque_limit == UNLIMITED)
    assert np.all(arm.links.mass == 0)
    assert arm.links.inertia.shape == (7, 3, 3)
    assert np.all(arm.motors.resistance == 1)
    assert arm.keep_out.normal.shape == (0, 3)
    assert np.allclose(arm.gravity, (0, 0, -9.81))
    assert np.array_equal(arm.tool_rotation, np.eye(3))


def test_default_reference_opposes_the_zero_posture_and_counts_from_a_flexed_elbow():
    reference = make_arm(**SEVEN).reference
    assert isinstance(reference, StereographicReference)
    assert np.allclose(reference.pole, (0, 0, -1))
    # Joint 4 about +y moves the wrist to +x, so the elbow lies on the -x side of the line to the wrist.
    assert np.allclose(reference.zero, (-1, 0, 0))


def test_default_reference_is_a_pair_for_every_arm():
    for seed in range(30):
        arm = random_arm(seed)
        rebuilt = make_arm(arm.axes, arm.shoulder, arm.elbow, arm.wrist, arm.tool_position, arm.tool_rotation)
        pole, zero = (np.asarray(v) for v in rebuilt.reference.vectors())
        assert np.allclose([pole @ pole, zero @ zero, pole @ zero], [1, 1, 0], atol=1e-14)


def test_six_joint_default_tool_points_from_wrist_to_tool():
    arm = make_arm(**{**SIX, "axes": [Z, Y, Z, Y, Z, X], "tool_position": (0, -0.1, 0.6)})
    assert np.allclose(arm.tool_rotation[:, 2], (0, -1, 0))
    assert np.allclose(arm.tool_rotation[:, 1], X)
    assert np.isclose(np.linalg.det(arm.tool_rotation), 1)


def test_elbow_is_the_point_of_axis_4_nearest_to_the_shoulder():
    arm = make_arm(**{**SEVEN, "elbow": (0.05, 7.0, 0.3)})
    assert np.allclose(arm.elbow, (0.05, 0, 0.3), atol=1e-15)
    same = make_arm(**{**SEVEN, "elbow": (0.05, 0, 0.3)})
    q = np.linspace(-1, 1, 7)
    assert np.allclose(forward_kinematics(arm, q).position, forward_kinematics(same, q).position, atol=1e-14)


@given(seed=st.integers(0, 10**6), six=st.booleans(), offset=st.booleans(), skew=st.booleans())
def test_members_come_back_unchanged(seed, six, offset, skew):
    arm = random_arm(seed, 6 if six else 7, offset=offset, skew=skew)
    again = make_arm(
        arm.axes,
        arm.shoulder,
        arm.elbow,
        arm.wrist,
        arm.tool_position,
        arm.tool_rotation,
        lower=arm.lower,
        upper=arm.upper,
        velocity_limit=arm.velocity_limit,
        torque_limit=arm.torque_limit,
        links=arm.links,
        motors=arm.motors,
        gravity=arm.gravity,
        keep_out=arm.keep_out,
        reference=arm.reference,
    )
    for a, b in zip(jax.tree.leaves(arm), jax.tree.leaves(again), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-15 * CONTINUOUS)


def test_random_arms_forward_kinematics_agree_with_the_library():
    for seed in range(20):
        arm = random_arm(seed, 6 + seed % 2, limits=bool(seed % 3))
        q = random_angles(arm, np.random.default_rng(seed), 4)
        position, rotation = reference_fk(arm, q)
        pose = forward_kinematics(arm, q)
        assert np.allclose(pose.position, position, atol=1e-13)
        assert np.allclose(pose.rotation, rotation, atol=1e-13)


def test_rounding_is_repaired_within_the_tolerance_and_refused_beyond():
    slightly = with_axis(SEVEN, 3, turned(Z, X, 5e-5))
    axes = np.asarray(make_arm(**slightly, tolerance=1e-6).axes)
    assert abs(axes[1] @ axes[2]) < 1e-16
    with pytest.raises(ArmClassError, match=r"axes 2 and 3 are 5e-05° off"):
        make_arm(**slightly)
    axes = np.asarray(make_arm(**with_axis(SEVEN, 1, (1e-7, 0, 1.0000005))).axes)
    assert np.allclose(np.linalg.norm(axes, axis=1), 1, atol=1e-16)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (with_axis(SEVEN, 1, turned(Z, X, 2)), r"axes 1 and 2 are 2° off the right angle \(tolerance 5.72958e-08°\)"),
        (with_axis(SEVEN, 3, turned(Z, X, -2)), "axes 2 and 3 are 2° off"),
        (with_axis(SEVEN, 5, turned(Z, X, 0.5)), "axes 5 and 6 are 0.5° off"),
        (with_axis(SEVEN, 7, Y), "axes 6 and 7 are parallel, where a right angle is needed"),
        (
            with_axis(with_axis(SEVEN, 1, Y), 7, Y),
            "axes 1 and 2 are parallel.*; axes 6 and 7 are parallel, where a right angle is needed",
        ),
        (with_axis(SEVEN, 4, (0, 1.001, 0)), r"axis 4 has length 1\.001 instead of 1"),
        (with_axis(SEVEN, 4, Z), r"the shoulder is 0 mm from axis 4 \(needs more than 0\.0007 mm\)"),
        ({**SEVEN, "elbow": (0, 0, 0.6)}, "the wrist is 0 mm from axis 4"),
        ({**SEVEN, "axes": SEVEN["axes"][:5]}, "the arm has 5 joint axes"),
        ({**SEVEN, "axes": [*SEVEN["axes"], Y]}, "the arm has 8 joint axes"),
        ({**SEVEN, "tool_rotation": -np.eye(3)}, "no rotation matrix: .* determinant is -1"),
        ({**SEVEN, "tool_rotation": np.diag([1, 1, 1.1])}, "columns miss orthonormality by 0.21"),
        ({**SIX, "tool_position": (0.02, 0, 0.7), "tool_rotation": np.eye(3)}, "the tool point is 20 mm off the line"),
        (
            {**SIX, "tool_rotation": rotation_about(np.array(X), np.radians(3))},
            r"axis 6 and the tool's z axis are 3° off the right angle.*; the tool point is 5\.2336 mm off the line",
        ),
    ],
)
def test_class_conditions(changed, message):
    with pytest.raises(ArmClassError, match=message):
        make_arm(**changed)


@pytest.mark.parametrize(
    "free",
    [
        with_axis(with_axis(SEVEN, 3, X), 7, X),  # outer axes across each other
        with_axis(SEVEN, 4, turned(Y, Z, 77)),  # elbow axis across neither link's plane
        {**SEVEN, "elbow": (0.07, 0, 0.25), "wrist": (-0.03, 0.08, 0.6)},  # offsets from both links
        {**SEVEN, "tool_position": (0.3, 0.2, 0.1)},  # any tool, with seven joints
        {**SEVEN, "tool_position": (0, 0, 0.6)},  # none at all
    ],
)
def test_the_class_is_general(free):
    assert make_arm(**free).n_joints == 7


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"lower": [0] * 6}, r"lower must be a number or one per joint, shape \(7,\), got shape \(6,\)"),
        ({"lower": 1.0, "upper": 1.0}, "joint 1 has an empty range: lower 1 is not below upper 1 rad"),
        ({"lower": -np.inf, "upper": 1.0}, r"joint 1 has limits \[-inf, 1.0\]: give two numbers, or -inf and inf"),
        ({"lower": np.nan, "upper": 1.0}, "joint 1 has limits"),
        ({"velocity_limit": 0.0}, "velocity_limit must be positive"),
        ({"torque_limit": -1.0}, "torque_limit must be positive"),
        ({"gravity": (0, 0)}, r"gravity must have shape \(3,\), got \(2,\)"),
        ({"gravity": (0, 0, np.inf)}, "gravity must be finite"),
        ({"shoulder": "here"}, r"shoulder must be numbers of shape \(3,\), got 'here'"),
    ],
)
def test_bad_numbers(keywords, message, without_type_checks):
    with pytest.raises(ValueError, match=message):
        make_arm(**{**SEVEN, **keywords})


@pytest.mark.parametrize(
    ("mass", "inertia", "message"),
    [
        (-1.0, np.eye(3), "links.mass must not be negative"),
        (1.0, -np.eye(3), "links.inertia of link 1 is not symmetric with eigenvalues >= 0"),
        (1.0, np.triu(np.ones((3, 3))), "links.inertia of link 1 is not symmetric"),
    ],
)
def test_impossible_masses(mass, inertia, message):
    links = LinkInertia(floats(np.full(7, mass)), floats(np.zeros((7, 3))), floats(np.tile(inertia, (7, 1, 1))))
    with pytest.raises(ValueError, match=message):
        make_arm(**SEVEN, links=links)


def test_motors_must_be_positive():
    with pytest.raises(ValueError, match=r"motors\.torque_constant must be positive"):
        make_arm(**SEVEN, motors=Motors(floats(np.ones(7)), floats(np.zeros(7))))


def test_keep_out_and_reference_are_made_exact():
    almost = np.array([[0.6, 0.8000001, 0.0]])
    arm = make_arm(
        **SEVEN,
        keep_out=HalfSpaces(floats(almost), floats([0.1])),
        reference=PaperReference(floats((0, 0, 1.0000002)), floats((1, 0, 1e-7))),
    )
    assert np.isclose(np.linalg.norm(arm.keep_out.normal), 1, atol=1e-15)
    assert float(arm.reference.axis @ arm.reference.fallback) == 0
    with pytest.raises(ValueError, match=r"keep_out\.normal 1 has length 0\.5"):
        make_arm(**SEVEN, keep_out=HalfSpaces(floats([[0.5, 0, 0]]), floats([0.1])))
    with pytest.raises(ValueError, match=r"reference\.zero must be perpendicular to \.pole: their product is 0\.6"):
        make_arm(**SEVEN, reference=StereographicReference(floats(Z), floats((0.8, 0, 0.6))))


def test_unlimited_joints_may_be_mixed_with_limited_ones():
    arm = make_arm(**SEVEN, lower=[-np.inf, *[-1.0] * 6], upper=[np.inf, *[1.0] * 6])
    assert arm.upper[0] - arm.lower[0] > 2 * np.pi
    assert np.all(np.isfinite(arm.lower))
    assert np.all(arm.upper[1:] == 1)


def test_arms_pass_through_jit():
    arm = make_arm(**SEVEN)
    assert same_bits(jax.jit(lambda a: a)(arm), arm)


def test_without_x64_arms_are_float32_and_nothing_warns():
    code = (
        "import jax, numpy as np\n"
        "from jaxik import presets\n"
        "from jaxik import make_arm\n"
        "for model in (presets.paper_arm(), presets.meccanoid('left'), presets.iiwa7(), presets.iiwa14()):\n"
        "    assert {x.dtype.name for x in jax.tree.leaves(model.arm)} == {'float32'}\n"
        "    a = model.arm\n"
        "    make_arm(a.axes, a.shoulder, a.elbow, a.wrist, a.tool_position, a.tool_rotation, tolerance=1e-6,\n"
        "             links=a.links, motors=a.motors, keep_out=a.keep_out, reference=a.reference)\n"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True, timeout=300)


def test_arms_with_different_references_never_share_a_program():
    """JAX takes dataclasses of equal field counts for one structure, whatever their class."""
    paper, stereographic = (jax.tree.structure(random_arm(0, reference=r)) for r in ("paper", "stereographic"))
    assert paper != stereographic
