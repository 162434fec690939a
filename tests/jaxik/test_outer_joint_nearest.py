"""Arms with an outer joint: the nearest posture on target, its derivative, and following."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
from jaxik import FollowStatus, Pose, Status, forward_kinematics, solve_ik, solve_nearest
from jaxik.redundancy.tangent import tangent
from tests.helpers.outer_joint_arms import postures, random_outer_joint_arm, recorded_arm

ROWS = 128
GRID = 2001


def columns(target):
    return target.position.T, jnp.moveaxis(target.rotation, 0, -1)


@jax.jit
def least_of_grid(arm, target, q_now):
    """Least motion over 2001 parameters in all branches, each angle at its nearest turn in limits, ``(n,)``."""
    joint = arm.outer_joint
    parameters = jnp.linspace(jnp.maximum(arm.lower[joint], -jnp.pi), jnp.minimum(arm.upper[joint], jnp.pi), GRID)

    def least(parameter):
        found = solve_ik(arm, target, jnp.full(len(q_now), parameter))
        q, now = found.q, q_now[:, None]
        q = jnp.where((q > now + jnp.pi) & (q - 2 * jnp.pi >= arm.lower), q - 2 * jnp.pi, q)
        q = jnp.where((q < now - jnp.pi) & (q + 2 * jnp.pi <= arm.upper), q + 2 * jnp.pi, q)
        return jnp.min(jnp.where(found.ok, jnp.sum((q - now) ** 2, axis=-1), jnp.inf), axis=-1)

    return jax.lax.map(least, parameters).min(axis=0)


def moved(q, seed, size):
    step = np.random.default_rng(seed).normal(size=q.shape)
    return q + size * step / np.linalg.norm(step, axis=1, keepdims=True)


@pytest.mark.parametrize("mirrored", [False, True])
def test_tangent_is_the_self_motion_to_third_order(mirrored):
    arm = random_outer_joint_arm(20, mirrored=mirrored)
    q = postures(arm, 20, ROWS)
    target = forward_kinematics(arm, q)
    at = tangent(arm, *columns(target), q.T)
    h = 1e-3
    for s in (h, -h):
        tool = forward_kinematics(arm, (q.T + s * at.direction + 0.5 * s * s * at.bend).T)
        off = jnp.max(jnp.abs(tool.matrix() - target.matrix()), axis=(1, 2))
        calm = jnp.sum(at.bend**2, axis=0) < 9.0
        assert float(jnp.where(calm, off, 0).max()) < 10 * h**3
    assert float(at.error.max()) < 1e-28


@pytest.mark.parametrize("name", ["franka_fr3", "xarm7_erd", "pr2_right"])
def test_nearest_is_never_farther_than_the_posture_that_moved_away(data_dir, name):
    arm = recorded_arm(data_dir, name)
    q = postures(arm, 21, ROWS)
    now = jnp.clip(moved(q, 21, 0.05), arm.lower, arm.upper)
    found = solve_nearest(arm, forward_kinematics(arm, q), now)
    assert bool(jnp.all(found.ok))
    reached, target = forward_kinematics(arm, found.q), forward_kinematics(arm, q)
    assert float(jnp.abs(reached.matrix() - target.matrix()).max()) < 1e-12
    assert bool(jnp.all((found.q >= arm.lower) & (found.q <= arm.upper)))
    assert float((found.motion - jnp.sum((q - now) ** 2, axis=1) > 1e-9).mean()) <= 0.01
    again = jaxik.swivel_of(arm, found.q)
    np.testing.assert_array_equal(found.branch, again.branch)
    np.testing.assert_array_equal(found.swivel, again.swivel)


@pytest.mark.parametrize("name", ["franka_fr3"])
def test_nearest_from_anywhere_is_that_of_a_fine_grid_or_nearer(data_dir, name):
    arm = recorded_arm(data_dir, name)
    target, now = forward_kinematics(arm, postures(arm, 22, ROWS)), postures(arm, 23, ROWS)
    found, grid = solve_nearest(arm, target, now), least_of_grid(arm, target, now)
    motion = jnp.where(found.ok, found.motion, jnp.inf)
    print(float((motion > grid * (1 + 1e-9)).mean()), float((motion < grid).mean()), int((~found.ok).sum()))
    # No bound between the samples: a few per cent of targets half the workspace away have a nearer posture.
    assert float((motion > grid * (1 + 1e-9)).mean()) <= 0.05
    assert float((motion < grid).mean()) > 0.8


@pytest.mark.slow
def test_derivative_is_that_of_differences_inside_intervals_and_at_limits(data_dir):
    arm, rng = recorded_arm(data_dir, "franka_fr3"), np.random.default_rng(24)
    q = postures(arm, 24, ROWS).at[: ROWS // 2, 1].set(arm.upper[1])
    # Before the limit the present posture wants to go beyond it.
    now = moved(q, 24, 0.05).at[: ROWS // 2, 1].add(0.3)
    target, weights = forward_kinematics(arm, q), jnp.asarray(rng.uniform(0.5, 2.0, 7))
    inputs = (arm, target.position, target.rotation, now, weights)
    change = jax.tree.map(lambda x: jnp.asarray(rng.normal(size=x.shape)), inputs)
    hat = jnp.cross(change[2][:, 0][:, None], jnp.eye(3)).swapaxes(1, 2)
    change = (*change[:2], hat @ target.rotation, *change[3:])

    @jax.jit
    def solved(arm, position, rotation, now, weights):
        return solve_nearest(arm, Pose(position, rotation), now, weights=weights).q

    value, rate = jax.jvp(solved, inputs, change)
    h = 1e-6
    ahead, behind = (solved(*jax.tree.map(lambda x, c, s=s: x + s * h * c, inputs, change)) for s in (1, -1))
    size = 1 + jnp.max(jnp.abs(rate), axis=1)
    off = jnp.max(jnp.abs((ahead - behind) / (2 * h) - rate), axis=1) / size
    held = jnp.any((value <= arm.lower) | (value >= arm.upper), axis=1)
    assert 10 < int(held.sum()) < ROWS - 10
    # Rows whose minimum jumps or whose limit lets go within the step have no derivative.
    for rows in (held, ~held):
        assert float((off[rows] < 1e-3).mean()) > 0.9
    cotangent = jnp.asarray(rng.normal(size=value.shape))
    gradients = jax.vjp(solved, *inputs)[1](cotangent)
    pairs = list(zip(jax.tree.leaves(gradients), jax.tree.leaves(change), strict=True))
    scale = sum(float(jnp.abs(g * c).sum()) for g, c in pairs)
    assert abs(sum(float(jnp.vdot(g, c)) for g, c in pairs) - float(jnp.vdot(cotangent, rate))) < 1e-10 * scale


def test_bad_rows_limits_and_keep_out(data_dir):
    arm = recorded_arm(data_dir, "franka_fr3")
    q = postures(arm, 25, ROWS)
    target = forward_kinematics(arm, q)
    position = target.position.at[0, 0].set(jnp.nan).at[1].multiply(100.0)
    rotation = target.rotation.at[2].multiply(2.0)
    now = q.at[3, 0].set(jnp.inf)
    found = solve_nearest(arm, Pose(position, rotation), now)
    expected = [Status.NONFINITE_INPUT, Status.OUT_OF_REACH, Status.INVALID_TARGET, Status.NONFINITE_INPUT]
    assert found.status[:4].tolist() == expected
    assert bool(jnp.all(found.ok[4:]))
    assert bool(jnp.all(jnp.isfinite(found.q)))
    np.testing.assert_array_equal(found.q[:3], q[:3])
    narrow = dataclasses.replace(arm, lower=arm.lower.at[3].set(-0.3), upper=arm.upper.at[3].set(-0.25))
    found = solve_nearest(narrow, target, q)
    outside = jnp.any((found.q < narrow.lower) | (found.q > narrow.upper), axis=1)
    np.testing.assert_array_equal(found.status, jnp.where(outside, Status.LIMITS, Status.OK))
    assert int(outside.sum()) > ROWS // 2
    assert float(jnp.abs(forward_kinematics(arm, found.q).position - target.position).max()) < 1e-9
    # A half-space that the present elbow is in: the elbow goes to its border, or the row says why not.
    elbow = jaxik.joint_positions(arm, q)[:, 1]
    normal = jnp.asarray([[0.0, 0.0, 1.0]])
    kept = dataclasses.replace(arm, keep_out=jaxik.HalfSpaces(normal, jnp.median(elbow[:, 2])[None]))
    found = solve_nearest(kept, target, q)
    height = jaxik.joint_positions(arm, found.q)[:, 1, 2]
    border = float(kept.keep_out.offset[0])
    assert bool(jnp.all(jnp.where(found.ok, height <= border + 1e-8, True)))
    assert bool(jnp.all(found.status[~found.ok] == Status.KEEP_OUT))
    assert int((jnp.abs(height - border) < 1e-8).sum()) > 10


def test_singular_postures_are_found_again(data_dir):
    """Aligned shoulder, straight elbow and double roots: where the closed form loses half of the digits."""
    arm = recorded_arm(data_dir, "franka_fr3")
    q = postures(arm, 26, ROWS)
    q = q.at[:40, 1].set(0.0).at[40:80, 3].set(arm.upper[3])
    target = forward_kinematics(arm, q)
    found = solve_nearest(arm, target, jnp.clip(moved(q, 26, 1e-3), arm.lower, arm.upper))
    assert bool(jnp.all(found.ok))
    assert float(jnp.abs(forward_kinematics(arm, found.q).matrix() - target.matrix()).max()) < 1e-9
    assert float(jnp.sqrt(found.motion).max()) < 1e-2


@pytest.mark.parametrize("name", ["franka_fr3"])
def test_follow_keeps_to_a_moving_target_and_to_speeds(data_dir, name):
    arm = recorded_arm(data_dir, name)
    arm = dataclasses.replace(arm, velocity_limit=jnp.full(7, 2.0))
    rng = np.random.default_rng(27)
    middle, half = (arm.lower + arm.upper) / 2, (arm.upper - arm.lower) / 2
    phase, rate = rng.uniform(0, 2 * np.pi, (2, ROWS, 7))
    time = 0.01 * np.arange(60)[:, None, None]
    q = middle + 0.9 * half * jnp.asarray(np.sin(phase + 0.08 * rate * time))
    target = jax.vmap(lambda q: forward_kinematics(arm, q))(q)

    def step(q, target):
        next_one = jaxik.follow(arm, target, q, 0.01)
        return next_one.q, (next_one.status, next_one.lag.position, jnp.abs(next_one.q - q).max())

    _, (status, lag, speed) = jax.jit(lambda q, t: jax.lax.scan(step, q, t))(q[0], target)
    assert float((status == FollowStatus.ON_TARGET).mean()) > 0.995
    assert float(jnp.where(status == FollowStatus.ON_TARGET, lag, 0).max()) < 1e-8
    assert float(speed.max()) <= 0.02 * (1 + 1e-9)
    far = Pose(target.position[0] * 10, target.rotation[0])
    assert bool(jnp.all(jaxik.follow(arm, far, q[0], 0.01).status == FollowStatus.INFEASIBLE))
