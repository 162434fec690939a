"""Initial guesses for the refinement in joint space, from a global search or from redundancy parameters."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxik.numerics import compiled_sooner, unwrap
from jaxik.planning.candidates import CANDIDATES, worth_refining
from jaxik.planning.postures.lattice import PostureRoutes, posture_routes
from jaxik.planning.postures.refinement import onto_targets, refine_postures
from jaxik.planning.problem import PlanningProblem

_TRIAL_ITERATIONS = 24  # at the searched waypoints


class FoundPostures(NamedTuple):
    """Initial guesses for the refinement.

    Attributes:
        q: Joint angles on target, ``(CANDIDATES, K, joint)`` [rad]; nan where there are fewer candidates.
        found: True if the search found any motion, ``()``.
        reached: True for the searched waypoints that it reached, ``(n,)``.
    """

    q: Array
    found: Array
    reached: Array


def search_postures(problem: PlanningProblem, index: np.ndarray | Array) -> FoundPostures:
    """Search globally over the waypoints ``index`` and interpolate the best candidates between them.

    The last waypoint may be repeated.
    """
    return _between(problem, jnp.asarray(index), _candidates(problem.at(index)))


@compiled_sooner
def _candidates(problem: PlanningProblem) -> PostureRoutes:
    """The routes that cost least once refined at the waypoints searched."""
    problem = jax.lax.stop_gradient(problem)
    routes = posture_routes(problem)
    soft = ~jnp.all(problem.arcs.ok)

    def refined(q: Array) -> tuple[Array, Array]:
        end = refine_postures(problem, unwrap(q, problem.arm.turning), _TRIAL_ITERATIONS, soft)
        return end.energy, end.q

    cost, q = jax.lax.map(refined, routes.q)
    cost = jnp.where(jnp.isfinite(routes.cost) & jnp.isfinite(cost), cost, jnp.inf)
    pick, needless = worth_refining(cost)
    return PostureRoutes(jnp.where(needless[:, None, None], jnp.nan, q[pick]), cost[pick], routes.reached)


@compiled_sooner
def _between(problem: PlanningProblem, index: Array, routes: PostureRoutes) -> FoundPostures:
    held = jax.lax.stop_gradient(problem)

    def interpolated(q: Array) -> Array:
        along = jax.vmap(partial(jnp.interp, held.time, held.time[index]), 1, 1)(q)
        return onto_targets(held, along)

    return FoundPostures(jax.lax.map(interpolated, routes.q), jnp.any(jnp.isfinite(routes.cost)), routes.reached)


def compile_postures_search(problem: PlanningProblem, thinned: PlanningProblem) -> FoundPostures:
    """Begin to compile the search, and return the shapes of what it finds.

    Args:
        problem: The problem, or its shapes.
        thinned: The same at the waypoints that are searched.
    """
    _candidates.compile_ahead(thinned)
    shape: Any = jax.ShapeDtypeStruct
    q = CANDIDATES, len(problem.time), problem.arm.n_joints
    return FoundPostures(shape(q, problem.time.dtype), shape((), bool), shape((len(thinned.time),), bool))


def postures_from_guess(problem: PlanningProblem, parameter: ArrayLike, branch: ArrayLike) -> FoundPostures:
    """Return a guess, one parameter and branch per waypoint, in the place of a search's result."""
    return _alone(problem, jnp.asarray(parameter, problem.time.dtype), jnp.asarray(branch))


@compiled_sooner
def _alone(problem: PlanningProblem, parameter: Array, branch: Array) -> FoundPostures:
    held = jax.lax.stop_gradient(problem)
    q = held.motion.branch(jnp.broadcast_to(branch, parameter.shape)).angles(parameter).T
    q = onto_targets(held, unwrap(q, held.arm.turning))
    missing = (0, CANDIDATES - 1), (0, 0), (0, 0)
    return FoundPostures(jnp.pad(q[None], missing, constant_values=jnp.nan), jnp.asarray(True), jnp.ones(1, bool))
