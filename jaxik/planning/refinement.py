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
        newton: The last iterate, ``newton.x`` its swivels ``(K,)`` [rad].
    """

    guess: InitialGuess
    cost: PathCost
    newton: Newton

    @property
    def energy(self) -> Array:
        """Energy of the motion and its approaches, with the penalty on speeds, ``()``; nan where there is no arc."""
        return self.newton.value * self.cost.scale


def refine(problem: PlanningProblem, swivel: Array, branch: Array, iterations: int = ITERATIONS) -> Refined:
    """Descend from swivels and branches ``(K,)`` to the nearest local minimum within the feasible arcs."""
    guess = initial_guess(problem, swivel, branch)
    cost = path_cost(problem, guess.branch, guess.swivel)
    return Refined(guess, cost, newton_in_box(cost, guess.swivel, guess.lower, guess.upper, iterations))


def implicit_minimum(cost: PathCost, end: Newton, guess: InitialGuess) -> Array:
    """Return the minimum as a function of what cost and arcs depend on: one Newton step with derivatives.

    Swivels held at the end of an arc move with it; the rest follows so that the gradient stays zero.
    """
    hold = jax.lax.stop_gradient
    held = hold(held_by_box(end.x, end.gradient, guess.lower, guess.upper))
    bound = jnp.where(hold(end.x <= guess.lower), guess.lower, guess.upper)
    x = jnp.where(held, jnp.where(jnp.isfinite(bound), bound, end.x), end.x)
    gradient = cost.gradient(x)
    step = with_held(hold(end.hessian), held).solve(jnp.where(held, 0.0, gradient))
    return x - jnp.where(end.done & jnp.all(jnp.isfinite(step)), step - hold(step), 0.0)
