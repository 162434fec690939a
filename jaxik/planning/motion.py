"""The least-energy motion along one path as one program of arrays: jit, vmap and derivatives included.

1. Problem: the self-motion of the targets and its feasible arcs.
2. Search: the cheapest routes through a lattice of swivels and branches at a few waypoints, each refined at these, and
   once more on a lattice five times finer about the best of them.
3. Initial guesses: the best candidates interpolated between those waypoints and moved into the feasible arcs.
4. Refinement: Newton's method on the swivels of all waypoints, each kept in its arc. The lowest is the motion.
5. One more Newton step, taken with derivatives: the implicit function theorem.
"""

from functools import partial
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int

from jaxik.arm import Arm, ArmModel, as_arm
from jaxik.energy import Energy
from jaxik.numerics import compiled_sooner
from jaxik.obstacles import World, in_world
from jaxik.planning.candidates import CANDIDATES, best_candidates
from jaxik.planning.closure import ends_of
from jaxik.planning.cost import PathCost
from jaxik.planning.initial_guess import in_arcs, initial_guess, interpolate
from jaxik.planning.lattice import Routes
from jaxik.planning.newton import Newton
from jaxik.planning.postures.motion import refine_best_postures
from jaxik.planning.postures.search import FoundPostures, compile_postures_search, postures_from_guess, search_postures
from jaxik.planning.problem import PlanningProblem, in_joint_space, make_problem
from jaxik.planning.refinement import ITERATIONS, implicit_minimum, refine
from jaxik.planning.status import PlanStatus
from jaxik.planning.swivel_motion import SwivelMotion, motion_status
from jaxik.planning.violation import violation, with_violation
from jaxik.targets import TargetLike, as_target


def least_energy_motion(
    arm: Arm | ArmModel,
    target: TargetLike,
    time: Float[ArrayLike, "waypoint"],
    *,
    energy: Energy | None = None,
    start: Float[ArrayLike, "joint"] | None = None,
    end: Float[ArrayLike, "joint"] | Literal["start"] | None = None,
    approach_time: Float[ArrayLike, ""] = 1.0,
    guess: tuple[Float[ArrayLike, "waypoint"], Int[ArrayLike, "*waypoint"]] | None = None,
    search: int = 64,
    iterations: int = ITERATIONS,
    pinned: bool = False,
    end_pinned: bool = False,
    world: World | None = None,
) -> SwivelMotion:
    """Return the least-energy motion of the elbow along a path: :func:`jaxik.plan` as a function of arrays.

    ``jax.vmap`` plans many paths in one call: of different lengths if the shorter ones repeat their last target and
    time at the end, which costs nothing. Bad values are reported by ``status``; nothing is raised for them.

    Args:
        arm: The arm.
        target: K targets, ``(K, ...)``.
        time: Increasing times, ``(K,)`` [s]; the last may be repeated.
        energy: Energy to minimize; None for :func:`jaxik.energy.joint_motion`.
        start: Posture the arm comes from, ``(joint,)`` [rad].
        end: Posture the arm goes on to, ``(joint,)`` [rad]; or "start" for a motion that can be repeated: with
            ``start`` the same posture; without, a closed path. Its last target is taken to be the first, and the last
            joint angles are exactly the first, which are free. The energy is that of one round: there is no step over
            the seam. Where the targets differ, or no motion returns, the status is NOT_CLOSED.
        approach_time: Time for the motion from ``start``, and for the one to ``end`` [s].
        guess: Swivels ``(K,)`` [rad] and branches, one or ``(K,)``, to refine in the place of a search.
        search: Number of waypoints that the global search sees. Steps of about 0.16 of the arm's length or 0.16 rad
            serve best: :func:`jaxik.searched_waypoints` gives the number for a path.
        iterations: Largest number of Newton steps; a few where an approximate minimum will do.
        pinned: True for a motion that begins with ``start`` itself, which has to be at the first target.
        end_pinned: True for a motion that ends with ``end`` itself, which has to be at the last target; with
            ``pinned`` and "start" the path is closed.
        world: Obstacles, for an arm with a body (:func:`jaxik.with_body`), which the waypoints keep clear of; batch
            axes ``(K,)`` are one world per waypoint.

    Returns:
        The motion.

    Raises:
        ValueError: Wrong shapes or dtypes.

    **Differentiability**: swivel, q and energy in target, time, start, end, energy and arm, by the implicit function
    theorem, where the optimum is regular and ``converged`` is true: the Hessian at it is positive and no bound is just
    about to hold or let go. Paths without a motion have finite energies and derivatives too, so that a descent on the
    energy, say in the place of the arm's base, leads back to paths that have one: see :class:`SwivelMotion`.
    """
    path = in_world(as_arm(arm, any_class=True), world), as_target(target), time, energy
    ends = ends_of(start, end)
    closed = ends.closed(pinned, end_pinned)
    options = {"search": search, "iterations": iterations, "pinned": pinned, "end_pinned": end_pinned}
    return _least_energy_motion(path, ends.start, ends.end, approach_time, guess, closed=closed, **options)


