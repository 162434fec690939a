"""Inverse kinematics by refinement, batch last: sixteen slots at an angle of the outer joint.

1. The nearest member of a class is solved in closed form at the same angle, its branches kept apart: eight seeds.
2. Newton's method brings them onto the arm, with the outer joint held.
3. Every solution has a partner across its nearest fold, which the same method finds: eight more.
4. Duplicates are marked, and the solutions sorted into slots by the bits of their own postures.
5. Residual, status and derivatives are the arm's: the derivative is that of the implicit function.
"""

import jax
import jax.numpy as jnp
from jax import Array

from jaxik.arm import RefinedArm, fit_to_limits, within_limits
from jaxik.ik.arm_constants import arm_constants
from jaxik.ik.branches import branch_number
from jaxik.ik.refined_branches import RefinedBranches
from jaxik.ik.refined_seeds import refined_seeds
from jaxik.ik.refinement import converged_within, damped_step, least_pivot, miss, partners, refined, with_held
from jaxik.ik.status import Status
from jaxik.ik.target_checks import replace_bad_rows
from jaxik.kinematics import carry_axes
from jaxik.numerics import (
    fused_separately,
    merge_leading,
    principal,
    sincos_apart,
    tolerances,
    vec3,
    with_value,
    wrap,
)


def refined_form(arm: RefinedArm, position: Array, directions: Array, parameter: Array) -> RefinedBranches:
    """Return all slots of targets of one float dtype: ``(3, n)``, ``(3, 3, n)`` and ``(n,)``."""
    if directions.shape[1] == 1:
        raise ValueError(
            f"a {arm.kinematic_class} arm is not solved for pointing targets, whose roll is free: expected a "
            "jaxik.Pose, got a Pointing"
        )
    target = replace_bad_rows(arm, position, directions, parameter)
    fixed, found = jax.lax.stop_gradient((arm, target))
    # Farther than a thousand arm lengths is out of reach all the same, and its square would leave single precision.
    far = 1e3 * fixed.length
    where = jnp.clip(found.position, -far, far)[:, None], found.directions[:, :, None]
    q = principal(_solutions(fixed, refined_seeds(fixed.member, found), *where))
    converged, least = _judged(fixed, q, *where)
    distinct = converged & ~_repeated(q, converged)
    source = _sources(refined_bits(fixed, q), distinct)
    q = jnp.take_along_axis(q, source[None], axis=1)
    converged, distinct, least = (jnp.take_along_axis(x, source, axis=0) for x in (converged, distinct, least))
    moving = jnp.where(
        distinct, _implicit(arm, q, target.position[:, None], target.directions[:, :, None], target.swivel), q
    )
    q = _fitted(fixed, with_value(moving, q))
    elbow = carry_axes(fixed, *sincos_apart(jax.lax.stop_gradient(q)), fixed.tool_rotation[:, :0])[0][:, 3]
    status = _statuses(fixed, q, elbow, converged, distinct, least, found.invalid, found.nonfinite)
    return RefinedBranches(jnp.moveaxis(q, 1, 0), status, least)


def _solutions(arm: RefinedArm, seeds: Array, position: Array, rotation: Array) -> Array:
    """The solutions that seeds ``(8, 7, n)`` lead to, and the partners of these, ``(7, 16, n)``."""
    n = seeds.shape[-1]
    columns = tuple(
        jnp.broadcast_to(x, (*x.shape[:-2], 8, n)).reshape(*x.shape[:-2], 8 * n) for x in (position, rotation)
    )

    def stage(seeds: Array, _: None) -> tuple[Array, Array]:
        q = refined(arm, seeds, *columns)
        return partners(arm, q, *columns), q

    # Both stages are one program: it takes half the time to compile.
    _, found = jax.lax.scan(stage, jnp.moveaxis(seeds, 1, 0).reshape(7, 8 * n), None, length=2)
    return jnp.moveaxis(found.reshape(2, 7, 8, n), 1, 0).reshape(7, 16, n)


def _judged(arm: RefinedArm, q: Array, position: Array, rotation: Array) -> tuple[Array, Array]:
    """Mask of slots with the tool on its target, and the least pivot of the Jacobian, ``(16, n)`` each."""
    now = miss(arm, q, position, rotation)
    return _on_target(now.twist), least_pivot(now.jacobian)


@fused_separately
def _fitted(arm: RefinedArm, q: Array) -> Array:
    rows = tuple(joint for joint in range(7) for _ in range(q.shape[1]))
    return fit_to_limits(arm, rows, merge_leading(wrap(q), 1)).reshape(q.shape)


