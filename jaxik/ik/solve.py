"""Inverse kinematics at a value of the redundancy parameter: all eight branches of a batch of targets.

Branch number = 4 * shoulder + 2 * elbow + wrist. Shoulder bit 0: sin(q2 + delta) >= 0, with delta the angle from axis 1
to axis 3 at zero; wrist bit 0 the same for q6; elbow bit 0: q4 on the positive side of full stretch. At the end of an
outer joint the bit is that of the root: 0 where n · (a6 × a5) >= 0 (for joint 1, n · (a3 × a2) >= 0), with n the
direction from shoulder to wrist.
"""

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxik.arm import Arm, ArmModel, as_arm
from jaxik.ik.all_branches import all_branches
from jaxik.ik.solution import IKSolution, Residual
from jaxik.ik.status import Status
from jaxik.ik.target_checks import unit_direction, within_squares
from jaxik.kinematics import carry
from jaxik.numerics import arctan2, clipped_sqrt, sincos, to_batch_first, to_batch_last, tolerances, vec3
from jaxik.targets import Pose, Target, TargetLike, as_array, as_target, batch_shape, check_target


def solve_ik(arm: Arm | ArmModel, target: TargetLike, swivel: Float[ArrayLike, "*batch"]) -> IKSolution:
    """Return all eight joint vectors that put the tool on the target at a value of the redundancy parameter.

    The parameter of an S-R-S arm is the swivel, the angle of the elbow on its circle. That of an arm with an outer
    joint (:class:`jaxik.OuterJointArm`) is the angle of this joint, 7 or 1.

    Args:
        arm: The arm.
        target: A :class:`Pose` (7 joints; also matrices ``(*batch, 4, 4)`` or jaxlie's ``SE3``) or a :class:`Pointing`
            (6 joints, or 7 whose last joint only rolls the hand: it is then left at zero, or at its nearest limit).
            Leading batch axes, broadcast against ``swivel``.
        swivel: Redundancy parameter, ``(*batch,)`` [rad]: the angle of the elbow on its circle, from the arm's
            reference, or the angle of the outer joint.

    Returns:
        Joint angles ``(*batch, 8, n_joints)`` in (-pi, pi], or a turn further where a limit admits only that, a status
        ``(*batch, 8)`` and the residual of forward kinematics. The dtype is that of the target and swivel; the arm
        follows. Out of reach, the wrist goes to the nearest reachable point on its ray from the shoulder.
        :meth:`IKSolution.best` chooses a branch.

    Raises:
        ValueError: Wrong shapes or dtypes, a :class:`Pose` for a 6-joint arm, or ``arm`` is not an arm. Bad values do
            not raise: see ``status``.

    **Differentiability**: forward and reverse in target, swivel and every array of the arm, finite everywhere. At the
    singular postures the derivative is that of every motion the arm can follow there: at an aligned shoulder or wrist
    with q1 (q5) held; on the reference's singular line with the reference carried along without spin; at full stretch,
    where the elbow's rate in the radial direction is infinite, with the rate at a margin of 64 eps; out of reach, with
    the bend held. Rows with a bad input have derivative zero.

    References:
        M. Shimizu et al., "Analytical inverse kinematic computation for 7-DOF redundant manipulators with joint limits
        and its application to redundancy resolution", IEEE T-RO 24(5), 2008. Departures: any axis arrangement and elbow
        offset of the class; half angles instead of arccos; singular postures have values and derivatives.

    Example:
        >>> import jaxik
        >>> model = jaxik.presets.iiwa7()
        >>> target = jaxik.Pose.from_quaternion([0.5, 0.2, 0.6], wxyz=[0.0, 0.0, 1.0, 0.0])  # hand down
        >>> jaxik.solve_ik(model, target, 0.0).best().q.shape
        (7,)
    """
    return _solve_ik(
        as_arm(arm, any_class=True), as_target(target), as_array("swivel angles of shape (*batch,)", swivel)
    )


@jax.jit
def _solve_ik(arm: Arm, target: Target, swivel: ArrayLike) -> IKSolution:
    target, (swivel,) = check_target(arm, target, swivel)
    batch = batch_shape(target, swivel)
    arm = arm.astype(swivel.dtype)
    position, directions, swivel = target_columns(target, swivel, batch)
    branches = all_branches(arm, position, directions, swivel)
    q, status = branches.q, branches.status
    # The placeholder of a bad row still depends on the arm, steeply where the arm's zero posture is singular.
    q = jnp.where((status >= Status.INVALID_TARGET)[:, None], jax.lax.stop_gradient(q), q)
    off, turn = residual(arm, q, position, directions)
    # Several angles at once put on their limits may leave the target.
    most = tolerances(q.dtype).target
    missed = (off > most * jax.lax.stop_gradient(arm.length)) | (turn > most)
    status = jnp.where((status <= Status.NEAR_SINGULAR) & missed, jnp.int32(Status.LIMITS), status)
    q, status, off, turn = (to_batch_first(x, batch) for x in (q, status, off, turn))
    return IKSolution(q, status, Residual(off, turn))


def target_columns(target: Target, swivel: Array, batch: tuple[int, ...]) -> tuple[Array, Array, Array]:
    """Return position ``(3, n)``, directions ``(3, 3 or 1, n)`` and swivel ``(n,)``, broadcast to the batch."""
    if isinstance(target, Pose):
        directions = to_batch_last(target.rotation, batch, 2)
    else:
        directions = to_batch_last(target.direction, batch, 1)[:, None]
    return to_batch_last(target.position, batch, 1), directions, to_batch_last(swivel, batch, 0)


def residual(arm: Arm, q: Array, position: Array, directions: Array) -> tuple[Array, Array]:
    """Return the distance from the target by forward kinematics, in meters and radians, ``(8, n)`` each.

    It is finite too: a position that is not finite counts as very far (1e77 m in float64), a missing orientation as
    half a turn.
    """
    pointing = directions.shape[1] == 1
    points, reached = carry(
        arm, *sincos(jnp.moveaxis(q, 1, 0)), arm.tool_rotation[:, 2:] if pointing else arm.tool_rotation
    )
    finite = jnp.isfinite(position)
    miss = points[:, -1] - within_squares(jnp.where(finite, position, jnp.finfo(position.dtype).max))[:, None]
    if pointing:
        wanted, given = unit_direction(directions, arm.tool_rotation[:, 2:, None])
        chord2 = 4.0
    else:
        finite = jnp.isfinite(directions)
        wanted, given, chord2 = jnp.where(finite, directions, 0.0), jnp.all(finite, axis=(0, 1)), 8.0
    # |R - R'| = 2 sqrt(2) sin(angle / 2) and |d - d'| = 2 sin(angle / 2) keep the digits that a trace or product loses.
    off = reached - wanted[:, :, None]
    half = jnp.where(given, jnp.clip(jnp.sum(vec3.dot(off, off), axis=0) / chord2, 0.0, 1.0), 1.0)
    return clipped_sqrt(vec3.dot(miss, miss)), 2.0 * arctan2(clipped_sqrt(half), clipped_sqrt(1.0 - half))
