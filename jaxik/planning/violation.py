"""Violation of a motion that is none: the sum of what targets, limits, keep-out and speeds are missed by."""

import jax
import jax.numpy as jnp
from jax import Array

from jaxik.kinematics import forward_kinematics
from jaxik.planning.cost import PathCost
from jaxik.planning.problem import PlanningProblem
from jaxik.targets import Pose

VIOLATION = 100.0  # of one arm length, radian or multiple of a speed limit: more than any shift of a path gains
_ROUNDING = 1e-12  # of a squared distance; what is closer is reached


def violation(problem: PlanningProblem, cost: PathCost, swivel: Array, q: Array) -> Array:
    """Return the violation of a motion ``(K, joint)`` in the branches of a cost, ``()``.

    The sum over the waypoints of the distance from the target [arm lengths and rad] and of the violations of limits
    [rad] and keep-out [arm lengths]. If every target can be reached, the joint speeds beyond their limits, relative to
    these, are added over the steps. Each enters by its size, not its square: it keeps its slope until it vanishes.
    """
    arm = problem.arm
    speed = jnp.abs(jnp.diff(q, axis=0)) / (arm.velocity_limit * problem.durations[:, None])
    fast = jnp.where(jnp.all(problem.arcs.ok), jnp.sum(jnp.maximum(speed - 1.0, 0.0)), 0.0)
    missed = _missed(problem, q) + cost.motion.excess(q.T, swivel)
    return jnp.sum(jnp.where(problem.counted, missed, 0.0)) + fast


def with_violation(problem: PlanningProblem, energy: Array, missed: Array) -> Array:
    """Return the energy of a motion that is none: S (tanh(energy / S) + ``VIOLATION`` * violation).

    S is the joint motion of one turn of every joint in the path's time. The energy of what jumps from waypoint to
    waypoint is large and says little, so that it is not let grow beyond S.
    """
    weights = problem.energy.motion_weights(problem.arm)
    size = (
        jnp.sum(jnp.where(jnp.max(weights) > 0, weights, 1.0))
        * (2 * jnp.pi) ** 2
        / (problem.time[-1] - problem.time[0])
    )
    size = jax.lax.stop_gradient(size)
    return size * (jnp.tanh(energy / size) + VIOLATION * missed)


def _missed(problem: PlanningProblem, q: Array) -> Array:
    """Distance of the tool from its targets, ``(K,)``, a turn as the difference of axes; 1 from what is no number."""
    target = problem.target
    if target is None:
        return jnp.zeros_like(q[:, 0])
    tool = forward_kinematics(problem.arm, q)
    if isinstance(target, Pose):
        turned = jnp.sum((tool.rotation - target.rotation) ** 2, axis=(-2, -1)) / 2
    else:
        length = jnp.sqrt(jnp.maximum(jnp.sum(target.direction**2, axis=-1, keepdims=True), _ROUNDING))
        turned = jnp.sum((tool.rotation[..., 2] - target.direction / length) ** 2, axis=-1)
    square = jnp.sum((tool.position - target.position) ** 2, axis=-1) / problem.arm.length**2 + turned
    known, far = jnp.isfinite(square), square > _ROUNDING
    # The root has no slope at zero, and none that is a number where the target is none.
    return jnp.where(known, jnp.where(far, jnp.sqrt(jnp.where(known & far, square, 1.0)), 0.0), 1.0)
