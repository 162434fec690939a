"""Worlds about arms with an outer joint: intervals, nearest postures, steps and plans by independent kinematics."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
from jaxik import FollowStatus, Status, World
from tests.helpers.arms import rotation_about
from tests.helpers.bodies import distance

MODEL = jaxik.with_body(jaxik.presets.franka_fr3(), jaxik.Body.preset("franka_fr3"))
ARM = MODEL.arm
BODY = ARM.surroundings.body
READY = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
ROWS = 8
# A table, and balls beside forearm and elbow of the ready posture.
WORLD = World(
    [[0.25, 0.28, 0.6], [0.3, -0.3, 0.55], [-0.1, 0.3, 0.75], [0.6, 0.0, 0.75]],
    [0.12, 0.12, 0.1, 0.05],
    normals=[[0.0, 0.0, -1.0]],
    offsets=[0.0],
)


def apart(q, world=WORLD):
    """Distances at postures ``(n, joint)`` by products of turns about points on the axes."""
    on = [np.asarray(ARM.stations[k]) for k in ARM.station_of_joint]
    places = []
    for posture in np.asarray(q).reshape(-1, 7):
        frames, turn, shift = [(np.eye(3), np.zeros(3))], np.eye(3), np.zeros(3)
        for axis, point, angle in zip(np.asarray(ARM.axes), on, posture, strict=True):
            about = rotation_about(axis, angle)
            turn, shift = turn @ about, shift + turn @ (point - about @ point)
            frames.append((turn, shift))
        places.append(
            [frames[n][0] @ c + frames[n][1] for n, c in zip(BODY.link, np.asarray(BODY.centers), strict=True)]
        )
    return distance(BODY, world, np.array(places)).reshape(np.shape(q)[:-1])


@pytest.fixture(scope="module")
def target():
    q = READY + np.random.default_rng(0).normal(0, 0.35, (ROWS, 7))
    return jaxik.forward_kinematics(ARM, np.clip(q, ARM.lower, ARM.upper))


@pytest.fixture(scope="module")
def arcs(target):
    return jax.tree.map(np.asarray, jaxik.swivel_arcs(MODEL, target, world=WORLD))


def test_intervals_are_free_of_obstacles(target, arcs):
    swivel = np.linspace(-np.pi, np.pi, 721)
    blocked = 0
    for row in range(ROWS):
        one = jax.tree.map(lambda x, row=row: jnp.broadcast_to(x[row], (721, *x[row].shape)), target)
        bare = jaxik.solve_ik(jaxik.presets.franka_fr3(), one, swivel)
        within = np.asarray(bare.ok)
        ok = within.copy()
        ok[within] = apart(np.asarray(bare.q)[within]) >= 0
        blocked += int((within & ~ok).sum())
        start, end, valid = arcs.start[row], arcs.end[row], arcs.valid[row]
        offset = swivel[:, None, None] - start
        held = (valid & (offset - 2 * np.pi * np.floor(offset / (2 * np.pi)) <= end - start)).any(axis=-1)
        for sample, branch in np.argwhere(held != ok):
            ends = np.concatenate([x[branch][valid[branch]] for x in (start, end)])
            off = np.abs(np.mod(ends - swivel[sample] + np.pi, 2 * np.pi) - np.pi)
            assert off.min(initial=np.pi) <= 1e-7
    assert blocked > 100
    assert arcs.status.tolist() == [Status.OK if v.any() else Status.COLLISION for v in arcs.valid]


@pytest.mark.slow
def test_nearest_is_free_with_the_derivative_of_an_obstacle(target, arcs):
    now = np.broadcast_to(READY, (ROWS, 7))

    @jax.jit
    def nearest(step):
        world = dataclasses.replace(WORLD, radii=WORLD.radii + step)
        found = jaxik.solve_nearest(MODEL, target, now, world=world)
        return found.q, found

    _, rate, found = jax.jvp(nearest, (0.0,), (1.0,), has_aux=True)
    ok = np.asarray(found.ok)
    np.testing.assert_array_equal(ok, arcs.valid.any(axis=(1, 2)))
    assert apart(np.asarray(found.q)[ok]).min() > -1e-9
    sides = [np.asarray(nearest(step)[0]) for step in (1e-6, -1e-6)]
    numeric = (sides[0] - sides[1]) / 2e-6
    same = ok & (np.abs(numeric).max(axis=-1) < 1e2)
    np.testing.assert_allclose(np.asarray(rate)[same], numeric[same], rtol=1e-4, atol=1e-5)
    assert np.abs(numeric[same]).max() > 0.1
    swivel = np.linspace(-np.pi, np.pi, 721)
    for row in np.flatnonzero(ok):
        one = jax.tree.map(lambda x, row=row: jnp.broadcast_to(x[row], (721, *x[row].shape)), target)
        sampled = jaxik.solve_ik(MODEL, one, swivel, world=WORLD)
        motion = np.sum((np.asarray(sampled.q)[np.asarray(sampled.ok)] - now[row]) ** 2, axis=-1)
        assert found.motion[row] <= motion.min() + 1e-9


@pytest.mark.slow
def test_a_loop_stays_clear(target):
    @jax.jit
    def run(q):
        def step(q, _):
            found = jaxik.follow(MODEL, target, q, 0.05, world=WORLD)
            return found.q, found

        return jax.lax.scan(step, q, None, length=40)[1]

    assert apart(READY) > 0
    found = run(jnp.broadcast_to(READY, (ROWS, 7)))
    assert apart(np.asarray(found.q)[::3]).min() > -1e-9
    assert (np.asarray(found.status) != FollowStatus.COLLISION).all()
    assert (found.status[-1] == FollowStatus.ON_TARGET).any()


@pytest.mark.slow
def test_a_plan_goes_round_what_is_in_its_way():
    way = np.linspace(0.0, 1.0, 16)[:, None]
    hand = jaxik.forward_kinematics(ARM, READY)
    position = np.asarray(hand.position) + (way - 0.5) * [0.0, 0.3, 0.1]
    path = jaxik.Path(jaxik.Pose(position, np.broadcast_to(hand.rotation, (16, 3, 3))), 4.0 * way[:, 0])
    free = jaxik.plan(jaxik.presets.franka_fr3(), path, gap=None).raise_if_invalid()
    elbow = np.asarray(jaxik.joint_positions(ARM, free.trajectory.q[8]))[1]
    world = World((elbow + np.array([0.0, 0.06, 0.02]))[None], 0.08)
    assert apart(free.trajectory.q, world).min() < -0.02
    found = jaxik.plan(MODEL, path, world=world, gap=None).raise_if_invalid()
    assert apart(found.trajectory.q, world).min() > -1e-8
    assert found.energy > free.energy
    assert found.clearance().at_waypoints.min() > -1e-8
    walled = World(position[8][None], 0.05)
    cut = jaxik.plan(MODEL, path, world=walled, gap=None)
    assert not cut.ok
    assert "(hand) and obstacle 0 would overlap by" in cut.problems[0]
