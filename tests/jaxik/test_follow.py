"""Following a moving target: never too fast, never outside limits, on target whenever a posture is within the step."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
from jaxik import FollowStatus
from jaxik.redundancy.step_ranges import braking_step
from tests.helpers.arms import ALL_PRESETS

DT = 1e-3
STEPS, ROWS = 300, 24


def stream(arm, seed):
    """Start postures and the targets of rows of six kinds: walk, noise, spin, out of reach, lost frames, jumps."""
    rng = np.random.default_rng(seed)
    low, high, fastest = (np.asarray(x) for x in (arm.lower, arm.upper, arm.velocity_limit))
    start = rng.uniform(low, high, (ROWS, arm.n_joints))
    start[:6, [1, 5]] = 0.0  # aligned
    start[6:9, 3] = 0.0  # straight
    q, rate, walk = start, rng.normal(size=start.shape) * 0.4 * fastest, []
    for _ in range(STEPS):
        q = q + DT * rate
        rate = np.where((q < low) | (q > high), -rate, rate)
        q = np.clip(q, low, high)
        walk.append(q)
    tool = jaxik.forward_kinematics(arm, np.stack(walk))
    position, rotation, kind = np.array(tool.position), np.array(tool.rotation), np.arange(ROWS) % 6
    position[:, kind == 1] += 5e-4 * rng.normal(size=position[:, kind == 1].shape)
    angle = np.linspace(0, 0.4, STEPS)
    spin = np.zeros((STEPS, 3, 3))
    spin[:, 0, 0] = spin[:, 1, 1] = np.cos(angle)
    spin[:, 1, 0], spin[:, 0, 1], spin[:, 2, 2] = np.sin(angle), -np.sin(angle), 1.0
    rotation[:, kind == 2], position[:, kind == 2] = rotation[0, kind == 2] @ spin[:, None], position[0, kind == 2]
    position[:, kind == 3] *= 1 + 0.8 * np.sin(np.linspace(0, np.pi, STEPS))[:, None, None]
    lost = (kind == 4) & (rng.uniform(size=(STEPS, ROWS)) < 0.1)
    position[lost] = np.nan
    position[100:, kind == 5] = position[100:, kind == 0]
    return start, position, rotation


@jax.jit
def run(arm, q, target, acceleration):
    def step(last, target):
        found = jaxik.follow(arm, target, last.q, DT, acceleration=acceleration, last=last)
        return found, found

    return jax.lax.scan(step, jaxik.FollowStep.at_rest(q), target)[1]


@pytest.fixture(scope="module")
def followed():
    arm = ALL_PRESETS["iiwa7"]().arm
    start, position, rotation = stream(arm, 0)
    found = run(arm, jnp.asarray(start), jaxik.Pose(jnp.asarray(position), jnp.asarray(rotation)), np.full(7, np.inf))
    before = np.concatenate([start[None], found.q[:-1]])
    return arm, position, rotation, before, found


def test_accelerations_are_kept_up_to_the_limits_and_through_lost_frames():
    """Fast streams over the limits: without braking in time, one of the two would be broken."""
    arm = ALL_PRESETS["iiwa7"]().arm
    start, position, rotation = stream(arm, 1)
    most = np.linspace(20.0, 60.0, 7)
    found = run(arm, jnp.asarray(start), jaxik.Pose(jnp.asarray(position), jnp.asarray(rotation)), most)
    q = np.concatenate([start[None], start[None], found.q])
    assert np.all(np.abs(np.diff(q, axis=0)) <= arm.velocity_limit * DT * (1 + 1e-9))
    assert np.all(np.abs(np.diff(q, n=2, axis=0)) <= most * DT**2 * (1 + 1e-6))
    assert np.all((found.q >= arm.lower) & (found.q <= arm.upper))
    assert np.any((np.diff(q, axis=0)[-200:] != 0) & (np.minimum(q - arm.lower, arm.upper - q)[-200:] < 0.01))
    walks = np.asarray(found.ok)[-100:, np.arange(ROWS) % 6 == 0]
    assert np.mean(walks) > 0.7  # they have caught up with what moves on
    lost = np.isnan(position[..., 0])
    assert np.all(np.asarray(found.status)[lost] == FollowStatus.BAD_INPUT)
    before = np.diff(q, axis=0)[:-1]
    assert np.all(np.abs(found.velocity[lost] * DT) <= np.abs(before[lost]) + 1e-12)


def test_a_joint_brakes_to_its_limit_in_whole_steps():
    """From rest, as fast as it may and always in time: the steps are those of the closed form."""
    unit, distance, steps = 1.0, 10.3, []
    step = 0.0
    while distance > 1e-12 and len(steps) < 20:
        step = min(step + unit, float(braking_step(jnp.asarray(distance), jnp.asarray(unit))))
        distance -= step
        steps.append(step)
    assert abs(distance) < 1e-12
    assert np.all(np.abs(np.diff([0.0, *steps, 0.0])) <= unit + 1e-12)
    assert len(steps) == 6  # five come to 1 + 2 + 3 + 2 + 1 = 9 at most


def test_no_step_is_too_fast_and_no_limit_broken(followed):
    arm, _, _, before, found = followed
    assert np.all(np.isfinite(found.q))
    assert np.all(np.abs(found.q - before) <= arm.velocity_limit * DT * (1 + 1e-9))
    assert np.all((found.q >= arm.lower) & (found.q <= arm.upper))


def test_the_lag_is_what_is_left(followed):
    arm, position, _rotation, _, found = followed
    good = np.asarray(found.status) != FollowStatus.BAD_INPUT
    reached = jaxik.forward_kinematics(arm, found.q)
    off = np.linalg.norm(reached.position - position, axis=-1)
    np.testing.assert_allclose(found.lag.position[good], off[good], atol=1e-9)
    on_target = np.asarray(found.ok)
    assert np.max(found.lag.position[on_target]) <= 1e-9
    assert np.max(found.lag.rotation[on_target]) <= 1e-9
    assert on_target.mean() > 0.3
    np.testing.assert_array_equal(~good, np.isnan(position[..., 0]))


def test_lost_frames_leave_the_arm_in_place(followed):
    _, position, _, before, found = followed
    lost = np.isnan(position[..., 0])
    assert lost.any()
    np.testing.assert_array_equal(np.asarray(found.q)[lost], before[lost])
    assert np.all(np.isinf(found.lag.position[lost]) & np.isinf(found.lag.rotation[lost]))


def test_a_lagging_step_had_no_posture_on_target(followed):
    """Samples of every swivel and branch: none is within the step."""
    arm, position, rotation, before, found = followed
    room = np.asarray(arm.velocity_limit) * DT
    lagging = np.argwhere(np.asarray(found.status) == FollowStatus.LAGGING)
    for k, row in lagging[:: max(1, len(lagging) // 40)]:
        pose = jaxik.Pose(position[k, row], rotation[k, row])
        here = float(jaxik.swivel_of(arm, before[k, row]).swivel)
        near = here + np.linspace(-0.05, 0.05, 2001)  # the elbow cannot turn farther in a step
        solution = jaxik.solve_ik(arm, pose, np.concatenate([near, np.linspace(-np.pi, np.pi, 1000)]))
        inside = np.all(np.abs(np.asarray(solution.q) - before[k, row]) <= room, axis=-1)
        assert not np.any(inside & np.asarray(solution.ok))


def test_an_arm_at_rest_on_its_target_stays(followed):
    arm, *_ = followed
    home = np.radians([45.0, 0, 0, -90, 0, 90, 0])
    found = jaxik.follow(arm, jaxik.forward_kinematics(arm, home), home, DT)
    np.testing.assert_allclose(found.q, home, atol=1e-12)
    assert bool(found.ok)
    outside = home + np.array([0.0, 0, 0, 0, 0, 0, 5.0])
    back = jaxik.follow(arm, jaxik.forward_kinematics(arm, home), outside, DT)
    assert outside[6] - arm.velocity_limit[6] * DT <= back.q[6] < outside[6]


def test_wrong_shapes_say_what_was_expected(without_type_checks):
    arm = ALL_PRESETS["iiwa7"]().arm
    pose = jaxik.Pose(jnp.zeros(3), jnp.eye(3))
    with pytest.raises(ValueError, match=r"expected joint angles of shape \(\*batch, 7\), got \(6,\)"):
        jaxik.follow(arm, pose, jnp.zeros(6), DT)
    with pytest.raises(ValueError, match=r"expected weights \(7,\) and dt \(\), got \(7,\) and \(2,\)"):
        jaxik.follow(arm, pose, jnp.zeros(7), jnp.zeros(2))
    with pytest.raises(ValueError, match="acceleration needs last, the last step"):
        jaxik.follow(arm, pose, jnp.zeros(7), DT, acceleration=10.0)
    with pytest.raises(ValueError, match=r"expected acceleration \(\) or \(7,\), got \(6,\)"):
        jaxik.follow(arm, pose, jnp.zeros(7), DT, acceleration=jnp.ones(6), last=jaxik.FollowStep.at_rest(jnp.zeros(7)))
