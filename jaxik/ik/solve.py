"""Inverse kinematics at a value of the redundancy parameter: all eight branches of a batch of targets.

Branch number = 4 * shoulder + 2 * elbow + wrist. Shoulder bit 0: sin(q2 + delta) >= 0, with delta the angle from axis 1
to axis 3 at zero; wrist bit 0 the same for q6; elbow bit 0: q4 on the positive side of full stretch. At the end of an
outer joint the bit is that of the root: 0 where n · (a6 × a5) >= 0 (for joint 1, n · (a3 × a2) >= 0), with n the
direction from shoulder to wrist.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxik.arm import Arm, ArmModel, OuterJointArm, RefinedArm, as_arm
from jaxik.ik.all_branches import all_branches
from jaxik.ik.branches import BRANCHES, branch_bits
from jaxik.ik.large_batches import over_targets
from jaxik.ik.residual import residual, residual_of_branches
from jaxik.ik.solution import IKSolution, Residual
from jaxik.ik.status import Status
from jaxik.numerics import CHUNK, at_hand, to_batch_first, to_batch_last, tolerances
from jaxik.obstacles import World, columns_of, in_world, meets, moves
from jaxik.targets import Pose, Target, TargetLike, as_array, as_target, batch_shape, check_target

# Rows per chunk of arms that are solved by refinement, whose arrays have 128 columns per row.
REFINED_CHUNK = 256


def solve_ik(
    arm: Arm | ArmModel, target: TargetLike, swivel: Float[ArrayLike, "*batch"], *, world: World | None = None
) -> IKSolution:
    """Return all eight joint vectors that put the tool on the target at a value of the redundancy parameter.

    The parameter of an S-R-S arm is the swivel, the angle of the elbow on its circle. That of an arm with an outer
    joint (:class:`jaxik.OuterJointArm`) is the angle of this joint, 7 or 1, and that of an arm that is solved by
    refinement (:class:`jaxik.RefinedArm`) too: it has 16 places in the place of 8, of which the first holds the
    solution with the bits of its branch, that 8 further a second one with the same bits; a place without a solution
    has the status UNSOLVED or DUPLICATE, and docs/arms.md says how often one is missed.

    Args:
        arm: The arm.
        target: A :class:`Pose` (7 joints; also matrices ``(*batch, 4, 4)`` or jaxlie's ``SE3``) or a :class:`Pointing`
            (6 joints, or 7 whose last joint only rolls the hand: it is then left at zero, or at its nearest limit).
            Leading batch axes, broadcast against ``swivel``.
        swivel: Redundancy parameter, ``(*batch,)`` [rad]: the angle of the elbow on its circle, from the arm's
            reference, or the angle of the outer joint.
        world: Obstacles, for an arm with a body (:func:`jaxik.with_body`): branches in which the body meets them, or
            itself, have the status COLLISION; :func:`jaxik.clearance` says which two meet. Batch axes, one world per
            row, broadcast too.

    Returns:
        Joint angles ``(*batch, 8, n_joints)`` in (-pi, pi], or a turn further where a limit admits only that, a status
        ``(*batch, 8)`` and the residual of forward kinematics, which outside ``jit`` is computed when first asked for.
        The dtype is that of the target and swivel; the arm follows. Out of reach, the wrist goes to the nearest
        reachable point on its ray from the shoulder. :meth:`IKSolution.best` chooses a branch.

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
    arm, target = in_world(as_arm(arm, any_class=True), world), as_target(target)
    swivel = as_array("swivel angles of shape (*batch,)", swivel)
    if moves(arm):  # the rows of the world would have to be in the chunks too
        q, status = _solve_ik(arm, target, swivel)
    else:
        q, status = over_targets(_solve_ik, arm, target, swivel, chunk=CHUNK if arm.closed_form else REFINED_CHUNK)
    if at_hand(q):
        later = Residual.deferred(lambda: Residual(*over_targets(_residual, arm, target, q, rank=2)))
        return IKSolution(q, status, later)
    return IKSolution(q, status, Residual(*_residual(arm, target, q)))


@jax.jit
def _solve_ik(arm: Arm, target: Target, swivel: ArrayLike) -> tuple[Array, Array]:
    """Joint angles and statuses of all branches."""
    target, (swivel,) = check_target(arm, target, swivel)
    batch = batch_shape(target, swivel)
    if moves(arm):
        batch = np.broadcast_shapes(batch, arm.surroundings.world.batch)
    arm = arm.astype(swivel.dtype)
    columns = target_columns(target, swivel, batch)
    branches = all_branches(arm, *columns)
    q, status = branches.q, branches.status
    # The placeholder of a bad row still depends on the arm, steeply where the arm's zero posture is singular.
    q = jnp.where((status >= Status.INVALID_TARGET)[:, None], jax.lax.stop_gradient(q), q)
    if isinstance(arm, OuterJointArm | RefinedArm):  # several angles at once put on their limits may leave the target
        off, turn = residual(arm, *jax.lax.stop_gradient((q, *columns[:2])))
        most = tolerances(q.dtype).target
        missed = (off > most * jax.lax.stop_gradient(arm.length)) | (turn > most)
        status = jnp.where((status <= Status.NEAR_SINGULAR) & missed, jnp.int32(Status.LIMITS), status)
    if arm.surroundings is not None:
        status = jnp.maximum(status, jnp.where(_collides(arm, q, batch), jnp.int32(Status.COLLISION), 0))
    return to_batch_first(q, batch), to_batch_first(status, batch)


def _collides(arm: Arm, q: Array, batch: tuple[int, ...]) -> Array:
    """Test in which branches ``(8, joint, n)`` the body meets something, ``(8, n)``; S-R-S: per side of the elbow."""
    world = columns_of(arm.surroundings.world, batch)
    if isinstance(arm, OuterJointArm | RefinedArm):
        return jax.lax.map(lambda branch: meets(arm, branch, world), jax.lax.stop_gradient(q))
    sides = jax.lax.map(lambda side: meets(arm, side, world), jax.lax.stop_gradient(q[:4:2]))
    return sides[branch_bits(np.arange(BRANCHES)).elbow.astype(int)]


@jax.jit
def _residual(arm: Arm, target: Target, q: Array) -> tuple[Array, Array]:
    """Distance of all branches from the target, in meters and radians."""
    target, (q,) = check_target(arm, target, q)
    batch = q.shape[:-2]
    position, directions, _ = target_columns(target, jnp.zeros((), q.dtype), batch)
    measure = residual if isinstance(arm, OuterJointArm | RefinedArm) else residual_of_branches
    off, turn = measure(arm.astype(q.dtype), to_batch_last(q, batch, 2), position, directions)
    return to_batch_first(off, batch), to_batch_first(turn, batch)


def target_columns(target: Target, swivel: Array, batch: tuple[int, ...]) -> tuple[Array, Array, Array]:
    """Return position ``(3, n)``, directions ``(3, 3 or 1, n)`` and swivel ``(n,)``, broadcast to the batch."""
    if isinstance(target, Pose):
        directions = to_batch_last(target.rotation, batch, 2)
    else:
        directions = to_batch_last(target.direction, batch, 1)[:, None]
    return to_batch_last(target.position, batch, 1), directions, to_batch_last(swivel, batch, 0)
