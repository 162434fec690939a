"""From swivels and branches at a few waypoints to an initial guess for the refinement at all of them."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxik.ik import branch_bits
from jaxik.numerics import shortest
from jaxik.planning.problem import PlanningProblem
from jaxik.redundancy import SwivelArcs


class InitialGuess(NamedTuple):
    """Swivel and branch at every waypoint, and the arc the swivel may move in.

    Attributes:
        swivel: Swivels, ``(K,)`` [rad]; nan where the branch has no arc.
        branch: Branches, ``(K,)``.
        lower: Start of each arc, ``(K,)`` [rad]; -inf for a whole circle.
        upper: End of each arc, ``(K,)`` [rad].
    """

    swivel: Array
    branch: Array
    lower: Array
    upper: Array


def initial_guess(problem: PlanningProblem, swivel: Array, branch: Array, soft: Array | bool = False) -> InitialGuess:
    """Move swivels ``(K,)`` of branches ``(K,)`` into their nearest arcs, and keep the ends to what is pinned.

    On a closed path the last posture becomes the first. Where ``soft`` is true, swivels of branches without an arc are
    free.
    """
    for pin in problem.pins:
        branch = branch.at[pin.row].set(pin.branch)
    if problem.closed is not None:
        branch = branch.at[-1].set(branch[0])
        swivel = swivel.at[-1].set(_in_turn_of(swivel[0], swivel[-1]))
    guess = into_arcs(problem.arcs, swivel, branch)
    free = jnp.isnan(guess.swivel) & soft
    guess = InitialGuess(
        jnp.where(free, jnp.nan_to_num(swivel), guess.swivel),
        branch,
        jnp.where(free, -jnp.inf, guess.lower),
        jnp.where(free, jnp.inf, guess.upper),
    )
    for pin in problem.pins:
        at = _in_turn_of(pin.swivel, swivel[pin.row])
        begin, lower, upper = (x.at[pin.row].set(at) for x in (guess.swivel, guess.lower, guess.upper))
        guess = InitialGuess(begin, branch, lower, upper)
    if problem.closed is not None:
        turns = swivel[-1] - swivel[0]
        end = (x.at[-1].set(x[0] + turns) for x in (guess.swivel, guess.lower, guess.upper))
        begin, lower, upper = end
        guess = InitialGuess(begin, branch, lower, upper)
    return guess


def interpolate(
    problem: PlanningProblem, index: np.ndarray | Array, swivel: Array, branch: Array
) -> tuple[Array, Array]:
    """Return swivel and branch at every waypoint from those at ``index``, ascending, first and last included.

    Interpolates the arm-plane angle linearly along the shorter arc; it is continuous through a straight elbow, where
    the swivel jumps by pi. Where the branches differ, they change at the step that needs the smallest joint motion.
    """
    plane = jnp.interp(problem.time, problem.time[index], jnp.unwrap(swivel - _bent(branch, swivel)))
    steps = np.arange(len(problem.time) - 1)
    at = jnp.asarray(index)
    segment = jnp.searchsorted(at, steps.astype(at.dtype), side="right") - 1  # of every step to the next waypoint
    leaving, entering = branch[:-1][segment], branch[1:][segment]

    def posture(rows: slice, branches: Array) -> Array:
        few = problem.motion.at(np.arange(len(plane))[rows])
        return few.branch(branches).angles(plane[rows] + _bent(branches, plane))

    jump = posture(slice(1, None), entering) - posture(slice(None, -1), leaving)
    jump = jnp.max(jnp.abs(shortest(jump, problem.arm.turning[:, None])), axis=0)
    smallest = jax.ops.segment_min(jump, segment, len(index) - 1)[segment]
    change = jax.ops.segment_min(jnp.where(jump == smallest, steps, len(steps)), segment, len(index) - 1)[segment]
    branches = jnp.concatenate([branch[:1], jnp.where(steps >= change, entering, leaving)])
    return plane + _bent(branches, plane), branches


def interpolate_on_host(
    problem: PlanningProblem, index: np.ndarray, swivel: np.ndarray, branch: np.ndarray
) -> tuple[Array, Array]:
    """:func:`interpolate` for host arrays; almost free where the branch stays the same."""
    dtype = problem.time.dtype
    if (branch == branch[0]).all():
        times = np.asarray(problem.time)
        along = jnp.asarray(np.interp(times, times[index], np.unwrap(swivel)), dtype)
        return along, jnp.full(times.shape, branch[0])
    return interpolate(problem, index, jnp.asarray(swivel, dtype), jnp.asarray(branch))


def into_arcs(arcs: SwivelArcs, swivel: Array, branch: Array) -> InitialGuess:
    """Move each swivel into the nearest feasible arc of its branch, in its own turn."""
    margin = 64 * float(jnp.finfo(swivel.dtype).eps) ** 0.75  # the arcs' ends carry this much rounding
    start, end, valid = (
        jnp.take_along_axis(x, branch[:, None, None], 1)[:, 0] for x in (arcs.start, arcs.end, arcs.valid)
    )
    inset = jnp.minimum(margin, (end - start) / 2)
    turn = 2 * jnp.pi
    shift = turn * jnp.round((swivel[:, None] - (start + end) / 2) / turn)
    whole = end - start >= turn * (1 - 1e-9)
    low = jnp.where(whole, -jnp.inf, start + inset + shift)
    high = jnp.where(whole, jnp.inf, end - inset + shift)
    moved = jnp.clip(swivel[:, None], low, high)
    distance = jnp.where(valid, jnp.abs(moved - swivel[:, None]), jnp.inf)
    pick = jnp.argmin(distance, axis=1)[:, None]
    none = jnp.isinf(jnp.take_along_axis(distance, pick, 1)[:, 0])
    moved, low, high = (jnp.take_along_axis(x, pick, 1)[:, 0] for x in (moved, low, high))
    return InitialGuess(jnp.where(none, jnp.nan, moved), branch, low, high)


def _in_turn_of(swivel: Array, other: Array) -> Array:
    """A swivel with the full turns that bring it nearest to another."""
    return swivel + 2 * jnp.pi * jnp.round((other - swivel) / (2 * jnp.pi))


def _bent(branch: Array, like: Array) -> Array:
    """Angle between swivel and arm plane: half a turn where the elbow is bent to its other side."""
    return jnp.pi * jnp.asarray(branch_bits(branch).elbow, like.dtype)
