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
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from jaxik.arm import Arm
from jaxik.energy import Energy
from jaxik.planning.candidates import STARTS, least_ways
from jaxik.planning.chart import Chart, make_chart
from jaxik.planning.cost import PathCost
from jaxik.planning.initial_guess import interpolate
from jaxik.planning.newton import Newton, held_by_box, newton_in_box, with_held
from jaxik.planning.task import Task, cost_of, make_task, pinned_course
from jaxik.redundancy import SwivelArcs, swivel_arcs
from jaxik.targets import Target

ITERATIONS = 120  # `hello` takes about 20


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
    time: Float[ArrayLike, "waypoint"],
    energy: Energy | None = None,
    start: Float[ArrayLike, "joint"] | None = None,
    approach_time: Float[ArrayLike, ""] = 1.0,
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
        time: Increasing times, ``(K,)`` [s].
        energy: What to make small; None for :func:`jaxik.energy.joint_motion`.
        start: Posture the arm comes from, ``(joint,)`` [rad].
        approach_time: Time for that motion, and for the one to ``end`` [s].
        end: Posture the arm goes on to, ``(joint,)`` [rad].
        search: How many waypoints the global search looks at. Steps of about 0.16 of the arm's length or 0.16 rad serve
            best: see :mod:`jaxik.planning.lattice`.
        pinned: Whether the motion begins with ``start`` itself, which has to be at the first target.
        end_pinned: Whether it ends with ``end`` itself, which has to be at the last target.

    Returns:
        The motion.

    **Differentiability**: swivel, q and energy in target, time, start, end, energy and arm, by the implicit function
    theorem, where the optimum is regular and ``converged`` is true: the Hessian at it is positive and no bound is just
    about to hold or let go.
    """
    task = make_task(arm, target, time, energy, start, end, approach_time, pinned, end_pinned)
    return polished(task, searched(task, target, search=search))


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

    def starting(self, swivel: Array, branch: Array) -> "Found":
        """With other starts ``(n, K)``, up to ``STARTS``: the same program polishes any number of them."""
        missing = (0, STARTS - len(swivel)), (0, 0)
        return self._replace(
            swivel=jnp.pad(swivel, missing, constant_values=jnp.nan), branch=jnp.pad(branch, missing, mode="edge")
        )


@partial(jax.jit, static_argnames="search")
def searched(task: Task, target: Target, *, search: int) -> Found:
    """The global search over ``search`` waypoints, and its way filled in between them."""
    chart, arcs = make_chart(task.arm, target), swivel_arcs(task.arm, target)
    count = task.time.shape[0]
    index = np.unique(np.linspace(0, count - 1, min(search, count)).round().astype(int))
    held, chart_held, arcs_held = jax.lax.stop_gradient((task, chart, arcs))
    few = held._replace(time=held.time[index]), chart_held.at(index), jax.tree.map(lambda x: x[index], arcs_held)
    ways = least_ways(*few)
    fill = lambda way: interpolate(held.arm, chart_held, held.time, index, way[0], way[1], held.turning)  # noqa: E731
    swivel, branch = jax.lax.map(fill, (ways.swivel, ways.branch))
    return Found(chart, arcs, swivel, branch, jnp.any(jnp.isfinite(ways.cost)), ways.open)


@jax.jit
def guessed(task: Task, target: Target, swivel: Array, branch: Array) -> Found:
    """A motion from elsewhere, one swivel and branch for each waypoint, in place of a search."""
    chart, arcs = make_chart(task.arm, target), swivel_arcs(task.arm, target)
    nowhere = Found(chart, arcs, swivel, branch, jnp.asarray(True), jnp.ones(1, bool))
    return nowhere.starting(swivel[None], branch[None])


@jax.jit
def polished(task: Task, found: Found) -> SwivelMotion:
    """The least-energy motion near what was found: of all starts, the one that ends lowest."""
    hold = jax.lax.stop_gradient
    still, chart, arcs = hold((task, found.chart, found.arcs))

    def end(start: tuple[Array, Array]) -> tuple[Array, Newton]:
        course = pinned_course(still, arcs, *start)
        cost = cost_of(still, chart, course)
        newton = newton_in_box(cost, course.swivel, course.lower, course.upper, ITERATIONS)
        return newton.value * cost.scale, newton

    values, ends = jax.lax.map(end, hold((found.swivel, found.branch)))
    least = jnp.argmin(jnp.where(jnp.isfinite(values), values, jnp.inf))
    course = pinned_course(task, found.arcs, found.swivel[least], found.branch[least])
    cost = cost_of(task, found.chart, course)
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
