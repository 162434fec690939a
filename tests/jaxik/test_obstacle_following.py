"""Control loops and batches of paths among obstacles: no step into a collision, judged by independent kinematics."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize

import jaxik
from jaxik import FollowStatus, World
from tests.helpers.arms import ALL_PRESETS
from tests.helpers.bodies import carried, distance, random_body, random_world
from tests.helpers.reachable import postures, target_of

ARM = ALL_PRESETS["iiwa14"]().arm
BODY = random_body(ARM, 1)
BODIED = jaxik.with_body(ARM, BODY)
ROWS, STEPS, DT = 24, 100, 0.05
WORLD = random_world(ARM, 7)


def distances(world, q):
    return distance(BODY, world, carried(ARM, BODY, np.asarray(q, float)))


@pytest.fixture(scope="module")
def followed():
    """Rows from one clear posture to another; behind them the world stands still, and then a ball comes at the arm."""
    q = postures(ARM, 400, seed=3)
    clear = q[distances(WORLD, q) > 0.01]
    start, goal = clear[:ROWS], clear[ROWS : 2 * ROWS]
    centers = np.repeat(np.asarray(WORLD.centers)[None], STEPS, axis=0)
    elbow = np.asarray(jaxik.joint_positions(ARM, goal[0]))[1]
    centers[STEPS // 2 :, 0] = elbow + np.linspace(0.6, 0.0, STEPS - STEPS // 2)[:, None] * [0.0, 0.8, 0.6]
    target = target_of(ARM, goal)

    @jax.jit
    def run(q, centers):
        def step(q, centers):
            world = World(centers, WORLD.radii, WORLD.normals, WORLD.offsets)
            found = jaxik.follow(BODIED, target, q, DT, world=world)
            return found.q, found

        return jax.lax.scan(step, q, centers)[1]

    found = run(jnp.asarray(start), jnp.asarray(centers))
    before = np.concatenate([start[None], found.q[:-1]])
    worlds = [World(c, WORLD.radii, WORLD.normals, WORLD.offsets) for c in centers]
    apart = np.array([distances(world, q) for world, q in zip(worlds, found.q, strict=True)])
    return before, found, apart


def test_no_step_enters_an_obstacle(followed):
    before, found, apart = followed
    still = apart[: STEPS // 2]
    assert still.min() > -1e-9
    status = np.asarray(found.status)
    assert (status[: STEPS // 2] != FollowStatus.COLLISION).all()
    assert (status == FollowStatus.BLOCKED).any()
    assert (status[STEPS // 2 - 1] == FollowStatus.ON_TARGET).mean() > 0.5
    assert apart[status != FollowStatus.COLLISION].min() > -1e-9
    assert (apart[status == FollowStatus.COLLISION] < 0).all()
    assert np.all(np.abs(found.q - before) <= ARM.velocity_limit * DT * (1 + 1e-9))


def test_a_step_gives_way_to_what_comes(followed):
    """The ball ends where the elbow of row 0 was to be."""
    _, found, apart = followed
    assert apart[-1, 0] > -1e-9
    assert np.linalg.norm(found.q[-1, 0] - found.q[STEPS // 2 - 1, 0]) > 0.05


def test_wrong_worlds_say_what_to_do():
    target = target_of(ARM, postures(ARM, 1, seed=0))
    with pytest.raises(ValueError, match=r"a world needs the arm's body: model = jaxik\.with_body"):
        jaxik.follow(ARM, target, np.zeros((1, 7)), DT, world=WORLD)
    moving = World(np.zeros((3, 1, 3)), 0.1)
    path = jaxik.Path(jax.tree.map(lambda x: jnp.repeat(x, 4, axis=0), target), np.arange(4.0))
    with pytest.raises(ValueError, match=r"expected worlds whose axes broadcast to time's, \(4,\); got \(3,\)"):
        jaxik.plan_batch(BODIED, path.target, path.time, world=moving)
    with pytest.raises(ValueError, match=r"a path is placed in a world at rest; got one with batch axes \(3,\)"):
        jaxik.fit_path(BODIED, path, world=moving)


@pytest.mark.slow
def test_the_closest_posture_stays_clear_and_says_what_holds_it():
    """Balls on the tool points of three of four targets, which no posture reaches then."""
    q = postures(ARM, 400, seed=3)
    target = target_of(ARM, q[distances(WORLD, q) > 0.02][:4])
    down = np.array([[0.0, 0.0, -1.0]]), np.array([0.5])
    weights = np.array([1.0, 0.05])

    @jax.jit
    def closest(step):
        def at(step):
            world = World(np.asarray(target.position)[:3], jnp.array([0.1, 0.12, 0.08]) + step, *down)
            found = jaxik.solve_closest(BODIED, target, weights=weights, world=world)
            return found.cost, found

        return jax.jvp(at, (step,), (1.0,), has_aux=True)[1:]

    rate, found = closest(0.0)
    world = World(np.asarray(target.position)[:3], [0.1, 0.12, 0.08], *down)
    apart = distances(world, found.q)
    assert apart.min() > -1e-9
    held = np.asarray(found.body_held)
    assert held[:3].all()
    assert (np.asarray(found.status)[:3] == jaxik.Status.COLLISION).all()
    assert np.abs(apart[held]).max() < 1e-6
    np.testing.assert_array_equal(np.asarray(found.ok), ~held)
    sides = [np.asarray(closest(step)[1].cost) for step in (1e-5, -1e-5)]
    np.testing.assert_allclose(rate, (sides[0] - sides[1]) / 2e-5, rtol=1e-3, atol=1e-6)
    assert np.asarray(rate)[:3].min() > 1e-3
    # From the posture found and from random ones, no bounded solver comes closer.
    rng = np.random.default_rng(0)
    for row in range(3):
        one = jax.tree.map(lambda x, row=row: np.asarray(x[row]), target)

        def cost(q, one=one):
            tool = jaxik.forward_kinematics(ARM, q)
            turn = 0.5 * jnp.sum((tool.rotation - one.rotation) ** 2)
            return weights[0] * jnp.sum((tool.position - one.position) ** 2) + weights[1] * turn

        slope = jax.jit(jax.grad(cost))
        for start in [found.q[row], *(found.q[row] + rng.normal(0, 0.3, (3, 7)))]:
            best = minimize(
                jax.jit(cost),
                np.clip(start, ARM.lower, ARM.upper),
                jac=slope,
                method="SLSQP",
                bounds=list(zip(np.asarray(ARM.lower), np.asarray(ARM.upper), strict=True)),
                constraints={"type": "ineq", "fun": lambda q: distances(world, q)},
            )
            if distances(world, best.x) > -1e-8:
                assert best.fun > float(found.cost[row]) * (1 - 1e-5)
