"""The refinement in joint space: Newton's method in charts about the present postures, taken anew until it rests.

Within a round every waypoint moves along its self-motion by up to 0.3 rad, kept in its limits as in a box; so the
method, its cost and its steps are those of :mod:`jaxik.planning.refinement`. No branch bounds it: where two branches
meet, a posture passes from one to the other.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxik.planning.cost import PathCost, cost_from
from jaxik.planning.initial_guess import InitialGuess
from jaxik.planning.newton import Newton, newton_in_box
from jaxik.planning.problem import PlanningProblem
from jaxik.redundancy import PostureCharts, correction, feasible_coordinates, posture_charts

ITERATIONS = 120  # Newton steps at most, in all rounds
_ROUND = 8  # of them in one set of charts
_PROJECTIONS = 12  # of a guess onto its targets
_FAR = 0.3  # rad; longest step of a projection
_MOVED = 1e-3  # rad; charts that are left by no more than that end the refinement


class RefinedPostures(NamedTuple):
    """A local minimum, in charts about postures at it or close by.

    Attributes:
        charts: Charts.
        q: Joint angles at the minimum, ``(K, joint)`` [rad].
        newton: The last iterate, ``newton.x`` the coordinates.
        lower: Lower end of the coordinates, ``(K,)`` [rad].
        upper: Upper end, likewise.
        energy: Energy of the motion and its approaches, with the penalty on speeds, ``()``.
        scale: Energy of the initial guess, by which those of the iterates are divided, ``()``.
        rounds: Number of charts taken, ``()``.
        done: True at a local minimum, ``()``.
    """

    charts: PostureCharts
    q: Array
    newton: Newton
    lower: Array
    upper: Array
    energy: Array
    scale: Array
    rounds: Array
    done: Array


def onto_targets(problem: PlanningProblem, q: Array) -> Array:
    """Return postures ``(K, joint)`` moved onto their targets by least joint motions, and to what is pinned."""
    motion: Any = problem.motion
    arm, position, directions = motion.arm, motion.position, motion.directions

    def step(_: Array, q: Array) -> Array:
        move = correction(arm, position, directions, q)
        far = jnp.sqrt(jnp.sum(move**2, axis=0))
        return q + move * jnp.minimum(1.0, _FAR / jnp.maximum(far, _FAR))

    return held_ends(problem, lax.fori_loop(0, _PROJECTIONS, step, q.T).T)


def held_ends(problem: PlanningProblem, q: Array) -> Array:
    """Return postures ``(K, joint)`` that begin and end with what is pinned, or end as they begin where they return."""
    for pin in problem.pins:
        q = q.at[pin.row].set(_in_turn_of(problem, pin.q, q[pin.row]))
    q = problem.padded(q)
    if problem.closed is None:
        return q
    return jnp.where(problem.from_last()[:, None], _in_turn_of(problem, q[0], q[-1]), q)


def _in_turn_of(problem: PlanningProblem, q: Array, other: Array) -> Array:
    """A posture with the full turns of turning joints that bring it nearest to another."""
    turns = jnp.round((other - q) / (2 * jnp.pi))
    return q + 2 * jnp.pi * jnp.where(problem.arm.turning, turns, 0.0)


def refine_postures(
    problem: PlanningProblem, q: Array, iterations: int = ITERATIONS, soft: Array | bool = False
) -> RefinedPostures:
    """Descend from postures ``(K, joint)`` on target to the nearest local minimum within limits.

    Where ``soft`` is true, waypoints outside their limits come as near to these as they can.
    """
    scaled = cost_in(_charts(problem, q), problem, q, soft)

    def once(q: Array) -> RefinedPostures:
        charts = _charts(problem, held_ends(problem, q))
        guess, cost = coordinates(problem, charts, soft), scaled._replace(motion=charts)
        newton = newton_in_box(cost, guess.swivel, guess.lower, guess.upper, _ROUND)
        moved = jnp.max(jnp.abs(jnp.where(problem.counted, newton.x, 0.0)))
        done = ~jnp.isfinite(newton.value) | (newton.done & (moved < _MOVED))
        q = cost.joints(cost.swivels(newton.x))
        ends, value = (guess.lower, guess.upper), newton.value * cost.scale
        return RefinedPostures(charts._replace(arm=None), q, newton, *ends, value, cost.scale, jnp.int32(1), done)

    rounds = -(-iterations // _ROUND)
    blank = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), jax.eval_shape(once, q))

    def again(last: RefinedPostures) -> RefinedPostures:
        return once(last.q)._replace(rounds=last.rounds + 1)

    return lax.while_loop(lambda s: ~s.done & (s.rounds < rounds), again, blank._replace(q=q))


def cost_in(charts: PostureCharts, problem: PlanningProblem, q: Array, soft: Array | bool) -> PathCost:
    """Return the cost in charts, scaled so that it is one at postures ``(K, joint)``."""
    return cost_from(problem, charts, q, soft, None if problem.closed is None else jnp.zeros((), q.dtype))


def _charts(problem: PlanningProblem, q: Array) -> PostureCharts:
    motion: Any = problem.motion
    return posture_charts(motion.arm, motion.position, motion.directions, q.T)


def coordinates(problem: PlanningProblem, charts: PostureCharts, soft: Array | bool) -> InitialGuess:
    """Return the coordinates to begin with, nearest to zero, and the ends of those that are feasible."""
    lower, upper = feasible_coordinates(charts)
    none, middle = lower > upper, jnp.clip(0.5 * (lower + upper), -charts.widest, charts.widest)
    lower, upper = (
        jnp.where(none, jnp.where(soft, side * charts.widest, middle), end) for side, end in ((-1, lower), (1, upper))
    )
    # Pinned postures stay, and those that follow from another waypoint.
    stays = problem.from_last(following=1) if problem.closed is None else problem.from_last()
    for pin in problem.pins:
        stays = stays.at[pin.row].set(True)
    lower, upper = (jnp.where(stays, 0.0, x) for x in (lower, upper))
    begin = jnp.clip(0.0, lower, upper)
    return InitialGuess(begin, jnp.zeros(begin.shape, jnp.int32), lower, upper)
