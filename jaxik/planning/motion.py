"""The least-energy motion along one path as one program of arrays: jit, vmap and derivatives included.

1. Chart: joint angles as functions of the swivel; arcs: where the swivel may be.
2. Search: the cheapest ways through a lattice of swivels and branches at a few waypoints, each polished at these.
3. Once more on a lattice drawn together about the way that ended lowest: five times finer, in all branches.
4. Course: the lowest ways' swivels between those waypoints, moved into the feasible arcs of their branch.
5. Polish: Newton's method on the swivels of all waypoints, each kept in its arc. The lowest is the motion.
6. One more Newton step, taken with derivatives: the implicit function theorem.
"""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from jaxik import energy as energies
from jaxik.arcs import SwivelArcs, swivel_arcs
from jaxik.arm import Arm
from jaxik.energy import Energy
from jaxik.planning.chart import Chart, make_chart
from jaxik.planning.cost import Ends, PathCost, approach_cost
from jaxik.planning.course import Course, interpolate, into_arcs
from jaxik.planning.lattice import Lattice, Routes, best_ways, make_lattice
from jaxik.planning.newton import Newton, held_by_box, newton_in_box, with_held
from jaxik.swivel import swivel_of
from jaxik.targets import Target

T = TypeVar("T")

ITERATIONS = 120  # `hello` takes about 20
STARTS = 4  # ways that are polished at all waypoints: few valleys are closer than what chords between a few leave out
_WIDTHS = (2 * np.pi, 2 * np.pi / 5)  # of the lattices [rad]; prices on the first are too coarse to tell valleys apart
_TRIAL_ITERATIONS = 25  # at the searched waypoints
_SAME = 1e-5  # relative; ways that end this close are taken for one
_HOPELESS = 1.3  # times the lowest way's cost; what chords leave out has been seen to be 15 %
_TIE_BREAK = 1e-6  # share of plain joint motion added in the search, for energies that no single step shows


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class SwivelMotion:
    """A motion along a path.

    Attributes:
        swivel: ``(K,)`` [rad], without jumps of a full turn; nan where the branch found has no feasible swivel.
        branch: ``(K,)``.
        q: ``(K, joint)`` [rad], without jumps of a full turn in joints that turn without end.
        energy: Energy of the motion, in the energy's unit, ``()``; infinite where the search found no way.
        approach: What coming from the start posture and going on to the end posture costs beside it, ``()``.
        searched: Energy before the polish, ``()``.
        open: Whether the search found a way to each searched waypoint, ``(n,)``.
        converged: Whether the polish ended at a minimum, ``()``.
        feasible: Whether the waypoint has a feasible swivel in any branch, ``(K,)``.
    """

    swivel: Float[Array, "*batch waypoint"]
    branch: Int[Array, "*batch waypoint"]
    q: Float[Array, "*batch waypoint joint"]
    energy: Float[Array, "*batch"]
    approach: Float[Array, "*batch"]
    searched: Float[Array, "*batch"]
    open: Bool[Array, "*batch searched"]
    converged: Bool[Array, "*batch"]
    feasible: Bool[Array, "*batch waypoint"]