@partial(compiled_sooner, static_argnames=("search", "iterations", "pinned", "end_pinned", "closed"))
def _least_energy_motion(
    path: Any,
    start: Any,
    end: Any,
    approach_time: Any,
    guess: Any,
    *,
    search: int,
    iterations: int,
    **ends: bool,
) -> SwivelMotion:
    problem = make_problem(*path, start=start, end=end, approach_time=approach_time, **ends)
    found = search_motion(problem, search=search) if guess is None else from_guess(problem, *guess)
    return refine_best(problem, found, iterations=iterations)


class SearchResult(NamedTuple):
    """Initial guesses for the refinement.

    Attributes:
        swivel: Swivels, ``(CANDIDATES, K)`` [rad]; nan where there are fewer candidates.
        branch: Branches, ``(CANDIDATES, K)``.
        found: True if the search found any motion, ``()``.
        violation: Sum of what the motion misses targets, limits and keep-out by, ``(*batch,)``, in arm lengths and rad,
            and of relative excess speeds if every target can be reached; zero where the status is OK.
        reached: True for the searched waypoints that it reached, ``(n,)``.
    """

    swivel: Array
    branch: Array
    found: Array
    reached: Array


AnyFound = SearchResult | FoundPostures


def search_motion(problem: PlanningProblem, *, search: int) -> AnyFound:
    """Search globally over ``search`` evenly spaced waypoints."""
    return search_at(problem, evenly_spaced(problem.last, min(search, len(problem.time))))


def evenly_spaced(last: int | Array, number: int) -> Any:
    """Return waypoints from 0 to ``last``, ``(number,)``; if there are fewer, all of them, the last one repeated."""
    numpy: Any = np if isinstance(last, int) else jnp
    every = numpy.arange(number)
    spread = (2 * every * last + number - 1) // max(2 * (number - 1), 1)
    return numpy.where(last < number, numpy.minimum(every, last), spread)


def search_at(problem: PlanningProblem, index: np.ndarray | Array) -> AnyFound:
    """Search globally over the waypoints ``index`` and interpolate the best candidates between them.

    The last waypoint may be repeated. Which waypoints these are is no matter of compilation: only their number is.
    """
    if in_joint_space(problem.arm):
        return search_postures(problem, index)
    routes = _routes(problem.at(index))
    return _between(problem, jnp.asarray(index), routes)


@compiled_sooner
def _routes(problem: PlanningProblem) -> Routes:
    return best_candidates(jax.lax.stop_gradient(problem))


@compiled_sooner
def _between(problem: PlanningProblem, index: Array, routes: Routes) -> SearchResult:
    held = jax.lax.stop_gradient(problem)
    swivel, branch = jax.lax.map(lambda route: interpolate(held, index, *route), (routes.swivel, routes.branch))
    return SearchResult(swivel, branch, jnp.any(jnp.isfinite(routes.cost)), routes.reached)


