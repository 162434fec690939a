"""The best of the candidates, refined in joint space, as a motion that is differentiable in the problem."""

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from jaxik.numerics import unwrap
from jaxik.planning.initial_guess import InitialGuess
from jaxik.planning.postures.refinement import cost_in, held_ends, refine_postures
from jaxik.planning.postures.search import FoundPostures
from jaxik.planning.problem import PlanningProblem
from jaxik.planning.refinement import implicit_minimum
from jaxik.planning.status import PlanStatus
from jaxik.planning.swivel_motion import SwivelMotion, motion_status
from jaxik.planning.violation import violation, with_violation
from jaxik.redundancy import PostureCharts, error_and_columns, moving_ends, swivel_of


def refine_best_postures(problem: PlanningProblem, found: FoundPostures, iterations: int) -> SwivelMotion:
    """Refine every candidate and return the one that ends lowest, differentiable in the problem."""
    held = jax.lax.stop_gradient(problem)
    soft = ~jnp.all(held.arcs.ok)

    ends = jax.lax.map(lambda q: refine_postures(held, q, iterations, soft), jax.lax.stop_gradient(found.q))
    least = jnp.argmin(jnp.where(jnp.isfinite(ends.energy), ends.energy, jnp.inf))
    end = jax.tree.map(lambda x: x[least], ends)
    motion: Any = problem.motion
    newton = end.newton
    charts = end.charts._replace(arm=motion.arm, position=motion.position, directions=motion.directions)
    guess = InitialGuess(newton.x, newton.x, *moving_ends(charts, end.lower, end.upper))
    cost = cost_in(charts, problem, end.q, soft)._replace(scale=end.scale)
    x, q = implicit_minimum(cost, newton, guess)
    q = held_ends(problem, problem.in_ranges(q))
    total, approach = cost.energies(q)
    fits = _fits(problem, charts, q)
    feasible = problem.arcs.ok | fits
    connected = jnp.all(fits | ~problem.counted) & jnp.all(found.reached)
    status = motion_status(problem, q, feasible, connected, found.found)
    missed = jnp.where(status == PlanStatus.OK, 0.0, violation(problem, cost, x, q))
    parameter, branch = swivel_of(problem.arm, q)
    return SwivelMotion(
        swivel=unwrap(parameter[:, None], True)[:, 0],
        branch=branch,
        q=q,
        energy=jnp.where(status == PlanStatus.OK, total, with_violation(problem, total, missed)),
        approach_energy=approach,
        energy_before_refinement=problem.energy(held.arm, held.padded(found.q[least]), held.time),
        violation=missed,
        reached=found.reached,
        converged=end.done & jnp.isfinite(newton.value),
        feasible=feasible,
        status=status,
    )


def _fits(problem: PlanningProblem, charts: PostureCharts, q: Array) -> Array:
    """Test whether postures ``(K, joint)`` are on target and within limits and keep-out, ``(K,)``."""
    loose = float(jnp.finfo(q.dtype).eps) ** 0.5
    error, _ = error_and_columns(problem.arm, charts.position, charts.directions, q.T)
    return jnp.all(jnp.abs(error) <= loose, axis=0) & (charts.excess(q.T, q[:, 0]) <= max(1e-6, 0.1 * loose))
