"""The refinement: Newton's method on the swivels of all waypoints, each kept in its arc.

The one place from which plans, baselines, candidates, proofs and the fast planner's repair descend to a local minimum.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxik.planning.cost import PathCost, path_cost
from jaxik.planning.initial_guess import InitialGuess, initial_guess
from jaxik.planning.newton import Newton, held_by_box, newton_in_box, with_held
from jaxik.planning.problem import PlanningProblem

ITERATIONS = 120  # `hello` takes about 20


class Refined(NamedTuple):
    """The end of a refinement.

    Attributes:
        guess: The initial guess, its branches and arcs.
        cost: The objective.
        newton: The last iterate, ``newton.x`` its variables.
    """

    guess: InitialGuess
    cost: PathCost
    newton: Newton

    @property
    def swivel(self) -> Array:
        """Swivels at the end, ``(K,)`` [rad]."""
        return self.cost.swivels(self.newton.x)

    @property
    def energy(self) -> Array:
        """Energy of the motion and its approaches, with the penalty on speeds, ``()``; nan where there is no arc."""
        return self.newton.value * self.cost.scale


def refine(
    problem: PlanningProblem,
    swivel: Array,
    branch: Array,
    iterations: int = ITERATIONS,
    soft: Array | bool = False,
) -> Refined:
    """Descend from swivels and branches ``(K,)`` to the nearest local minimum within the feasible arcs.

    Where ``soft`` is true, waypoints without an arc in their branch come as near to their limits as they can.
    """
    guess = initial_guess(problem, swivel, branch, soft)
    cost = path_cost(problem, guess.branch, guess.swivel, soft)
    return Refined(guess, cost, newton_in_box(cost, guess.swivel, guess.lower, guess.upper, iterations))


def implicit_minimum(cost: PathCost, end: Newton, guess: InitialGuess) -> tuple[Array, Array]:
    """Return the minimum as a function of what cost and arcs depend on: one Newton step with derivatives.

    Returns swivels ``(K,)`` and joint angles ``(K, joint)`` [rad]. Swivels held at the end of an arc move with it;
    the rest follows so that the gradient stays zero.
    """
    hold = jax.lax.stop_gradient
    lower, upper = guess.lower, guess.upper
    held = hold(held_by_box(end.x, end.gradient, lower, upper))
    bound = jnp.where(hold(end.x <= lower), lower, upper)
    x = jnp.where(held, jnp.where(jnp.isfinite(bound), bound, end.x), end.x)
    q, first = cost.slopes(x)
    gradient = cost.gradient(q, first)
    system = with_held(hold(end.hessian), held)
    regular = end.done & jnp.all(jnp.isfinite(hold(system.solve(jnp.where(held, 0.0, gradient)))))
    # Reverse mode solves with the system even where its result is discarded: it must be one that can be solved.
    step = with_held(system, held | ~regular).solve(jnp.where(held | ~regular, 0.0, gradient))
    step = step - hold(step)  # zero, with a derivative: joint angles follow along their slopes
    moved = step if cost.winding is None else jnp.where(cost.problem.from_last(), step[0], step)
    return cost.swivels(x - step), cost.problem.padded(q - hold(first) * moved[:, None])