def compile_search(problem: PlanningProblem, thinned: PlanningProblem) -> None:
    """Begin to compile the programs of :func:`search_at` and :func:`refine_best`.

    Args:
        problem: The problem, or its shapes.
        thinned: The same at the waypoints that are searched.
    """
    if in_joint_space(problem.arm):
        refine_best.compile_ahead(problem, compile_postures_search(problem, thinned))
        return
    _routes.compile_ahead(thinned)
    count, searched = len(problem.time), len(thinned.time)
    shape: Any = jax.ShapeDtypeStruct
    dtype, whole = problem.time.dtype, jnp.zeros(0, int).dtype
    rows = CANDIDATES, count
    found = SearchResult(shape(rows, dtype), shape(rows, whole), shape((), bool), shape((searched,), bool))
    refine_best.compile_ahead(problem, found)


def from_guess(problem: PlanningProblem, swivel: ArrayLike, branch: ArrayLike) -> AnyFound:
    """Return a guess, one swivel and branch per waypoint, in the place of a search's result.

    It is padded to ``CANDIDATES``, so that one program refines any number of them.
    """
    if in_joint_space(problem.arm):
        return postures_from_guess(problem, swivel, branch)
    return _alone(jnp.asarray(swivel, problem.time.dtype), jnp.asarray(branch))


@compiled_sooner
def _alone(swivel: Array, branch: Array) -> SearchResult:
    branch = jnp.broadcast_to(branch, swivel.shape)
    missing = (0, CANDIDATES - 1), (0, 0)
    return SearchResult(
        jnp.pad(swivel[None], missing, constant_values=jnp.nan),
        jnp.pad(branch[None], missing, mode="edge"),
        jnp.asarray(True),
        jnp.ones(1, bool),
    )


@partial(compiled_sooner, static_argnames="iterations")
def refine_best(problem: PlanningProblem, found: AnyFound, *, iterations: int = ITERATIONS) -> SwivelMotion:
    """Refine every candidate and return the one that ends lowest, differentiable in the problem."""
    if isinstance(found, FoundPostures):
        return refine_best_postures(problem, found, iterations)
    held = jax.lax.stop_gradient(problem)
    candidates = jax.lax.stop_gradient((found.swivel, found.branch))
    # Without a candidate that has an arc everywhere, what comes nearest to a motion is refined.
    soft = ~jnp.any(jax.vmap(partial(in_arcs, held))(*candidates))

    def end(start: tuple[Array, Array]) -> tuple[Array, Newton, PathCost]:
        refined = refine(held, *start, iterations, soft & jnp.any(jnp.isfinite(start[0])))
        return refined.energy, refined.newton, refined.cost._replace(problem=None, motion=None)

    values, *ends = jax.lax.map(end, candidates)
    least = jnp.argmin(jnp.where(jnp.isfinite(values), values, jnp.inf))
    newton, cost = jax.tree.map(lambda x: x[least], ends)
    guess = initial_guess(problem, found.swivel[least], found.branch[least], soft)
    cost = cost._replace(problem=problem, motion=problem.motion.branch(guess.branch))
    swivel, q = implicit_minimum(cost, newton, guess)
    q = problem.in_ranges(q)
    total, approach = cost.energies(q)
    feasible = problem.arcs.ok
    status = motion_status(problem, q, feasible, ~soft & jnp.all(found.reached), found.found)
    missed = jnp.where(status == PlanStatus.OK, 0.0, violation(problem, cost, swivel, q))
    return SwivelMotion(
        swivel=swivel,
        branch=guess.branch,
        q=q,
        energy=jnp.where(status == PlanStatus.OK, total, with_violation(problem, total, missed)),
        approach_energy=approach,
        energy_before_refinement=cost.begin[0],
        violation=missed,
        reached=found.reached,
        converged=newton.done,
        feasible=feasible,
        status=status,
    )
