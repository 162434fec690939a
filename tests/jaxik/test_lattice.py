"""The search on lattices against brute force, and the small pieces around it."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
from jaxik.numerics import unwrap
from jaxik.planning.initial_guess import into_arcs
from jaxik.planning.lattice import KINDS, SWIVELS, Lattice, best_routes

WAYPOINTS, JOINTS = 4, 3


def random_lattice(seed, allowed_share=0.5):
    """A lattice of random postures in random states; few are allowed, so that every route can be tried."""
    rng = np.random.default_rng(seed)
    shape = (8, SWIVELS, WAYPOINTS)
    q = rng.uniform(-np.pi, np.pi, (JOINTS, *shape))
    # States in a few branches and neighboring cells, so that most steps of the lattice lead from one to another.
    allowed = np.zeros(shape, bool)
    allowed[np.ix_([0, 1, 2, 4, 5], [0, 1, 2, SWIVELS - 1])] = rng.uniform(size=(5, 4, WAYPOINTS)) < allowed_share
    node = rng.uniform(size=shape)
    torque = rng.normal(size=(JOINTS, *shape))
    return rng, q, allowed, node, torque


def connected(a, b):
    """Test whether the lattice has a step from state a = (branch, cell) to state b."""
    shift = (b[1] - a[1] + SWIVELS // 2) % SWIVELS - SWIVELS // 2
    return any(a[0] ^ b[0] == bit and abs(shift) <= reach for bit, reach in KINDS)


def brute_force(q, allowed, node, torque, dt, weight, limit, turning):
    """Least cost into every last state, in plain loops over every route."""
    states = [[tuple(s) for s in np.argwhere(allowed[..., k])] for k in range(WAYPOINTS)]
    best = {}
    for route in itertools.product(*states):
        cost = sum(node[(*s, k)] for k, s in enumerate(route))
        for k, (a, b) in enumerate(itertools.pairwise(route)):
            step = q[(slice(None), *b, k + 1)] - q[(slice(None), *a, k)]
            step = np.where(turning, (step + np.pi) % (2 * np.pi) - np.pi, step)
            if not connected(a, b) or (np.abs(step) > limit * dt[k]).any():
                cost = np.inf
                break
            work = (torque[(slice(None), *a, k)] + torque[(slice(None), *b, k + 1)]) / 2 * step
            cost += (weight * step**2).sum() / dt[k] + np.maximum(work, 0).sum()
        best[route[-1]] = min(best.get(route[-1], np.inf), cost)
    return best


@pytest.mark.parametrize("seed", range(6))
def test_the_routes_are_the_best_of_all_routes(seed):
    rng, q, allowed, node, torque = random_lattice(seed)
    dt, weight = rng.uniform(0.5, 1.5, WAYPOINTS - 1), rng.uniform(0.1, 2, JOINTS)
    limit, turning = np.array([6.0, 5.0, 4.0]), np.array([True, False, False])
    best = brute_force(q, allowed, node, torque, dt, weight, limit, turning)
    swivel = np.broadcast_to(np.arange(float(SWIVELS))[:, None], allowed.shape)  # names the cell
    lattice = Lattice(*map(jnp.asarray, (swivel, q, allowed)))
    routes = best_routes(lattice, *map(jnp.asarray, (node, torque, dt, weight, limit, turning)))
    ends = [(int(b), int(c)) for b, c in zip(routes.branch[:, -1], routes.swivel[:, -1], strict=True)]
    expected = [best.get(end, np.inf) for end in ends]
    np.testing.assert_allclose(routes.cost, expected, rtol=1e-12)
    assert min(best.values()) == pytest.approx(float(routes.cost.min()), rel=1e-12)
    assert np.isfinite(expected).any()
    for cost, swivels, branches in zip(routes.cost, np.asarray(routes.swivel), np.asarray(routes.branch), strict=True):
        if np.isfinite(cost):  # and the states given make that cost
            route = list(zip(branches.tolist(), swivels.astype(int).tolist(), strict=True))
            only = np.zeros_like(allowed)
            for k, state in enumerate(route):
                only[(*state, k)] = True
            assert brute_force(q, only, node, torque, dt, weight, limit, turning)[route[-1]] == pytest.approx(cost)


def test_a_cut_is_found_where_it_is():
    _, _, allowed, node, _ = random_lattice(0, 1.0)
    q = np.zeros((1, *allowed.shape))
    q[..., 2:] = 2.0  # a step of 2 rad after the second waypoint
    lattice = Lattice(jnp.zeros(allowed.shape), jnp.asarray(q), jnp.asarray(allowed))
    one = jnp.ones(1)
    routes = best_routes(lattice, jnp.asarray(node), None, jnp.ones(WAYPOINTS - 1), one, one, jnp.zeros(1, bool))
    assert np.isinf(routes.cost).all()
    np.testing.assert_array_equal(routes.reached, [True, True, False, False])


def test_many_lattices_at_once_give_the_same_routes():
    lattices = [random_lattice(seed) for seed in (7, 8, 9)]
    q, allowed, node = (jnp.asarray(np.stack([entry[i] for entry in lattices])) for i in (1, 2, 3))
    swivel = jnp.zeros(allowed.shape[1:])
    shared = None, jnp.ones(WAYPOINTS - 1), jnp.ones(JOINTS), 99.0 * jnp.ones(JOINTS), jnp.zeros(JOINTS, bool)
    one = lambda q, allowed, node: best_routes(Lattice(swivel, q, allowed), node, *shared)  # noqa: E731
    together = jax.vmap(one)(q, allowed, node)
    for i in range(3):
        alone = one(q[i], allowed[i], node[i])
        np.testing.assert_array_equal(together.branch[i], alone.branch)
        np.testing.assert_allclose(together.cost[i], alone.cost, rtol=1e-12)


def test_turning_joints_are_unwound_and_others_left():
    q = jnp.asarray([[3.0, 3.0], [-3.0, -3.0], [3.1, 3.1]])
    out = unwrap(q, jnp.array([True, False]))
    np.testing.assert_allclose(out[:, 0], [3.0, 2 * np.pi - 3.0, 3.1])
    np.testing.assert_array_equal(out[:, 1], q[:, 1])


def test_swivels_move_into_the_nearest_arc_of_their_own_turn():
    start = jnp.array([[0.0, 2.0], [0.0, 0.0], [-np.pi, 0.0], [0.0, 0.0], [2.5, 0.0]])[:, None]
    end = jnp.array([[1.0, 3.0], [1.0, 0.0], [np.pi, 0.0], [0.0, 0.0], [4.0, 0.0]])[:, None]
    valid = jnp.array([[True, True], [True, False], [True, False], [False, False], [True, False]])[:, None]
    arcs = jaxik.SwivelArcs(start, end, valid, jnp.zeros(5, jnp.int32))
    guess = into_arcs(arcs, jnp.array([1.8, 2 * np.pi + 0.5, 9.0, 0.0, -2.5]), jnp.zeros(5, int))
    nan, some = np.nan, jnp.array([0, 1, 2, 4])
    np.testing.assert_allclose(guess.swivel, [2.0, 2 * np.pi + 0.5, 9.0, nan, -2.5], atol=1e-9)
    np.testing.assert_allclose(guess.lower[some], [2.0, 2 * np.pi, -np.inf, 2.5 - 2 * np.pi], atol=1e-9)
    np.testing.assert_allclose(guess.upper[some], [3.0, 2 * np.pi + 1, np.inf, 4 - 2 * np.pi], atol=1e-9)
