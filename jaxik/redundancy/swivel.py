"""The swivel of a posture, and the swivel that turns the elbow toward a point or a direction."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int

from jaxik.arm import Arm, ArmModel, OuterJointArm, RefinedArm, as_arm
from jaxik.ik import (
    ArmConstants,
    arm_constants,
    bend,
    branch_number,
    into_plane,
    refined_bits,
    replace_bad_rows,
    target_columns,
    usable_circle,
    wrist_and_hand,
)
from jaxik.numerics import arctan2, principal, sincos, to_batch_first, to_batch_last, tolerances, vec3, wrap
from jaxik.redundancy.outer_joint_branch import parameter_and_branch
from jaxik.targets import Target, TargetLike, as_array, as_floats, as_target, batch_shape, check_joints, check_target


class SwivelBranch(NamedTuple):
    """The redundancy parameter of postures and the branch they are in.

    Attributes:
        swivel: Swivels, ``(*batch,)`` [rad] in (-pi, pi].
        branch: Branches, ``(*batch,)``, 0 to 7.
    """

    swivel: Float[Array, "*batch"]
    branch: Int[Array, "*batch"]


def swivel_of(arm: Arm | ArmModel, q: Float[ArrayLike, "*batch joint"]) -> SwivelBranch:
    """Return redundancy parameter and branch of joint angles: :func:`solve_ik` returns them at it in that branch.

    The parameter is the swivel; of an arm with an outer joint (:class:`jaxik.OuterJointArm`) or solved by refinement
    (:class:`jaxik.RefinedArm`) it is this joint's angle. Of the latter a second solution may have the same branch:
    it is then in slot ``branch + 8``.

    Args:
        arm: The arm.
        q: Joint angles, ``(*batch, n_joints)`` [rad].

    Returns:
        Swivel and branch, which unpack as a pair. Where a bit has no meaning (a shoulder or wrist aligned, the elbow
        straight, two roots that meet) it is 0.

    Raises:
        ValueError: If the last axis of ``q`` is not the arm's number of joints.

    **Differentiability**: the swivel in ``q`` and the arm; finite everywhere, and that of a reference carried along
    without spin where the wrist lies on the reference's singular line.

    References:
        The paper's eq. (37) solved for t; K. Kreutz-Delgado et al., "Kinematic analysis of 7-DOF manipulators", 1992.
    """
    return _swivel_of_rows(as_arm(arm, any_class=True), as_array("q", q))


def swivel_toward(
    arm: Arm | ArmModel,
    target: TargetLike,
    point: Float[ArrayLike, "*batch 3"] | None = None,
    *,
    direction: Float[ArrayLike, "*batch 3"] | None = None,
) -> Float[Array, "*batch"]:
    """Return the swivel that turns the elbow toward a point or a direction.

    The elbow's place on its circle is the one nearest to the point, or farthest along the direction: what natural
    elbows, and elbows recorded from other arms, ask for. The limits are left aside.

    Args:
        arm: The arm.
        target: A :class:`Pose` or :class:`Pointing` with leading batch axes, as for :func:`solve_ik`.
        point: Point in the base frame, ``(*batch, 3)`` [m], broadcast against the target.
        direction: Direction in the base frame instead, ``(*batch, 3)``, of any length but zero.

    Returns:
        Swivels, ``(*batch,)`` [rad] in (-pi, pi]; 0 where the point or direction lies on the shoulder-wrist line.

    Raises:
        ValueError: Wrong shapes, or not exactly one of point and direction.

    **Differentiability**: in target, point, direction and arm where the swivel is determined, zero elsewhere.
    """
    if (point is None) == (direction is None):
        raise ValueError("swivel_toward needs a point or direction=, and not both")
    arm, target = as_arm(arm), as_target(target)
    if direction is None:
        return _swivel_toward(arm, target, as_array("point", point), True)
    return _swivel_toward(arm, target, as_array("direction", direction), False)


@jax.jit
def _swivel_of_rows(arm: Arm, q: Array) -> SwivelBranch:
    (q,) = as_floats(q)
    check_joints(arm, q)
    arm, batch = arm.astype(q.dtype), q.shape[:-1]
    rows = to_batch_last(q, batch, 1)
    if isinstance(arm, OuterJointArm):
        swivel, branch = parameter_and_branch(arm, rows)
    elif isinstance(arm, RefinedArm):
        swivel, branch = wrap(principal(rows[arm.outer_joint])), refined_bits(arm, rows)
    else:
        swivel, branch = _swivel_of(arm_constants(arm), rows)
    return SwivelBranch(to_batch_first(swivel, batch), to_batch_first(branch, batch))


@partial(jax.jit, static_argnums=3)
def _swivel_toward(arm: Arm, target: Target, toward: Array, from_shoulder: bool) -> Array:
    target, (toward,) = check_target(arm, target, toward)
    if toward.shape[-1:] != (3,):
        raise ValueError(f"expected a point or direction of shape (*batch, 3), got {toward.shape}")
    batch = batch_shape(target, toward[..., 0])
    arm = arm.astype(toward.dtype)
    position, directions, zeros = target_columns(target, jnp.zeros((), toward.dtype), batch)
    g = arm_constants(arm)
    circle, zero, _, _ = usable_circle(g, wrist_and_hand(g, replace_bad_rows(arm, position, directions, zeros))[0])
    v = to_batch_last(toward, batch, 1)
    v = vec3.matvec(g.to_shoulder_frame, v - g.shoulder if from_shoulder else v)
    swivel = arctan2(g.reference.sense * vec3.dot(v, vec3.cross(circle.n, zero)), vec3.dot(v, zero))
    return to_batch_first(swivel, batch)


def _swivel_of(g: ArmConstants, q: Array) -> tuple[Array, Array]:
    tol = tolerances(q.dtype)
    sin, cos = sincos(q[3] - g.straight)
    left = sin < 0.0
    b = bend(g, jnp.abs(sin), cos, tol)
    side = jnp.where(left, -1.0, 1.0).astype(q.dtype)
    # Columns l̂ and o of the arm plane, from the elbow frame through the shoulder joints into the shoulder frame.
    seen = into_plane(b, side, jnp.eye(3, dtype=q.dtype)[:, :, None])[:2]
    turned = vec3.matmul(vec3.transpose(g.shoulder_from_elbow), vec3.transpose(seen))
    n, e = jnp.moveaxis(_zyz(q[0], q[1] + g.shoulder_delta, q[2], turned), 1, 0)
    zero, _ = g.reference.zero_direction(n, tol)
    swivel = arctan2(g.reference.sense * vec3.dot(e, vec3.cross(n, zero)), vec3.dot(e, zero))
    return swivel, branch_number(_negative(q[1] + g.shoulder_delta), left, _negative(q[5] + g.wrist_delta))


def _zyz(first: Array, middle: Array, third: Array, v: Array) -> Array:
    """Rz(first) Ry(middle) Rz(third) v."""
    (s1, c1), (s2, c2), (s3, c3) = sincos(first), sincos(middle), sincos(third)
    x, y, z = v
    x, y = c3 * x - s3 * y, s3 * x + c3 * y
    x, z = c2 * x + s2 * z, c2 * z - s2 * x
    return jnp.stack([c1 * x - s1 * y, s1 * x + c1 * y, z])


def _negative(angle: Array) -> Array:
    """Test whether the sine of a middle ZYZ angle is negative: its joint's other solution."""
    return jnp.sin(angle) < 0.0
