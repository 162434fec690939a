"""Candidates worth a refinement: found on lattices of a few waypoints, ranked by a refinement at these."""

from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxik import energy as energies
from jaxik.numerics import principal
from jaxik.planning.cost import approach_energy
from jaxik.planning.lattice import Lattice, Routes, best_routes, make_lattice, whole_circle
from jaxik.planning.problem import Pin, PlanningProblem
from jaxik.planning.refinement import refine

T = TypeVar("T")

CANDIDATES = 4  # refined at all waypoints: few local minima differ by less than chords between a few waypoints hide
_WIDTHS = (2 * np.pi, 2 * np.pi / 5)  # of the lattices [rad]; costs on the first are too coarse to tell basins apart
_TRIAL_ITERATIONS = 25  # at the searched waypoints
_SAME = 1e-5  # relative; candidates that end this close count as one
_HOPELESS = 0.3  # of the lowest candidate's cost above it; chords have been seen to hide 15 %
_BLOCKED = 1e2  # rad²; cost of a violation of limits by one radian, where one of some size cannot be helped
_TIE_BREAK = 1e-6  # share of plain joint motion added in the search, for energies that no single step shows


def best_candidates(problem: PlanningProblem) -> Routes:
    """Return the ``CANDIDATES`` routes through all waypoints of a thinned problem that cost least once refined there.

    The second lattice lies about the best route of the first: many arms bend the elbow to its other side in the same
    place, at the same swivel.
    """
    blocked = ~problem.arcs.ok

    def refined(start: tuple[Array, Array]) -> tuple[Array, Array]:
        end = refine(problem, *start, _TRIAL_ITERATIONS, soft=blocked.any())
        return end.energy, end.swivel

    def search(center: Array, width: Array) -> tuple[Array, Routes]:
        routes = _routes(problem, center, width)
        values, swivel = jax.lax.map(refined, (routes.swivel, routes.branch))
        values = jnp.where(jnp.isfinite(routes.cost) & jnp.isfinite(values), values, jnp.inf)
        best = jnp.argmin(values)
        center = jnp.where(jnp.isfinite(values[best]), swivel[best], center)
        return center, Routes(swivel, routes.branch, values, routes.reached)

    anywhere = whole_circle(problem.arm, problem.time)
    _, found = jax.lax.scan(search, anywhere, jnp.asarray(_WIDTHS, anywhere.dtype))
    swivel, branch, cost = (x.reshape(-1, *x.shape[2:]) for x in found[:3])
    pick, needless = worth_refining(cost)
    swivel = jnp.where(needless[:, None], jnp.nan, swivel[pick])
    return Routes(swivel, branch[pick], cost[pick], found.reached[0])


def worth_refining(cost: Array) -> tuple[Array, Array]:
    """Return the ``CANDIDATES`` of routes whose costs ``(routes,)`` differ and are least, and which are needless."""
    order = jnp.argsort(cost)
    cost = cost[order]
    same = jnp.diff(cost, prepend=-jnp.inf) <= _SAME * jnp.abs(cost)
    needless = same | ~(cost - cost[0] <= _HOPELESS * jnp.abs(cost[0]))
    needless = needless.at[0].set(False)  # without a motion the first one is the least bad
    pick = jnp.argsort(needless, stable=True)[:CANDIDATES]
    return order[pick], needless[pick]


def _routes(problem: PlanningProblem, center: Array, width: Array) -> Routes:
    """The cheapest routes through the lattice about a center."""
    arm, energy, time = problem.arm, problem.energy, problem.time
    # Single precision: the search is memory-bound, and its cells are a million times coarser than rounding.
    lattice = make_lattice(*_single((problem.motion, problem.arcs, center, width)))
    for pin in problem.pins:
        lattice = _pinned(lattice, pin)
    weights = energy.motion_weights(arm)
    weights = weights + _TIE_BREAK * jnp.where(jnp.max(weights) == 0, 1.0, jnp.max(weights))
    q = jnp.moveaxis(lattice.q, 0, -1).astype(time.dtype)
    node = energies.node_weights(time) * energy.rest_rate(arm, q)
    # A waypoint that no posture reaches within its limits is passed where these are least violated.
    blocked = ~problem.arcs.ok
    lattice = lattice._replace(allowed=lattice.allowed | blocked)
    outside = jnp.where(arm.turning, 0.0, jnp.maximum(jnp.maximum(arm.lower - q, q - arm.upper), 0.0))
    per_excess = _BLOCKED * jnp.max(weights) / jnp.min(problem.durations, initial=jnp.inf)
    node = node + jnp.where(blocked, per_excess, 0.0) * jnp.sum(outside, axis=-1)
    for row, end in problem.end_postures:
        coming = approach_energy(end, q[..., row, :], energy.motion_weights(arm), problem)
        node = node.at[..., row].add(coming)
    torque = None if energy.separable else jnp.moveaxis(energy.rest_torque(arm, q), -1, 0)
    costs = _single((node, torque, problem.durations, weights, arm.velocity_limit))
    routes = best_routes(lattice, *costs, arm.turning, closed=problem.closed is not None)
    return routes._replace(swivel=routes.swivel.astype(time.dtype))


def _single(tree: T) -> T:
    return jax.tree.map(lambda x: x.astype(jnp.float32) if jnp.issubdtype(x.dtype, jnp.floating) else x, tree)


def _pinned(lattice: Lattice, pin: Pin) -> Lattice:
    """Leave the first or last waypoint one state."""
    row, q, swivel, branch = pin.row, *_single((pin.q, pin.swivel)), pin.branch
    cell = jnp.argmin(jnp.abs(principal(swivel - lattice.swivel[branch, :, row])))
    return Lattice(
        lattice.swivel.at[branch, cell, row].set(swivel),
        lattice.q.at[:, branch, cell, row].set(q),
        lattice.allowed.at[..., row].set(False).at[branch, cell, row].set(True),
    )