@partial(jax.jit, static_argnames=("search", "pinned", "end_pinned"))
def least_energy_motion(
    arm: Arm,
    target: Target,
    time_s: Float[ArrayLike, "waypoint"],
    energy: Energy | None = None,
    start: Float[ArrayLike, "joint"] | None = None,
    approach_s: Float[ArrayLike, ""] = 1.0,
    *,
    end: Float[ArrayLike, "joint"] | None = None,
    search: int = 64,
    pinned: bool = False,
    end_pinned: bool = False,
) -> SwivelMotion:
    """The least-energy motion of the elbow along a path, as a function of arrays: what :func:`jaxik.plan` is made of.

    ``jax.vmap`` plans many paths in one call. Values say what is wrong, nothing is raised for them: see ``energy``.

    Args:
        arm: The arm.
        target: K targets, ``(K, ...)``.
        time_s: Increasing times, ``(K,)`` [s].
        energy: What to make small; None for :func:`jaxik.energy.joint_motion`.
        start: Posture the arm comes from, ``(joint,)`` [rad].
        approach_s: Time for that motion, and for the one to ``end`` [s].
        end: Posture the arm goes on to, ``(joint,)`` [rad].
        search: How many waypoints the global search looks at. Steps of about 0.1 of the arm's length or 0.1 rad serve
            best: see :mod:`jaxik.planning.lattice`.
        pinned: Whether the motion begins with ``start`` itself, which has to be at the first target.
        end_pinned: Whether it ends with ``end`` itself, which has to be at the last target.

    Returns:
        The motion.

    **Differentiability**: swivel, q and energy in target, time_s, start, end, energy and arm, by the implicit function
    theorem, where the optimum is regular and ``converged`` is true: the Hessian at it is positive and no bound is just
    about to hold or let go.
    """
    task = make_task(arm, target, time_s, energy, start, end, approach_s, pinned, end_pinned)
    return polished(task, searched(task, target, search=search))


class Task(NamedTuple):
    """What to plan, in arrays of one dtype.

    Attributes:
        arm: The arm.
        time_s: ``(K,)`` [s].
        energy: What to make small.
        ends: Postures before and behind the path.
        first: Swivel and branch that the motion has to begin with, if any.
        last: Those it has to end with, if any.
    """

    arm: Arm
    time_s: Array
    energy: Energy
    ends: Ends
    first: tuple[Array, Array] | None
    last: tuple[Array, Array] | None

    @property
    def turning(self) -> Array:
        """Which joints turn without end, ``(joint,)``."""
        return self.arm.upper - self.arm.lower >= 2 * jnp.pi * (1 - 1e-6)

    def pins(self) -> list[tuple[int, Array, Array, Array]]:
        """Row, posture, swivel and branch of what the motion has to begin and end with."""
        held = ((0, self.ends.start, self.first), (-1, self.ends.end, self.last))
        return [(row, q, *at) for row, q, at in held if q is not None and at is not None]


class Found(NamedTuple):
    """What a search found, and what it was found in.

    Attributes:
        chart: Joint angles as functions of the swivel.
        arcs: Feasible swivels, ``(K, ...)``.
        swivel: Where the polish is to begin, ``(STARTS, K)`` [rad]; nan where there is nothing to begin with.
        branch: ``(STARTS, K)``.
        there: Whether the search found a way at all, ``()``.
        open: Whether any way leads to each searched waypoint, ``(n,)``.
    """

    chart: Chart
    arcs: SwivelArcs
    swivel: Array
    branch: Array
    there: Array
    open: Array


def make_task(
    arm: Arm,
    target: Target,
    time_s: ArrayLike,
    energy: Energy | None,
    start: ArrayLike | None,
    end: ArrayLike | None,
    approach_s: ArrayLike,
    pinned: bool,
    end_pinned: bool,
) -> Task:
    """The task of :func:`least_energy_motion`'s arguments, in the dtype of the target."""
    dtype = target.position.dtype
    arm = arm.astype(dtype)
    before, behind = (None if x is None else jnp.asarray(x, dtype) for x in (start, end))
    ends = Ends(before, behind, jnp.asarray(approach_s, dtype))
    first = swivel_of(arm, ends.start) if pinned and ends.start is not None else None
    last = swivel_of(arm, ends.end) if end_pinned and ends.end is not None else None
    energy = energies.joint_motion() if energy is None else energy
    return Task(arm, jnp.asarray(time_s, dtype), energy, ends, first, last)


