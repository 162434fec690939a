"""Feasible arcs against a fine sweep of the swivel, at their ends, on full and empty circles, and for bad targets."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
from jaxik import Status
from tests.helpers.arms import ALL_PRESETS, random_arm
from tests.helpers.reachable import postures, target_of, tightened

TURN = 2 * np.pi
# One batch size, so that one program serves all tests of arms of one shape: it takes longer to compile than to run.
COUNT = 400


@jax.jit
def differ(arm, target, swivels, start, end, valid):
    """Where one target's arcs say otherwise than solve_ik, ``(swivel, branch)``."""
    offset = swivels[:, None, None] - start
    held = jnp.any(valid & (offset - TURN * jnp.floor(offset / TURN) <= end - start), axis=-1)
    return held != jaxik.solve_ik(arm, target, swivels).ok


def disagreement(arm, target, rows, samples):
    """Where arcs and a sweep of the swivel disagree in the first rows, as distance to an arc's end; and the arcs."""
    arcs = jaxik.swivel_arcs(arm, target)
    start, end, valid = (np.asarray(x) for x in (arcs.start, arcs.end, arcs.valid))
    swivels = np.linspace(-np.pi, np.pi, samples)
    worst = 0.0
    for row in range(rows):
        one = jax.tree.map(lambda x, row=row: x[row], (target, start, end, valid))
        for sample, branch in np.argwhere(np.asarray(differ(arm, one[0], swivels, *one[1:]))):
            ends = np.concatenate([x[row, branch][valid[row, branch]] for x in (start, end)])
            off = np.abs(np.mod(ends - swivels[sample] + np.pi, TURN) - np.pi)
            worst = max(worst, off.min(initial=np.pi))
    return worst, arcs


@pytest.mark.parametrize("seed", range(8))
def test_arcs_agree_with_a_sweep_for_random_arms(seed):
    # Few shapes, since each is a program to compile.
    arm = random_arm(seed, 6 + seed % 2, limits=True, keep_out=1, reference="paper" if seed % 2 else "stereographic")
    q = np.random.default_rng(seed).uniform(np.asarray(arm.lower), np.asarray(arm.upper), (COUNT, arm.n_joints))
    worst, _ = disagreement(arm, target_of(arm, q), 6, 4001)
    assert worst <= TURN / 4000


@pytest.mark.slow
@pytest.mark.parametrize("tight", [False, True])
@pytest.mark.parametrize("name", ALL_PRESETS)
def test_arcs_agree_with_a_fine_sweep_on_every_branch(name, tight):
    arm = ALL_PRESETS[name]().arm
    arm = tightened(arm, seed=3) if tight else arm
    worst, arcs = disagreement(arm, target_of(arm, postures(arm, COUNT, seed=1)), 40, 40_001)
    assert worst <= TURN / 40_000
    assert np.all(np.any(np.asarray(arcs.valid), axis=(1, 2)))


@pytest.mark.parametrize("name", ALL_PRESETS)
def test_arcs_hold_the_swivel_that_made_the_target(name):
    arm = ALL_PRESETS[name]().arm
    q = postures(arm, COUNT, seed=2)
    swivel, branch = jaxik.swivel_of(arm, q)
    inside = np.asarray(jaxik.swivel_arcs(arm, target_of(arm, q)).contains(swivel))
    assert np.all(inside[np.arange(len(q)), np.asarray(branch)])


def test_an_end_of_an_arc_is_where_a_joint_meets_its_limit():
    arm = ALL_PRESETS["iiwa14"]().arm
    target = target_of(arm, postures(arm, COUNT, seed=5))
    arcs = jaxik.swivel_arcs(arm, target)
    rows, branches, places = np.nonzero(np.asarray(arcs.valid) & (np.asarray(arcs.end - arcs.start) < TURN - 1e-9))
    for ends in (arcs.start, arcs.end):
        swivel = ends[rows, branches, places]
        q = jaxik.solve_ik(arm, jax.tree.map(lambda x: x[rows], target), swivel).q[np.arange(len(rows)), branches]
        room = np.minimum(np.abs(q - arm.lower), np.abs(arm.upper - q)).min(axis=1)
        assert len(rows) > 100
        assert room.max() < 1e-7  # at a limit that is only touched, rounding moves the root by its square root
        assert np.median(room) < 1e-14


