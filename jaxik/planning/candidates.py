"""The ways worth a polish: found through lattices of a few waypoints, told apart by a polish at these."""

from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxik import energy as energies
from jaxik.planning.chart import Chart
from jaxik.planning.cost import approach_cost
from jaxik.planning.lattice import Lattice, Routes, best_ways, make_lattice
from jaxik.planning.newton import newton_in_box
from jaxik.planning.task import Task, cost_of, pinned_course
from jaxik.redundancy import SwivelArcs

T = TypeVar("T")

STARTS = 4  # ways that are polished at all waypoints: few valleys are closer than what chords between a few leave out
_WIDTHS = (2 * np.pi, 2 * np.pi / 5)  # of the lattices [rad]; prices on the first are too coarse to tell valleys apart
_TRIAL_ITERATIONS = 25  # at the searched waypoints
_SAME = 1e-5  # relative; ways that end this close are taken for one
_HOPELESS = 0.3  # of the lowest way's cost beyond it; what chords leave out has been seen to be 15 %
_TIE_BREAK = 1e-6  # share of plain joint motion added in the search, for energies that no single step shows


def least_ways(task: Task, chart: Chart, arcs: SwivelArcs) -> Routes:
    """The ``STARTS`` ways over a few waypoints, all that is given, that cost least once polished there."""

    def tried(start: tuple[Array, Array]) -> tuple[Array, Array]:
        course = pinned_course(task, arcs, *start)
        cost = cost_of(task, chart, course)
        end = newton_in_box(cost, course.swivel, course.lower, course.upper, _TRIAL_ITERATIONS)
        return end.value * cost.scale, end.x

    def look(center: Array, width: Array) -> tuple[Array, Routes]:
        routes = _search(task, chart, arcs, center, width)
        values, swivel = jax.lax.map(tried, (routes.swivel, routes.branch))
        values = jnp.where(jnp.isfinite(routes.cost) & jnp.isfinite(values), values, jnp.inf)
        best = jnp.argmin(values)
        # Many arms bend the elbow to its other side in the same place, at the same swivel.
        center = jnp.where(jnp.isfinite(values[best]), swivel[best], center)
        return center, Routes(swivel, routes.branch, values, routes.open)

    # Through a straight elbow it is the arm plane that goes on evenly: half a turn of swivel.
    anywhere = jnp.broadcast_to(jnp.asarray([[0.0], [jnp.pi]], task.time.dtype), (2, len(task.time)))
    _, ways = jax.lax.scan(look, anywhere, jnp.asarray(_WIDTHS, anywhere.dtype))
    swivel, branch, cost = (x.reshape(-1, *x.shape[2:]) for x in ways[:3])
    order = jnp.argsort(cost)
    swivel, branch, cost = swivel[order], branch[order], cost[order]
    idle = (jnp.diff(cost, prepend=-jnp.inf) <= _SAME * jnp.abs(cost)) | ~(
        cost - cost[0] <= _HOPELESS * jnp.abs(cost[0])
    )
    pick = jnp.argsort(idle, stable=True)[:STARTS]
    return Routes(jnp.where(idle[pick, None], jnp.nan, swivel[pick]), branch[pick], cost[pick], ways.open[0])


def _search(task: Task, chart: Chart, arcs: SwivelArcs, center: Array, width: Array) -> Routes:
    """The cheapest ways through the lattice about a center."""
    arm, energy, turning = task.arm, task.energy, task.turning
    # Single precision: the search is memory-bound, and its cells are a million times coarser than rounding.
    lattice = make_lattice(*_single((arm, chart, arcs, center, width)))
    for row, *pin in task.pins():
        lattice = _pinned(lattice, row, *_single(tuple(pin)))
    weight = energy.motion_weight(arm)
    weight = weight + _TIE_BREAK * jnp.where(jnp.max(weight) == 0, 1.0, jnp.max(weight))
    time = task.time
    q = jnp.moveaxis(lattice.q, 0, -1).astype(time.dtype)
    node = energies.node_weights(time) * energy.rest_rate(arm, q)
    for row, posture in ((0, task.ends.start), (-1, task.ends.end)):
        coming = approach_cost(posture, q[..., row, :], energy.motion_weight(arm), task.ends.seconds, turning)
        node = node.at[..., row].add(coming)
    torque = None if energy.separable else jnp.moveaxis(energy.rest_torque(arm, q), -1, 0)
    routes = best_ways(lattice, *_single((node, torque, jnp.diff(time), weight, arm.velocity_limit)), turning)
    return routes._replace(swivel=routes.swivel.astype(time.dtype))


def _single(tree: T) -> T:
    return jax.tree.map(lambda x: x.astype(jnp.float32) if jnp.issubdtype(x.dtype, jnp.floating) else x, tree)


def _pinned(lattice: Lattice, row: int, q: Array, swivel: Array, branch: Array) -> Lattice:
    """The lattice whose first or last waypoint has one state."""
    off = swivel - lattice.swivel[branch, :, row]
    cell = jnp.argmin(jnp.abs(off - 2 * jnp.pi * jnp.round(off / (2 * jnp.pi))))
    return Lattice(
        lattice.swivel.at[branch, cell, row].set(swivel),
        lattice.q.at[:, branch, cell, row].set(q),
        lattice.allowed.at[..., row].set(False).at[branch, cell, row].set(True),
    )