@partial(jax.jit, static_argnames="search")
def searched(task: Task, target: Target, *, search: int) -> Found:
    """The global search over ``search`` waypoints, and its way filled in between them."""
    chart, arcs = make_chart(task.arm, target), swivel_arcs(task.arm, target)
    count = task.time_s.shape[0]
    index = np.unique(np.linspace(0, count - 1, min(search, count)).round().astype(int))
    held, chart_held, arcs_held = jax.lax.stop_gradient((task, chart, arcs))
    few = held._replace(time_s=held.time_s[index]), chart_held.at(index), jax.tree.map(lambda x: x[index], arcs_held)
    ways = _best_ways(*few)
    fill = lambda way: interpolate(held.arm, chart_held, held.time_s, index, *way, held.turning)  # noqa: E731
    swivel, branch = jax.lax.map(fill, (ways.swivel, ways.branch))
    return Found(chart, arcs, swivel, branch, jnp.any(jnp.isfinite(ways.cost)), ways.open)


def _best_ways(task: Task, chart: Chart, arcs: SwivelArcs) -> Routes:
    """The ``STARTS`` ways over a few waypoints, all that is given, that cost least once polished there."""

    def tried(start: tuple[Array, Array]) -> tuple[Array, Array]:
        course = _pinned_course(task, arcs, *start)
        cost = _cost(task, chart, course)
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
    anywhere = jnp.broadcast_to(jnp.asarray([[0.0], [jnp.pi]], task.time_s.dtype), (2, len(task.time_s)))
    _, ways = jax.lax.scan(look, anywhere, jnp.asarray(_WIDTHS, anywhere.dtype))
    swivel, branch, cost = (x.reshape(-1, *x.shape[2:]) for x in ways[:3])
    order = jnp.argsort(cost)
    swivel, branch, cost = swivel[order], branch[order], cost[order]
    idle = (jnp.diff(cost, prepend=-jnp.inf) <= _SAME * jnp.abs(cost)) | ~(cost <= _HOPELESS * cost[0])
    pick = jnp.argsort(idle, stable=True)[:STARTS]
    return Routes(jnp.where(idle[pick, None], jnp.nan, swivel[pick]), branch[pick], cost[pick], ways.open[0])


def _cost(task: Task, chart: Chart, course: Course) -> PathCost:
    """What swivels in the course's branches cost, scaled by what its own do."""
    one = jnp.ones((), course.swivel.dtype)
    cost = PathCost(task.arm, chart, task.energy, task.time_s, task.ends, course.branch, task.turning, one)
    scale = jnp.maximum(sum(cost.spent(cost.joints(course.swivel))), 1e-12)
    return cost._replace(scale=jax.lax.stop_gradient(scale))


def _pinned_course(task: Task, arcs: SwivelArcs, swivel: Array, branch: Array) -> Course:
    """Where the polish begins and what it keeps to, with what the motion has to begin and end with."""
    pins = task.pins()
    for row, _, _, pinned in pins:
        branch = branch.at[row].set(pinned)
    course = into_arcs(arcs, swivel, branch)
    begin, lower, upper = course.swivel, course.lower, course.upper
    for row, _, held, _ in pins:
        at = held + 2 * jnp.pi * jnp.round((swivel[row] - held) / (2 * jnp.pi))
        begin, lower, upper = (x.at[row].set(at) for x in (begin, lower, upper))
    return Course(begin, branch, lower, upper)


@jax.jit
def guessed(task: Task, target: Target, swivel: Array, branch: Array) -> Found:
    """A motion from elsewhere, one swivel and branch for each waypoint, in place of a search."""
    chart, arcs = make_chart(task.arm, target), swivel_arcs(task.arm, target)
    return Found(chart, arcs, *as_starts(swivel, branch), jnp.asarray(True), jnp.ones(1, bool))


def as_starts(swivel: Array, branch: Array) -> tuple[Array, Array]:
    """One start ``(K,)`` as ``STARTS``, so that no further program is compiled for it."""
    none = jnp.full((STARTS - 1, len(swivel)), jnp.nan, swivel.dtype)
    return jnp.concatenate([swivel[None], none]), jnp.broadcast_to(branch, (STARTS, len(branch)))


