"""From swivels and branches at a few waypoints to an initial guess for the refinement at all of them."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxik.ik import branch_bits
from jaxik.numerics import compiled_sooner, shortest
from jaxik.planning.padding import padded, padded_size
from jaxik.planning.problem import PlanningProblem
from jaxik.redundancy import SwivelArcs, has_swivel


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
    swivel, branch = problem.padded(swivel), problem.padded(branch)
    if problem.closed is not None:
        end = problem.from_last()
        branch = jnp.where(end, branch[0], branch)
        swivel = jnp.where(end, _in_turn_of(swivel[0], swivel[-1]), swivel)
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
    # Swivels that follow from another one stay: behind the last waypoint, and on a closed path at it.
    if problem.closed is not None:
        begin, stays = jnp.where(end, guess.swivel[0] + swivel[-1] - swivel[0], guess.swivel), end
    else:
        begin, stays = problem.padded(guess.swivel), problem.from_last(following=1)
    return InitialGuess(begin, branch, jnp.where(stays, begin, guess.lower), jnp.where(stays, begin, guess.upper))


def in_arcs(problem: PlanningProblem, swivel: Array, branch: Array) -> Array:
    """Test whether every waypoint has an arc in its branch of ``(K,)``, and there are swivels, ``()``.

    Ends that are pinned, or follow from another, need none of their own.
    """
    branch = problem.padded(branch)
    some = jnp.any(jnp.take_along_axis(problem.arcs.valid, branch[:, None, None], 1), axis=(1, 2))
    for pin in problem.pins:
        some = some.at[pin.row].set(True)
    if problem.closed is not None:
        some = some.at[problem.last].set(True)
    return jnp.all(some | problem.from_last(following=1)) & jnp.all(jnp.isfinite(problem.padded(swivel)))


def interpolate(
    problem: PlanningProblem, index: np.ndarray | Array, swivel: Array, branch: Array
) -> tuple[Array, Array]:
    """Return swivel and branch at every waypoint from those at ``index``, ascending, first and last included.

    The last may be repeated.

    Interpolates the arm-plane angle linearly along the shorter arc; it is continuous through a straight elbow, where
    the swivel jumps by pi. Where the branches differ, they change at the step that needs the smallest joint motion.
    """
    bent = _bent if has_swivel(problem.arm) else _same
    plane = jnp.interp(problem.time, problem.time[index], jnp.unwrap(swivel - bent(branch, swivel)))
    steps = np.arange(len(problem.time) - 1)
    at = jnp.asarray(index)
    segment = jnp.searchsorted(at, steps.astype(at.dtype), side="right") - 1  # of every step to the next waypoint
    segment = jnp.minimum(segment, len(index) - 2)  # behind the last
    leaving, entering = branch[:-1][segment], branch[1:][segment]

    # Both ends of every step by one program.
    rows, branches = np.concatenate([steps, steps + 1]), jnp.concatenate([leaving, entering])
    q = problem.motion.at(rows).branch(branches).angles(plane[rows] + bent(branches, plane))
    jump = q[:, len(steps) :] - q[:, : len(steps)]
    jump = jnp.max(jnp.abs(shortest(jump, problem.arm.turning[:, None])), axis=0)
    smallest = jax.ops.segment_min(jump, segment, len(index) - 1)[segment]
    change = jax.ops.segment_min(jnp.where(jump == smallest, steps, len(steps)), segment, len(index) - 1)[segment]
    branches = jnp.concatenate([branch[:1], jnp.where(steps >= change, entering, leaving)])
    return plane + bent(branches, plane), branches


def interpolate_on_host(
    problem: PlanningProblem, index: np.ndarray, swivel: np.ndarray, branch: np.ndarray
) -> tuple[Array, Array]:
    """:func:`interpolate` for host arrays; almost free where the branch stays the same."""
    dtype = problem.time.dtype
    if (branch == branch[0]).all():
        times = np.asarray(problem.time)
        along = jnp.asarray(np.interp(times, times[index], np.unwrap(swivel)), dtype)
        return along, jnp.asarray(np.full(times.shape, branch[0]))
    size = padded_size(len(index))
    index, swivel, branch = padded((index, swivel.astype(dtype), branch), size)
    return _interpolated(problem, index, swivel, branch)


_interpolated = compiled_sooner(interpolate)


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


def _same(branch: Array, like: Array) -> Array:
    """The same for an outer joint, which stays where it is when the elbow changes sides."""
    del branch
    return jnp.zeros((), like.dtype)


def _bent(branch: Array, like: Array) -> Array:
    """Angle between swivel and arm plane: half a turn where the elbow is bent to its other side."""
    return jnp.pi * jnp.asarray(branch_bits(branch).elbow, like.dtype)
