"""Plans among obstacles: clear at the waypoints, bounded between, and with reasons where there is no motion."""

import jax
import numpy as np
import pytest

import jaxik
from jaxik import PlanStatus, World
from jaxik.planning.problem import motion_and_arcs
from tests.helpers.bodies import carried, distance, random_body

MODEL = jaxik.presets.iiwa14()  # model and path of test_plan, whose programs serve here too


@pytest.fixture(scope="module")
def wave():
    return jaxik.fit_path(MODEL.arm, jaxik.example_path("wave"))[::10]


@pytest.fixture(scope="module")
def bodied():
    return jaxik.with_body(MODEL, random_body(MODEL.arm, 1))


@pytest.fixture(scope="module")
def free(wave):
    return jaxik.plan(MODEL, wave, gap=None)


def beside(free, row, away):
    """A world with a sphere beside the elbow of a motion, of which one has to keep away."""
    points = np.asarray(jaxik.joint_positions(MODEL, free.trajectory.q[row]))
    out = points[1] - (points[0] + points[2]) / 2
    return World((points[1] + away * out / np.linalg.norm(out))[None], 0.05)


def distances(bodied, world, q):
    body = bodied.arm.surroundings.body
    return distance(body, world, carried(MODEL.arm, body, q))


def test_a_plan_keeps_clear_of_what_is_in_its_way(bodied, wave, free):
    world = beside(free, len(wave) // 2, 0.05)
    assert distances(bodied, world, free.trajectory.q).min() < -0.01
    found = jaxik.plan(bodied, wave, world=world, gap=0.05).raise_if_invalid()
    assert found.energy > free.energy
    assert found.lower_bound > free.energy * 0.9
    along = found.clearance()
    np.testing.assert_allclose(along.at_waypoints, distances(bodied, world, found.trajectory.q), atol=1e-12)
    assert along.at_waypoints.min() > -1e-9
    assert "clearance: " in found.report()
    share = np.linspace(0, 1, 41)[:, None, None]
    q = found.trajectory.q
    between = distances(bodied, world, q[:-1] + share * np.diff(q, axis=0)).min(axis=0)
    assert (between >= along.between).all()
    assert (between - along.between).max() < 0.03


def test_a_margin_holds_at_the_waypoints(bodied, wave, free):
    world = beside(free, len(wave) // 2, 0.05)
    found = jaxik.plan(bodied, wave, world=world, clearance=0.03, gap=None).raise_if_invalid()
    assert found.clearance().at_waypoints.min() >= 0.03 - 1e-9
    q = found.trajectory.q
    share = np.linspace(0, 1, 21)[:, None, None]
    assert distances(bodied, world, q[:-1] + share * np.diff(q, axis=0)).min() > 0


def test_a_waypoint_without_room_is_named_with_what_blocks_it(bodied, wave):
    tool = np.asarray(wave.target.position)
    found = jaxik.plan(bodied, wave, world=World(tool[len(wave) // 2][None], 0.05), gap=None)
    assert found.status == PlanStatus.UNREACHABLE
    assert "(hand) and obstacle 0 would overlap by" in found.problems[0]
    assert "mm at best" in found.problems[0]
    assert f"waypoint {found.reachable_prefix}" in found.problems[0]


def test_a_world_per_waypoint_moves(bodied, wave, free):
    still = beside(free, len(wave) // 2, 0.05)
    away = np.abs(np.arange(len(wave)) - len(wave) // 2)[:, None, None] * np.array([0.0, 0.0, 0.05])
    floor = np.array([[0.0, 0.0, -1.0]]), np.array([2.0])
    world = World(np.asarray(still.centers) + away, np.broadcast_to(still.radii, (len(wave), 1)), *floor)
    found = jaxik.plan(bodied, wave, world=world, gap=None).raise_if_invalid()
    at = found.clearance().at_waypoints
    rows = [distances(bodied, world.rows(k), found.trajectory.q[k]) for k in range(len(wave))]
    np.testing.assert_allclose(at, rows, atol=1e-12)
    assert at.min() > -1e-9
    assert found.clearance().between.shape == (len(wave) - 1,)
    with pytest.raises(ValueError, match=r"a moving world needs one row per waypoint, \(\d+,\); got \(3,\)"):
        jaxik.plan(bodied, wave, world=world.rows(slice(3)))


def test_a_path_that_obstacles_cut_says_so(bodied, wave, free):
    """Balls round the elbow's circle have a gap at the elbow first, and across the circle from half of the path on."""
    points = np.asarray(jaxik.joint_positions(MODEL, free.trajectory.q))
    axis = (points[:, 2] - points[:, 0]) / np.linalg.norm(points[:, 2] - points[:, 0], axis=-1, keepdims=True)
    along = np.sum(axis * (points[:, 1] - points[:, 0]), axis=-1, keepdims=True)
    out = points[:, 1] - points[:, 0] - along * axis
    begin = np.where(np.arange(len(wave)) < len(wave) // 2, 0.0, np.pi)[:, None, None]
    angle = begin + np.radians([72.0, 126.0, 180.0, 234.0, 288.0])[:, None]
    ring = np.cos(angle) * out[:, None] + np.sin(angle) * np.cross(axis, out)[:, None]
    centers = (points[:, 0] + along * axis)[:, None] + ring
    world = World(centers, 0.09, np.array([[0.0, 0.0, -1.0]]), np.array([2.0]))
    found = jaxik.plan(bodied, wave, world=world, gap=None)
    assert found.status == PlanStatus.DISCONNECTED
    assert any("a motion that disregards obstacles would lead across, with sphere" in text for text in found.problems)


@pytest.mark.slow
def test_an_energy_of_proximity_keeps_away_where_that_is_cheap(bodied, wave, free):
    """The sphere leaves the motion of least energy free, but not by the distance from which on it counts."""
    world = beside(free, len(wave) // 2, 0.12)
    alone = distances(bodied, world, free.trajectory.q)
    assert 0.0 < alone.min() < 0.1
    near = jaxik.energy.proximity(bodied, world, distance=0.1)
    found = jaxik.plan(bodied, wave, world=world, energy=jaxik.energy.joint_motion() + 3.0 * near, gap=None)
    kept = distances(bodied, world, found.raise_if_invalid().trajectory.q)
    assert kept.min() > alone.min() + 0.01
    motion = found.parts["joint motion [rad²/s]"]
    assert free.energy <= motion < 1.1 * free.energy
    np.testing.assert_allclose(found.energy, motion + 3.0 * found.parts["proximity [s]"], rtol=1e-9)


def test_bad_inputs_say_what_to_do(bodied, wave):
    world = World([[1.0, 0.0, 0.0]], 0.1)
    with pytest.raises(ValueError, match=r"a world needs the arm's body: model = jaxik\.with_body"):
        jaxik.plan(MODEL, wave, world=world)
    with pytest.raises(ValueError, match=r"a clearance needs the arm's body"):
        jaxik.plan(MODEL, wave, clearance=0.01)
    with pytest.raises(ValueError, match=r"clearance is a distance of 0 m or more; got -0\.1"):
        jaxik.plan(bodied, wave, clearance=-0.1)


def test_problems_have_the_same_shapes_with_and_without_a_body(bodied, wave):
    """So that search and refinement are compiled once."""
    shapes = [jax.eval_shape(motion_and_arcs, arm, wave.target) for arm in (MODEL.arm, bodied.arm)]
    assert shapes[0] == shapes[1]