@jax.jit
def polished(task: Task, found: Found) -> SwivelMotion:
    """The least-energy motion near what was found: of all starts, the one that ends lowest."""
    hold = jax.lax.stop_gradient
    still, chart, arcs = hold((task, found.chart, found.arcs))

    def end(start: tuple[Array, Array]) -> tuple[Array, Newton]:
        course = _pinned_course(still, arcs, *start)
        cost = _cost(still, chart, course)
        newton = newton_in_box(cost, course.swivel, course.lower, course.upper, ITERATIONS)
        return newton.value * cost.scale, newton

    values, ends = jax.lax.map(end, hold((found.swivel, found.branch)))
    least = jnp.argmin(jnp.where(jnp.isfinite(values), values, jnp.inf))
    course = _pinned_course(task, found.arcs, found.swivel[least], found.branch[least])
    cost = _cost(task, found.chart, course)
    best = _implicit(cost, jax.tree.map(lambda x: x[least], ends), course.lower, course.upper)
    q = cost.joints(best)
    total, approach = cost.spent(q)
    there = found.there & jnp.all(jnp.isfinite(course.swivel))
    return SwivelMotion(
        swivel=best,
        branch=course.branch,
        q=q,
        energy=jnp.where(there, total, jnp.inf),
        approach=approach,
        searched=jnp.where(there, cost.spent(cost.joints(course.swivel))[0], jnp.inf),
        open=found.open,
        converged=ends.done[least],
        feasible=jnp.any(found.arcs.valid, axis=(-2, -1)),
    )


def _search(task: Task, chart: Chart, arcs: SwivelArcs, center: Array, width: Array) -> Routes:
    """The cheapest ways through the lattice about a center."""
    arm, energy, turning = task.arm, task.energy, task.turning
    # Single precision: the search is memory-bound, and its cells are a million times coarser than rounding.
    lattice = make_lattice(*_single((arm, chart, arcs, center, width)))
    for row, *pin in task.pins():
        lattice = _pinned(lattice, row, *_single(tuple(pin)))
    weight = energy.motion_weight(arm)
    weight = weight + _TIE_BREAK * jnp.where(jnp.max(weight) == 0, 1.0, jnp.max(weight))
    time_s = task.time_s
    q = jnp.moveaxis(lattice.q, 0, -1).astype(time_s.dtype)
    node = energies.node_weights(time_s) * energy.rest_rate(arm, q)
    for row, posture in ((0, task.ends.start), (-1, task.ends.end)):
        coming = approach_cost(posture, q[..., row, :], energy.motion_weight(arm), task.ends.seconds, turning)
        node = node.at[..., row].add(coming)
    torque = None if energy.separable else jnp.moveaxis(energy.rest_torque(arm, q), -1, 0)
    routes = best_ways(lattice, *_single((node, torque, jnp.diff(time_s), weight, arm.velocity_limit)), turning)
    return routes._replace(swivel=routes.swivel.astype(time_s.dtype))


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


def _implicit(cost: PathCost, end: Newton, lower: Array, upper: Array) -> Array:
    """The minimum as a function of what the cost and the box depend on: one Newton step with derivatives.

    What the box holds moves with its bound; the rest follows so that the gradient stays zero.
    """
    hold = jax.lax.stop_gradient
    held = hold(held_by_box(end.x, end.gradient, lower, upper))
    bound = jnp.where(hold(end.x <= lower), lower, upper)
    x = jnp.where(held, jnp.where(jnp.isfinite(bound), bound, end.x), end.x)
    gradient = cost.gradient(x)
    step = with_held(hold(end.hessian), held).solve(jnp.where(held, 0.0, gradient))
    return x - jnp.where(end.done & jnp.all(jnp.isfinite(step)), step - hold(step), 0.0)
