"""The search against brute force, and the small pieces around it."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
from jaxik.planning.continuity import unwrap
from jaxik.planning.initial_guess import into_arcs
from jaxik.planning.search import best_route


def brute_force(q, node, dt, weight, limit, turning):
    """Every route through the layers, in plain loops."""
    best = (np.inf, None)
    for route in itertools.product(range(q.shape[2]), repeat=q.shape[0]):
        cost = sum(node[k, s] for k, s in enumerate(route))
        for k, (a, b) in enumerate(itertools.pairwise(route)):
            step = q[k + 1, :, b] - q[k, :, a]
            step = np.where(turning, (step + np.pi) % (2 * np.pi) - np.pi, step)
            if (np.abs(step) > limit * dt[k]).any():
                cost = np.inf
            cost += (weight * step**2).sum() / dt[k]
        best = min(best, (cost, route), key=lambda entry: entry[0])
    return best


@pytest.mark.parametrize("seed", range(6))
def test_the_route_is_the_best_of_all_routes(seed):
    rng = np.random.default_rng(seed)
    q = rng.uniform(-np.pi, np.pi, (5, 3, 4))
    node = np.where(rng.uniform(size=(5, 4)) < 0.2, np.inf, rng.uniform(size=(5, 4)))
    dt, weight = rng.uniform(0.5, 1.5, 4), rng.uniform(0.1, 2, 3)
    limit, turning = np.array([6.0, 5.0, 4.0]), (True, False, False)
    cost, states = brute_force(q, node, dt, weight, limit, np.array(turning))
    route = best_route(*map(jnp.asarray, (q, node, dt, weight, limit)), turning=turning)
    np.testing.assert_allclose(route.cost, cost, rtol=1e-12)
    if np.isfinite(cost):
        assert tuple(np.asarray(route.state)) == states
        assert np.asarray(route.open).all()


def test_a_cut_is_found_where_it_is():
    q = jnp.zeros((6, 1, 3)).at[3:].set(2.0)  # a step of 2 rad after the third waypoint
    args = q, jnp.zeros((6, 3)), jnp.ones(5), jnp.ones(1), jnp.ones(1)
    route = best_route(*args, turning=(False,))
    assert np.isinf(route.cost)
    np.testing.assert_array_equal(route.open, [True, True, True, False, False, False])


def test_many_paths_at_once_give_the_same_routes():
    rng = np.random.default_rng(9)
    q, node = jnp.asarray(rng.normal(size=(3, 5, 2, 6))), jnp.asarray(rng.uniform(size=(3, 5, 6)))
    shared = jnp.ones(4), jnp.ones(2), 99.0 * jnp.ones(2)
    one = lambda q, node: best_route(q, node, *shared, turning=(False, False))  # noqa: E731
    together = jax.vmap(one)(q, node)
    for i in range(3):
        np.testing.assert_array_equal(together.state[i], one(q[i], node[i]).state)


def test_turning_joints_are_unwound_and_others_left():
    q = jnp.asarray([[3.0, 3.0], [-3.0, -3.0], [3.1, 3.1]])
    out = unwrap(q, (True, False))
    np.testing.assert_allclose(out[:, 0], [3.0, 2 * np.pi - 3.0, 3.1])
    np.testing.assert_array_equal(out[:, 1], q[:, 1])


def test_swivels_move_into_the_nearest_arc_of_their_own_turn():
    start = jnp.array([[0.0, 2.0], [0.0, 0.0], [-np.pi, 0.0], [0.0, 0.0], [2.5, 0.0]])[:, None]
    end = jnp.array([[1.0, 3.0], [1.0, 0.0], [np.pi, 0.0], [0.0, 0.0], [4.0, 0.0]])[:, None]
    valid = jnp.array([[True, True], [True, False], [True, False], [False, False], [True, False]])[:, None]
    arcs = jaxik.SwivelArcs(start, end, valid)
    course = into_arcs(arcs, jnp.array([1.8, 2 * np.pi + 0.5, 9.0, 0.0, -2.5]), jnp.zeros(5, int))
    nan, some = np.nan, jnp.array([0, 1, 2, 4])
    np.testing.assert_allclose(course.swivel, [2.0, 2 * np.pi + 0.5, 9.0, nan, -2.5], atol=1e-9)
    np.testing.assert_allclose(course.lower[some], [2.0, 2 * np.pi, -np.inf, 2.5 - 2 * np.pi], atol=1e-9)
    np.testing.assert_allclose(course.upper[some], [3.0, 2 * np.pi + 1, np.inf, 4 - 2 * np.pi], atol=1e-9)
