"""The nearest posture: coverage, against brute force, next to singular postures, and its derivatives."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
from jaxik import Status
from tests.helpers.arms import ALL_PRESETS, random_arm
from tests.helpers.postures import quick
from tests.helpers.reachable import postures, target_of, tightened

# One batch size, so that one program serves all tests of arms of one shape: it takes longer to compile than to run.
COUNT = 500


def brute_force(arm, target, q_now, weights, samples=20_001):
    """Least motion over samples of the swivel, every branch and every turn the limits admit."""
    solution = jaxik.solve_ik(arm, target, np.linspace(-np.pi, np.pi, samples))
    q, ok = np.asarray(solution.q), np.asarray(solution.ok)
    best = np.abs(q - q_now)
    for turn in (-2 * np.pi, 2 * np.pi):
        other = q + turn
        admitted = (other >= np.asarray(arm.lower)) & (other <= np.asarray(arm.upper))
        best = np.where(admitted, np.minimum(best, np.abs(other - q_now)), best)
    return np.min(np.where(ok, np.sum(weights * best**2, axis=-1), np.inf))


@pytest.mark.parametrize("name", quick("iiwa7", slow=["meccanoid_left", "paper_arm", 0, 1, 2, 3]))
def test_never_further_than_brute_force(name):
    if isinstance(name, int):
        arm = random_arm(
            name, 6 + name % 2, limits=True, keep_out=1, reference="paper" if name % 2 else "stereographic"
        )
        q = np.random.default_rng(1).uniform(arm.lower, arm.upper, (COUNT, arm.n_joints))
    else:
        arm = ALL_PRESETS[name]().arm
        q = postures(arm, COUNT, seed=1)
    q_now = np.random.default_rng(2).uniform(np.maximum(arm.lower, -4), np.minimum(arm.upper, 4), q.shape)
    weights = np.random.default_rng(3).uniform(0.2, 2.0, arm.n_joints)
    target = target_of(arm, q)
    found = jaxik.solve_nearest(arm, target, q_now, weights=weights)
    for row in range(30):
        least = brute_force(arm, jax.tree.map(lambda x, row=row: x[row], target), q_now[row], weights)
        usable = found.status[row] <= Status.NEAR_SINGULAR
        assert usable or np.isinf(least)
        assert not usable or found.motion[row] <= least + 1e-9


def check_coverage(arm, count, seed):
    q = postures(arm, count, seed)
    found = jaxik.solve_nearest(arm, target_of(arm, q), postures(arm, count, seed + 1), weights=jnp.ones(arm.n_joints))
    assert np.all(np.asarray(found.status) <= Status.NEAR_SINGULAR)
    assert np.all((found.q >= arm.lower) & (found.q <= arm.upper))
    reached, wanted = jaxik.joint_positions(arm, found.q)[:, 3], jaxik.joint_positions(arm, q)[:, 3]
    assert np.abs(reached - wanted).max() <= 1e-9 * float(arm.length)


@pytest.mark.parametrize("tight", [False, True])
@pytest.mark.parametrize("name", quick("meccanoid_right", "iiwa14", slow=["paper_arm"]))
def test_every_reachable_target_is_solved_within_the_limits(name, tight):
    arm = ALL_PRESETS[name]().arm
    for seed in (3, 5, 7, 9):
        check_coverage(tightened(arm, seed=7) if tight else arm, COUNT, seed)


@pytest.mark.slow
@pytest.mark.parametrize("name", ALL_PRESETS)
def test_a_hundred_thousand_reachable_targets_of_tight_arms_are_solved(name):
    """Each batch with limits of its own."""
    for seed in range(200):
        check_coverage(tightened(ALL_PRESETS[name]().arm, seed=11 + seed), COUNT, seed=5 + 2 * seed)


@pytest.mark.parametrize("sine", [1e-1, 1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("joint", [1, 5])
def test_stays_put_next_to_an_aligned_triple(joint, sine):
    """There the outer joints swing by half a turn within a sliver of the circle, which samples of it would miss."""
    arm = ALL_PRESETS["iiwa14"]().arm
    q = postures(arm, COUNT, seed=4)
    q[:, joint] = sine
    found = jaxik.solve_nearest(arm, target_of(arm, q), q, weights=jnp.ones(7))
    assert np.all(np.asarray(found.motion) <= 1e-9)


def test_follows_a_small_step_of_the_target():
    arm = ALL_PRESETS["iiwa14"]().arm
    q = postures(arm, COUNT, seed=6)
    target = target_of(arm, q)
    moved = jaxik.Pose(target.position + 1e-6, target.rotation)
    found = jaxik.solve_nearest(arm, moved, q, weights=jnp.ones(7))
    usable = np.asarray(found.status) == Status.OK
    assert usable.mean() > 0.9
    assert np.median(np.asarray(found.motion)[usable]) < 1e-9


def objective(arm, q_now, position, rotation, weights):
    return jaxik.solve_nearest(arm, jaxik.Pose(position, rotation), q_now, weights=weights).q


@pytest.mark.slow
@pytest.mark.parametrize("tight", [False, True])
def test_derivatives_equal_differences_inside_arcs_and_at_their_ends(tight):
    arm = ALL_PRESETS["iiwa14"]().arm
    arm = tightened(arm, seed=7, fraction=0.3) if tight else arm
    q, q_now = postures(arm, 24, seed=1), postures(arm, 24, seed=2)
    target = target_of(arm, q)
    weights = jnp.linspace(0.5, 1.5, 7)
    rng = np.random.default_rng(0)
    push, pull = rng.normal(size=(24, 3)), rng.normal(size=(24, 7))

    def moved(step):
        return objective(arm, q_now + step * pull, target.position + step * push, target.rotation, weights)

    rate = jax.jvp(moved, (0.0,), (1.0,))[1]
    step = 1e-6
    ahead, behind, here = moved(step), moved(-step), moved(0.0)
    numeric = (ahead - behind) / (2 * step)
    # Rows whose minimum jumps to another branch or meets a limit within the step have no derivative to compare.
    smooth = np.abs(ahead + behind - 2 * here).max(axis=1) < 1e-8
    assert smooth.sum() >= 18
    np.testing.assert_allclose(rate[smooth], numeric[smooth], rtol=1e-4, atol=1e-4)
    on_limit = np.any(np.minimum(here - arm.lower, arm.upper - here) < 1e-9, axis=1)
    assert (on_limit & smooth).sum() >= 3 if tight else (~on_limit & smooth).sum() >= 3


@pytest.mark.slow
def test_forward_and_reverse_derivatives_agree_in_every_argument():
    arm = ALL_PRESETS["iiwa14"]().arm
    q = postures(arm, 1, seed=1)[0]
    target = target_of(arm, q)
    arguments = (q + 0.2, target.position, target.rotation, jnp.ones(7))

    def f(arm, *rest):
        return jnp.sum(jnp.sin(objective(arm, *rest)))

    tangents = jax.tree.map(lambda x: jnp.full_like(x, 0.1), (arm, *arguments))
    forward = jax.jvp(f, (arm, *arguments), tangents)[1]
    reverse = jax.grad(f, argnums=(0, 1, 2, 3, 4))(arm, *arguments)
    total = sum(jnp.vdot(a, b) for a, b in zip(jax.tree.leaves(reverse), jax.tree.leaves(tangents), strict=True))
    np.testing.assert_allclose(forward, total, rtol=1e-10)
    assert np.isfinite(forward)
    assert forward != 0


@pytest.mark.slow
def test_batch_equals_loop_and_vmap():
    arm = ALL_PRESETS["meccanoid_right"]().arm
    q, q_now = postures(arm, COUNT, seed=1), postures(arm, COUNT, seed=2)
    target = target_of(arm, q)
    batch = jaxik.solve_nearest(arm, target, q_now, weights=jnp.ones(6))
    mapped = jax.vmap(jaxik.solve_nearest, (None, 0, 0))(arm, target, q_now)
    np.testing.assert_allclose(batch.q, mapped.q, atol=1e-9)  # which has weights of one by default
    one = jaxik.solve_nearest(arm, jax.tree.map(lambda x: x[3], target), q_now[3])
    np.testing.assert_allclose(batch.q[3], one.q, atol=1e-9)


def test_unreachable_and_bad_rows_say_so_and_stay_finite():
    arm = ALL_PRESETS["iiwa7"]().arm
    q = postures(arm, COUNT, seed=1)
    target = target_of(arm, q)
    position = target.position.at[1].set(jnp.array([0.0, 9.0, 0.0]))
    now = q + 0.1
    now[2, 4] = np.nan
    found = jaxik.solve_nearest(arm, jaxik.Pose(position, target.rotation), now, weights=jnp.ones(7))
    assert [int(s) for s in found.status[1:3]] == [Status.OUT_OF_REACH, Status.NONFINITE_INPUT]
    assert np.all(np.isfinite(found.q))
    assert np.all(np.isfinite(found.motion))
    clean = jaxik.solve_nearest(arm, target, q + 0.1, weights=jnp.ones(7))
    np.testing.assert_array_equal(found.q[0], clean.q[0])
    np.testing.assert_array_equal(found.q[3:], clean.q[3:])


def test_wrong_shapes_say_what_was_expected(without_type_checks):
    arm = ALL_PRESETS["iiwa7"]().arm
    target = jaxik.Pose(jnp.zeros(3), jnp.eye(3))
    with pytest.raises(ValueError, match=r"expected joint angles of shape \(\*batch, 7\), got \(6,\)"):
        jaxik.solve_nearest(arm, target, jnp.zeros(6))
    with pytest.raises(ValueError, match=r"expected weights of shape \(7,\), got \(3,\)"):
        jaxik.solve_nearest(arm, target, jnp.zeros(7), weights=jnp.ones(3))


@pytest.mark.parametrize("bad", ["position", "rotation"])
def test_a_bad_frame_leaves_the_arm_where_it_is(bad):
    arm = ALL_PRESETS["iiwa7"]().arm
    q = postures(arm, COUNT, seed=1)
    target, now = target_of(arm, q), q + 0.1
    clean = jaxik.solve_nearest(arm, target, now, weights=jnp.ones(7))
    spoilt = {"position": target.position, "rotation": target.rotation}
    spoilt[bad] = spoilt[bad].at[1].set(np.nan).at[2].set(0.0 if bad == "rotation" else np.inf)
    found = jaxik.solve_nearest(arm, jaxik.Pose(**spoilt), now, weights=jnp.ones(7))
    np.testing.assert_array_equal(found.q[1:3], np.clip(now[1:3], arm.lower, arm.upper))
    assert int(found.status[1]) == Status.NONFINITE_INPUT
    assert not np.any(found.ok[1:3])
    np.testing.assert_array_equal(np.delete(found.q, [1, 2], axis=0), np.delete(clean.q, [1, 2], axis=0))


RANGES = {
    "2": 2.0,
    "pi": np.pi,
    "3.2": 3.2,
    "two turns": 2 * np.pi,
    "one side": (0.0, 7.0),
    "far": (7.0, 12.0),
    "none": 1e6,
}


@pytest.mark.parametrize("name", quick("pi", "far", slow=[r for r in RANGES if r not in ("pi", "far")]))
def test_no_turn_and_no_swivel_of_any_branch_is_nearer(name):
    """Ranges of any width and place, weights with a zero, and present postures inside and outside."""
    arm, limits = ALL_PRESETS["iiwa7"]().arm, RANGES[name]
    low, high = limits if isinstance(limits, tuple) else (-limits, limits)
    free = dataclasses.replace(arm, lower=jnp.full(7, -np.pi), upper=jnp.full(7, np.pi))
    arm = dataclasses.replace(arm, lower=jnp.full(7, low), upper=jnp.full(7, high))
    rng = np.random.default_rng(3)
    q = rng.uniform(max(low, -10), min(high, 10), (COUNT, 7))
    q_now, weights = rng.uniform(-8, 8, (COUNT, 7)), np.array([1.0, 0.3, 2.0, 0.7, 0.0, 1.3, 0.2])
    target = target_of(arm, q)
    found = jaxik.solve_nearest(arm, target, q_now, weights=weights)
    for row in range(60):
        solution = jaxik.solve_ik(
            free, jax.tree.map(lambda x, row=row: x[row], target), np.linspace(-np.pi, np.pi, 2001)
        )
        angles = np.asarray(solution.q)[..., None] + 2 * np.pi * np.arange(-4, 5)
        off = np.where((angles >= low) & (angles <= high), np.abs(angles - q_now[row][:, None]), np.inf).min(axis=-1)
        fits = np.all(np.isfinite(off), axis=-1) & (np.asarray(solution.status) < Status.KEEP_OUT)
        moved = np.where(fits, np.sum(weights * np.where(np.isfinite(off), off, 0.0) ** 2, axis=-1), np.inf)
        assert bool(found.ok[row]) or np.isinf(moved.min())
        assert found.motion[row] <= moved.min() * (1 + 1e-9) + 1e-12