def refined_bits(arm: RefinedArm, q: Array) -> Array:
    """Return the branch number of joint angles ``(7, ..., n)``, from the signs that tell apart the member's branches.

    They are those of an arm with an outer joint, of the arm's own posture: the middle angle of the spherical joint, the
    elbow, and the side of the line from the point on axis 3 to that on axis 5 that the two meeting axes turn to.
    """
    g = arm_constants(arm.member)
    points, _, axes = carry_axes(arm, *sincos_apart(principal(q)), arm.tool_rotation[:, :0])
    line = points[:, 4] - points[:, 2]
    far, near = (5, 4) if arm.outer_joint else (2, 1)
    root = vec3.dot(line, vec3.cross(axes[:, far], axes[:, near])) < 0.0
    left = jnp.sin(q[3] - g.straight) < 0.0
    middle, delta = (q[1], g.shoulder_delta) if arm.outer_joint else (q[5], g.wrist_delta)
    spherical = jnp.sin(middle + delta) < 0.0
    return branch_number(*(spherical, left, root) if arm.outer_joint else (root, left, spherical))


@fused_separately
def _on_target(twist: Array) -> Array:
    return jnp.max(jnp.abs(twist), axis=0) <= converged_within(twist.dtype)


@fused_separately
def _repeated(q: Array, converged: Array) -> Array:
    """Solutions that repeat an earlier one, ``(16, n)``: closer than two solutions that Newton tells apart."""
    least = 8.0 * tolerances(q.dtype).near_singular
    repeated = jnp.zeros_like(converged)
    for i in range(q.shape[1] - 1):
        apart = jnp.max(jnp.abs(principal(q[:, i + 1 :] - q[:, i : i + 1])), axis=0)
        same = (apart < least) & converged[i] & converged[i + 1 :]
        repeated = repeated | jnp.concatenate([jnp.zeros_like(converged[: i + 1]), same])
    return repeated & converged


@fused_separately
def _sources(branch: Array, distinct: Array) -> Array:
    """The solution that each slot takes, ``(16, n)``: every solution goes to one slot.

    Two of the same branch have slots of their own; more of them, then what is no solution, fill the others in order.
    """
    count, branch = branch.shape[0], branch.astype(jnp.int32)
    number = jnp.arange(count, dtype=branch.dtype)[:, None]
    before = (number < number.T)[:, :, None]
    # Pairs are (earlier, later).
    rank = jnp.sum(before & distinct[:, None] & (branch[:, None] == branch[None]), axis=0, dtype=branch.dtype)
    own = distinct & (rank < 2)
    slot = jnp.where(own, branch + 8 * rank, -1)
    taken = jnp.any(slot[None] == number[:, None], axis=1)
    extra, rest = distinct & ~own, ~distinct
    extras = _before(extra), jnp.sum(extra, axis=0, dtype=branch.dtype) + _before(rest)
    queue = jnp.where(extra, *extras)
    vacancy = _before(~taken)
    fills = ~own[None] & ~taken[:, None] & (vacancy[:, None] == queue[None])
    takes = fills | (slot[None] == number[:, None])
    return jnp.sum(jnp.where(takes, number[None], 0), axis=1, dtype=branch.dtype)


def _before(mask: Array) -> Array:
    """Number of earlier entries that are set."""
    return jnp.cumsum(mask, axis=0, dtype=jnp.int32) - mask.astype(jnp.int32)


def _implicit(arm: RefinedArm, q: Array, position: Array, rotation: Array, parameter: Array) -> Array:
    """The same angles, with the derivative that keeps the tool on its target and the outer joint at the parameter."""
    hold = jax.lax.stop_gradient
    held = (
        with_held(arm, jnp.zeros_like(q[:6]))
        + jnp.stack(
            [
                parameter - hold(parameter) if joint == arm.outer_joint else jnp.zeros_like(parameter)
                for joint in range(7)
            ]
        )[:, None]
    )
    off = miss(arm, q + held, position, rotation).twist
    jacobian = hold(miss(*hold((arm, q, position, rotation))).jacobian)
    floor = jnp.full_like(off[0], 30.0 * float(jnp.finfo(q.dtype).eps))
    change = damped_step(jacobian, off, floor)
    # Once more for what the normal equations lose near a fold.
    left = off - sum(jacobian[:, i] * change[i] for i in range(6))
    return q + held + with_held(arm, change + damped_step(jacobian, left, floor))


@fused_separately
def _statuses(
    arm: RefinedArm, q: Array, elbow: Array, converged: Array, distinct: Array, least: Array, invalid: Array, bad: Array
) -> Array:
    tol = tolerances(q.dtype)
    rows = tuple(joint for joint in range(7) for _ in range(q.shape[1]))
    inside = jnp.all(within_limits(arm, rows, merge_leading(q, 1)).reshape(q.shape), axis=0)
    status = jnp.zeros(least.shape, jnp.int32)
    conditions = [
        (least < tol.near_singular, Status.NEAR_SINGULAR),
        (~inside, Status.LIMITS),
        (~converged, Status.UNSOLVED),
        (converged & ~distinct, Status.DUPLICATE),
        (invalid, Status.INVALID_TARGET),
        (bad, Status.NONFINITE_INPUT),
    ]
    if arm.keep_out.offset.shape[0]:
        past = jnp.tensordot(arm.keep_out.normal, elbow, axes=1) - arm.keep_out.offset[:, None, None]
        conditions.insert(2, (jnp.any(past > tol.singular * arm.length, axis=0), Status.KEEP_OUT))
    for condition, reason in conditions:
        status = jnp.where(condition, jnp.int32(reason), status)
    return status