def test_an_arm_without_limits_has_the_whole_circle():
    arm = random_arm(4)
    arcs = jaxik.swivel_arcs(arm, target_of(arm, np.zeros((1, 7)) + 0.3))
    np.testing.assert_allclose(arcs.width, TURN)
    np.testing.assert_array_equal(arcs.valid.sum(-1), 1)


def test_a_locked_joint_leaves_arcs_of_width_zero():
    arm = ALL_PRESETS["iiwa14"]().arm
    q = np.array([[0.3, 0.7, 0.2, -1.1, 0.4, 0.8, -0.5]])
    locked = dataclasses.replace(arm, lower=arm.lower.at[2].set(0.2), upper=arm.upper.at[2].set(0.2))
    arcs = jaxik.swivel_arcs(locked, target_of(arm, q))
    swivel, branch = jaxik.swivel_of(arm, q)
    ends = np.asarray(arcs.start[0, branch[0]])[np.asarray(arcs.valid[0, branch[0]])]
    assert np.abs(ends - float(swivel[0])).min() < 1e-12
    nearest = jaxik.solve_nearest(locked, target_of(arm, q), q + 0.1)
    assert nearest.status[0] <= Status.NEAR_SINGULAR
    assert nearest.q[0, 2] == 0.2


def test_a_range_beyond_half_a_turn_admits_the_other_representative():
    arm = random_arm(1)
    wide = dataclasses.replace(arm, lower=arm.lower.at[0].set(2.5), upper=arm.upper.at[0].set(4.0))
    q = np.array([[3.5, 0.4, 0.3, 0.9, 0.2, 0.7, 0.1]])
    swivel, branch = jaxik.swivel_of(wide, q)
    assert bool(jaxik.swivel_arcs(wide, target_of(wide, q)).contains(swivel)[0, branch[0]])
    solution = jaxik.solve_ik(wide, target_of(wide, q), swivel)
    np.testing.assert_allclose(solution.q[0, branch[0]], q[0], atol=1e-12)
    assert solution.ok[0, branch[0]]


def test_bad_targets_have_no_arcs_and_leave_the_others_alone():
    arm = ALL_PRESETS["iiwa7"]().arm
    good = target_of(arm, postures(arm, COUNT, seed=0))
    far = good.position.at[1].set(jnp.array([9.0, 0.0, 0.0])).at[2].set(jnp.nan)
    arcs = jaxik.swivel_arcs(arm, jaxik.Pose(far, good.rotation))
    assert not np.any(arcs.valid[1:3])
    assert np.all(np.isfinite(arcs.start))
    assert np.all(np.isfinite(arcs.end))
    others = np.delete(np.arange(COUNT), [1, 2])
    np.testing.assert_array_equal(arcs.start[others], jaxik.swivel_arcs(arm, good).start[others])


def test_ends_have_the_derivative_of_the_root():
    arm = ALL_PRESETS["iiwa14"]().arm
    target = target_of(arm, postures(arm, 1, seed=8)[0])
    push = jnp.array([0.3, -0.2, 0.5])

    def ends(step):
        arcs = jaxik.swivel_arcs(arm, jaxik.Pose(target.position + step * push, target.rotation))
        return arcs.start, arcs.end

    (_, _), rates = jax.jvp(ends, (0.0,), (1.0,))
    for side in (0, 1):
        numeric = (ends(1e-6)[side] - ends(-1e-6)[side]) / 2e-6
        np.testing.assert_allclose(rates[side], numeric, atol=1e-6)
        assert np.abs(rates[side]).max() > 0.1


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_dtype_follows_the_target(dtype):
    arm = ALL_PRESETS["iiwa14"]().arm
    target = jax.tree.map(lambda x: x.astype(dtype), target_of(arm, postures(arm, COUNT, seed=1)))
    arcs = jaxik.swivel_arcs(arm, target)
    assert arcs.start.dtype == dtype
    exact = jaxik.swivel_arcs(arm, jax.tree.map(lambda x: x.astype("float64"), target))
    np.testing.assert_allclose(arcs.width, exact.width, atol=2e-3 if dtype == "float32" else 0)


def test_a_pose_for_six_joints_says_what_to_pass():
    arm = ALL_PRESETS["meccanoid_left"]().arm
    with pytest.raises(ValueError, match=r"expected a jaxik\.Pointing target"):
        jaxik.swivel_arcs(arm, jaxik.Pose(jnp.zeros(3), jnp.eye(3)))
