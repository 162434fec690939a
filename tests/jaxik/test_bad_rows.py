"""A bad row gets a status and a finite placeholder, and no other row notices: neither values nor gradients."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxik import Pointing, Pose, Status, UnreachableError, nearest_rotation, solve_ik
from jaxik.arm import presets
from tests.helpers.arms import random_arm, same_bits
from tests.helpers.postures import SAMPLE_ARMS, free, orientation_of, posed, quick, value_and_gradients

ROWS, BAD = 16, 5
# The first two are singular at zero angles, where bad rows are put.
ARMS = quick("iiwa14", "paper_arm", slow=["general_7"])

NONFINITE, INVALID, FAR = Status.NONFINITE_INPUT, Status.INVALID_TARGET, Status.OUT_OF_REACH
ANY = None

# What to write into (position, orientation, swivel) of the bad row, and the status to expect for a Pose and a Pointing.
CASES = {
    "nan position": (lambda p, o, s: (p.at[1].set(jnp.nan), o, s), NONFINITE, NONFINITE),
    "inf position": (lambda p, o, s: (p.at[0].set(jnp.inf), o, s), NONFINITE, NONFINITE),
    "all nan": (lambda p, o, s: (p * jnp.nan, o * jnp.nan, s * jnp.nan), NONFINITE, NONFINITE),
    "nan orientation": (lambda p, o, s: (p, o.at[0].set(jnp.nan), s), NONFINITE, NONFINITE),
    "inf orientation": (lambda p, o, s: (p, o.at[2].set(-jnp.inf), s), NONFINITE, NONFINITE),
    "nan swivel": (lambda p, o, s: (p, o, s * jnp.nan), NONFINITE, NONFINITE),
    "inf swivel": (lambda p, o, s: (p, o, s + jnp.inf), NONFINITE, NONFINITE),
    "huge swivel": (lambda p, o, s: (p, o, s + 1e18), INVALID, INVALID),
    "zero orientation": (lambda p, o, s: (p, o * 0, s), INVALID, INVALID),
    "denormal orientation": (lambda p, o, s: (p, o * 1e-310, s), INVALID, INVALID),
    "scaled orientation": (lambda p, o, s: (p, o * 1.1, s), INVALID, ANY),
    "huge orientation": (lambda p, o, s: (p, o * 1e300, s), INVALID, ANY),
    "tiny orientation": (lambda p, o, s: (p, o * 1e-300, s), INVALID, ANY),
    "reflected orientation": (lambda p, o, s: (p, -o, s), INVALID, ANY),
    "far": (lambda p, o, s: (p + 100, o, s), FAR, FAR),
    "very far": (lambda p, o, s: (p + 1e300, o, s), FAR, FAR),
    "as far as it goes": (lambda p, o, s: (p * 0 - 1.7e308, o, s), FAR, FAR),
    "tiny position": (lambda p, o, s: (p * 0 + 1e-300, o, s), ANY, ANY),
}


def batch(name):
    arm = SAMPLE_ARMS[name]()
    rng = np.random.default_rng(0)
    target, swivel = posed(arm, jnp.asarray(rng.uniform(-2, 2, (ROWS, arm.n_joints))))
    weights = jnp.asarray(rng.normal(size=(ROWS, 8, arm.n_joints)))
    return arm, target.position, jnp.asarray(orientation_of(target)), swivel, weights


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("case", CASES)
def test_a_bad_row_harms_no_other(case, name):
    spoil, status_pose, status_pointing = CASES[case]
    arm, *inputs, weights = batch(name)
    status = status_pose if arm.n_joints == 7 else status_pointing
    spoilt = [x.at[BAD].set(y) for x, y in zip(inputs, spoil(*(x[BAD] for x in inputs)), strict=True)]
    good, _, good_gradients = value_and_gradients(arm, *inputs, weights)
    bad, bad_arm, bad_gradients = value_and_gradients(arm, *spoilt, weights)
    others = np.arange(ROWS) != BAD
    pick = jax.tree.map(lambda x: x[others], (good, good_gradients))
    assert same_bits(pick, jax.tree.map(lambda x: x[others], (bad, bad_gradients)))
    for leaf in jax.tree.leaves((bad, bad_arm, bad_gradients)):
        assert np.isfinite(leaf).all()
    if status is ANY:
        assert (bad.status[BAD] <= FAR).all()
    else:
        assert (bad.status[BAD] == status).all()
    if status in (NONFINITE, INVALID):
        assert all((g[BAD] == 0).all() for g in bad_gradients)
        silent = value_and_gradients(arm, *inputs, weights.at[BAD].set(0.0))[1]
        assert same_bits(bad_arm, silent)  # the placeholder's own dependence on the arm is no gradient of anything


@pytest.mark.parametrize("name", quick("iiwa14", slow=["paper_arm"]))
def test_leaving_the_bad_rows_out_changes_no_other_row(name):
    """The same bits, but for the last one of some gradients: another batch size is another compiled program."""
    arm, *inputs, weights = batch(name)
    every_third = np.arange(ROWS) % 3 == 0
    spoilt = [x.at[every_third].set(jnp.nan) for x in inputs]
    with_bad, _, gradients = value_and_gradients(arm, *spoilt, weights)
    without, _, fewer = value_and_gradients(arm, *(x[~every_third] for x in inputs), weights[~every_third])
    assert same_bits(jax.tree.map(lambda x: x[~every_third], with_bad), without)
    for gradient, one in zip(jax.tree.map(lambda x: x[~every_third], gradients), fewer, strict=True):
        np.testing.assert_allclose(gradient, one, rtol=0, atol=1e-14 * float(jnp.abs(one).max()))
    assert (with_bad.status[every_third] == NONFINITE).all()


@pytest.mark.slow
def test_residuals_of_bad_rows_are_finite_and_plainly_bad():
    arm, position, orientation, swivel, _ = batch("iiwa14")
    spoilt = Pose(position.at[0].set(jnp.nan).at[1, 0].set(jnp.inf), orientation.at[2].set(jnp.nan))
    residual = solve_ik(arm, spoilt, swivel).residual
    assert (residual.position[:2] > 1e70).all()
    np.testing.assert_allclose(residual.rotation[2], np.pi)

    @jax.jit
    @jax.grad
    def gradients(inputs):
        residual = solve_ik(inputs[0], Pose(*inputs[1:]), swivel).residual
        return jnp.sum(jnp.where(jnp.arange(ROWS)[:, None] > 2, residual.position + residual.rotation, 0.0))

    for leaf in jax.tree.leaves(gradients((arm, spoilt.position, spoilt.rotation))):
        assert np.isfinite(leaf).all()


@pytest.mark.parametrize("size", [1e-300, 1e-20, 1.0, 1e20, 1e300])
def test_a_direction_of_any_length_points_the_same_way(size):
    arm = free(presets.paper_arm().arm)
    target, swivel = posed(arm, np.random.default_rng(1).uniform(-2, 2, (ROWS, 6)))
    one = solve_ik(arm, target, swivel)
    other = solve_ik(arm, Pointing(target.position, target.direction * size), swivel)
    np.testing.assert_allclose(other.q, one.q, atol=1e-12)
    assert other.residual.rotation.max() < 1e-12
    assert (other.status == one.status).all()


def test_a_rotation_rounded_to_float32_is_still_one():
    arm, position, orientation, swivel, _ = batch("general_7")
    sol = solve_ik(arm, Pose(position, orientation.astype(np.float32).astype(np.float64)), swivel)
    assert (sol.status == Status.OK).all()
    assert sol.residual.rotation.max() < 1e-6


@pytest.mark.parametrize(("decimals", "taken"), [(6, True), (4, False)])
def test_a_rotation_printed_with_six_decimals_is_still_one(decimals, taken):
    rotation = Rotation.random(2000, rng=np.random.default_rng(0)).as_matrix()
    printed = Pose(jnp.full((2000, 3), 0.3), jnp.asarray(np.round(rotation, decimals)))
    arm = free(presets.iiwa7().arm)
    solution = solve_ik(arm, printed, 0.3)
    assert (solution.ok == taken).all()
    if taken:
        assert solution.residual.rotation.max() < 4e-6
        return
    with pytest.raises(UnreachableError, match=r"not a rotation matrix to 2e-6 .*jaxik\.nearest_rotation mends it"):
        solution.raise_if_invalid()
    assert solve_ik(arm, Pose(printed.position, nearest_rotation(printed.rotation)), 0.3).ok.all()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("dust", [0.0, 1e-16, 1e-14, 1e-12, 1e-7])
@pytest.mark.parametrize("joints", [6, 7])
def test_a_hand_without_length_but_for_rounding_points_along_the_tool(joints, dust, dtype):
    """In any direction the dust may have: a URDF's sums leave it across the hand as well as along it."""
    arm = random_arm(17, 6) if joints == 6 else presets.iiwa7().arm
    arm = dataclasses.replace(arm, tool_position=arm.wrist + dust * jnp.array([0.6, -0.8, 0.1])).astype(dtype)
    q = np.random.default_rng(3).uniform(-2, 2, (50, joints)).astype(dtype)
    target, swivel = posed(free(arm), q)
    solution = solve_ik(free(arm), target.pointing() if isinstance(target, Pose) else target, swivel)
    assert solution.ok.all()
    assert (solution.residual.position < 4e-6 if dtype == np.float64 else solution.residual.position < 1e-4).all()


def test_a_hand_of_any_length_beside_its_axis_cannot_point():
    arm = free(random_arm(17, 6))
    across = jnp.cross(arm.tool_rotation[:, 2], arm.axes[5])
    for aside, ok in ((1e-4, False), (1e-9, True)):
        bent = dataclasses.replace(arm, tool_position=arm.wrist + aside * across)
        target = Pointing(arm.shoulder + 0.3, jnp.ones(3))
        assert (solve_ik(bent, target, 0.2).status == INVALID).all() != ok


def test_statuses_rank_by_what_hinders_most():
    """Bad input over out of reach over limits: one number a row and branch, the worst."""
    _, position, orientation, swivel, _ = batch("iiwa14")
    tight = presets.iiwa14().arm
    both = Pose(position.at[0].set(100.0).at[1].set(100.0), orientation.at[0].multiply(2.0))
    status = solve_ik(tight, both, swivel.at[1].set(jnp.nan)).status
    assert (status[0] == INVALID).all()
    assert (status[1] == NONFINITE).all()
    assert np.isin(status, [Status.OK, Status.LIMITS, INVALID, NONFINITE]).all()
