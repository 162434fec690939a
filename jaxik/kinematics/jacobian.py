"""Velocities of the tool: the geometric Jacobian, its manipulability, and its null space in closed form.

With the elbow still, the arm from shoulder to wrist can only turn about the line between them, with unit vector n. The
shoulder's axes a1, a2, a3 share that turn out by Cramer's rule, and the wrist's axes a5, a6, a7 undo it:

    v = (d_w n·(a2×a3, a3×a1, a1×a2), 0, -d_s n·(a6×a7, a7×a5, a5×a6)),  d_s = a1·(a2×a3),  d_w = a5·(a6×a7)

spans the null space. Multiplied by |SW| (a4 × EW)·SW, which says how fast the elbow changes the distance of the wrist W
from the shoulder S, its entries are the maximal minors of the Jacobian. With six joints a7 is the tool's z axis, about
which rotation is free. Nothing here divides by a small number, so it holds up to and at singular postures.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike
from jaxtyping import Float

from jaxik.arm import Arm, ArmModel, OuterJointArm, RefinedArm, as_arm
from jaxik.kinematics.forward import JOINT_ANGLES, batch_last_sincos, carry_axes
from jaxik.numerics import clipped_sqrt, to_batch_first, tolerances, vec3
from jaxik.targets import as_array, as_floats, check_joints


def jacobian(arm: Arm | ArmModel, q: Float[ArrayLike, "*batch joint"]) -> Float[Array, "*batch 6 joint"]:
    """Return the geometric Jacobian of the tool point in the base frame.

    Args:
        arm: The arm.
        q: Joint angles, ``(*batch, n_joints)`` [rad].

    Returns:
        ``(*batch, 6, n_joints)``: three rows of linear velocity of the tool point [m/rad], then three of angular
        velocity [rad/rad], so that ``J @ qd`` is the tool's twist.

    Raises:
        ValueError: If the last axis of ``q`` is not the arm's number of joints, or ``arm`` is not an arm.

    **Differentiability**: smooth everywhere in ``q`` and in every array of the arm.

    References:
        K. Lynch, F. Park, "Modern Robotics", 2017, section 5.1, with the reference point moved to the tool point.

    Example:
        >>> import jaxik
        >>> jacobian(jaxik.presets.iiwa7(), jnp.zeros(7)).shape
        (6, 7)
    """
    return _jacobian(as_arm(arm, any_class=True), as_array(JOINT_ANGLES, q))


@jax.jit
def _jacobian(arm: Arm, q: ArrayLike) -> Array:
    (q,) = as_floats(q)
    check_joints(arm, q)
    arm, batch = arm.astype(q.dtype), q.shape[:-1]
    return to_batch_first(_columns(arm, *batch_last_sincos(q, batch)), batch)


def _columns(arm: Arm, sin: Array, cos: Array) -> Array:
    """Columns of the Jacobian, ``(6, joint, n)``."""
    points, _, axes = carry_axes(arm, sin, cos, arm.tool_rotation[:, :0])
    levers = points[:, -1:] - points[:, np.array(arm.station_of_joint)]
    return jnp.concatenate([vec3.cross(axes, levers), axes])


def manipulability(arm: Arm | ArmModel, q: Float[ArrayLike, "*batch joint"]) -> Float[Array, "*batch"]:
    """Return Yoshikawa's measure of how far a posture is from singular: sqrt(det(J Jᵀ)), 0 at singular postures.

    With seven joints J is :func:`jacobian`. With six the roll of the hand is free, and J has five rows: the linear
    velocity and the angular velocity across the pointing direction.

    Args:
        arm: The arm.
        q: Joint angles, ``(*batch, n_joints)`` [rad].

    Returns:
        ``(*batch,)`` [m³], not negative; comparable between postures of one arm only. Near a straight elbow, and where
        shoulder and wrist are both nearly aligned, it keeps the relative accuracy that the determinant loses.

    Raises:
        ValueError: If the last axis of ``q`` is not the arm's number of joints, or ``arm`` is not an arm.

    **Differentiability**: forward and reverse; smooth away from singular postures, and zero at them, where the measure
    has a kink.

    References:
        T. Yoshikawa, "Manipulability of robotic mechanisms", IJRR 4(2), 1985; by the Cauchy-Binet formula det(J Jᵀ) is
        the sum of the squared maximal minors of J.

    Example:
        >>> import jaxik
        >>> float(manipulability(jaxik.presets.iiwa7(), jnp.zeros(7)))  # upright and straight
        0.0
    """
    return _manipulability(as_arm(arm, any_class=True), as_array(JOINT_ANGLES, q))


@jax.jit
def _manipulability(arm: Arm, q: ArrayLike) -> Array:
    (q,) = as_floats(q)
    check_joints(arm, q)
    arm, batch = arm.astype(q.dtype), q.shape[:-1]
    if isinstance(arm, OuterJointArm | RefinedArm):
        v = _minors(arm, q, batch)
        return to_batch_first(clipped_sqrt(jnp.sum(v * v, axis=0)), batch)
    _, v, _, bend = _null_space(arm, q, batch)
    return to_batch_first(clipped_sqrt(bend * bend * jnp.sum(v * v, axis=0)), batch)


def self_motion_direction(arm: Arm | ArmModel, q: Float[ArrayLike, "*batch joint"]) -> Float[Array, "*batch joint"]:
    """Return the unit joint velocity that turns the elbow about the line from shoulder to wrist and keeps the tool.

    The null space of :func:`jacobian`; with six joints that of position and pointing direction, while the hand rolls.
    The sign is that in which the swivel grows.

    Args:
        arm: The arm.
        q: Joint angles, ``(*batch, n_joints)`` [rad].

    Returns:
        Unit vectors, ``(*batch, n_joints)`` [rad/s]; joint 4 rests.

        At an aligned shoulder (axes 1 and 3 in one line) joints 1 and 3 turn against each other, at an aligned wrist
        joints 5 and 7: the swivel rests there, and the direction in which it grows changes sides. At such a posture
        itself the direction is that of the neighbors with a positive product of the triple products d_s d_w.

        Where the null space has more dimensions (both aligned, or one of them with the line from shoulder to wrist in
        the plane of its axes) joints 1 and 3 alone turn, joint 1 forward, or joints 5 and 7, joint 5 forward, where
        the wrist is the better aligned of the two.

    Raises:
        ValueError: If the last axis of ``q`` is not the arm's number of joints, or ``arm`` is not an arm.

    **Differentiability**: forward and reverse; smooth but for the changes of sign, finite everywhere.

    Example:
        >>> import jaxik
        >>> model, q = jaxik.presets.iiwa7(), jnp.array([0.3, 0.8, -0.2, -1.2, 0.5, 0.9, 0.0])
        >>> direction = self_motion_direction(model, q)
        >>> bool(abs(jacobian(model, q) @ direction).max() < 1e-5)
        True
    """
    return _self_motion_direction(as_arm(arm, any_class=True), as_array(JOINT_ANGLES, q))


@jax.jit
def _self_motion_direction(arm: Arm, q: ArrayLike) -> Array:
    (q,) = as_floats(q)
    check_joints(arm, q)
    arm, batch = arm.astype(q.dtype), q.shape[:-1]
    if isinstance(arm, OuterJointArm | RefinedArm):
        return to_batch_first(_parameter_direction(arm, _minors(arm, q, batch)), batch)
    axes, v, triples, _ = _null_space(arm, q, batch)
    # Below 64 eps v is all rounding.
    least = tolerances(q.dtype).singular
    square = jnp.sum(v * v, axis=0)
    several = square <= least**2
    unit = v / jnp.sqrt(jnp.where(several, 1.0, square))
    sign = arm.reference.sense * jnp.where(triples[0] * triples[1] < 0.0, -1.0, 1.0).astype(q.dtype)
    alone = jnp.where(jnp.abs(triples[0]) <= jnp.abs(triples[1]), _opposed(axes, 0), _opposed(axes, 4))
    alone = alone[: arm.n_joints]
    alone = alone / jnp.sqrt(jnp.sum(alone * alone, axis=0))
    return to_batch_first(jnp.where(several, alone, sign * unit), batch)


def _null_space(arm: Arm, q: Array, batch: tuple[int, ...]) -> tuple[Array, Array, Array, Array]:
    """Null space of the Jacobian before normalization.

    Returns:
        Axes ``(3, 7, n)``; the vector v ``(joint, n)``; the triple products of shoulder and wrist ``(2, n)``; and the
        factor ``(n,)`` that makes v the minors of the Jacobian [m³].
    """
    sin, cos = batch_last_sincos(q, batch)
    points, z, axes = carry_axes(arm, sin, cos, arm.tool_rotation[:, 2:])
    axes = jnp.concatenate([axes, z], axis=1)[:, :7]
    at_zero = jnp.concatenate([arm.axes, arm.tool_rotation[:, 2][None]])[:7]
    line = points[:, 2] - points[:, 0]
    square = vec3.dot(line, line)
    # A wrist in the shoulder turns about any line.
    centered = square <= (tolerances(q.dtype).singular * arm.length) ** 2
    distance = jnp.sqrt(jnp.where(centered, 1.0, square))
    n = jnp.where(centered, arm.reference.vectors()[1][:, None], line / distance)
    # Triple products and the elbow's effect from single joints: exact to the last digits where they vanish.
    of_shoulder = _triple(at_zero[0], at_zero[1], at_zero[2], sin[1], cos[1])
    of_wrist = _triple(at_zero[4], at_zero[5], at_zero[6], sin[5], cos[5])
    bend = distance * _triple(arm.elbow - arm.shoulder, arm.axes[3], arm.wrist - arm.elbow, sin[3], cos[3])
    still = jnp.zeros_like(distance)[None]
    v = jnp.concatenate([of_wrist * _shares(axes[:, :3], n), still, -of_shoulder * _shares(axes[:, 4:], n)])
    return axes, v[: arm.n_joints], jnp.stack([of_shoulder, of_wrist]), jnp.where(centered, 0.0, bend)


def _minors(arm: Arm, q: Array, batch: tuple[int, ...]) -> Array:
    """Maximal minors of the Jacobian with alternating signs, which span its null space, ``(joint, n)`` [m³]."""
    columns = jnp.moveaxis(_columns(arm, *batch_last_sincos(q, batch)), -1, 0)
    others = np.array([[j for j in range(7) if j != i] for i in range(7)])
    minors = jnp.linalg.det(jnp.moveaxis(columns[:, :, others], 2, 1))
    return jnp.moveaxis(minors, -1, 0) * jnp.array([[1.0], [-1.0]] * 4, q.dtype)[:7]


def _parameter_direction(arm: OuterJointArm | RefinedArm, v: Array) -> Array:
    """Unit null vector in the direction in which the outer joint turns forward; the outer joint alone if all vanish."""
    least = tolerances(v.dtype).singular * jax.lax.stop_gradient(arm.length) ** 3
    square = jnp.sum(v * v, axis=0)
    several = square <= least**2
    unit = v / jnp.sqrt(jnp.where(several, 1.0, square))
    sign = jnp.where(v[arm.outer_joint] < 0.0, -1.0, 1.0).astype(v.dtype)
    alone = jnp.zeros_like(v).at[arm.outer_joint].set(1.0)
    return jnp.where(several, alone, sign * unit)


def _triple(a: Array, b: Array, c: Array, sin: Array, cos: Array) -> Array:
    """a·(b × c) with ``c`` turned about the unit vector ``b`` by the angle of a sine and cosine ``(n,)``."""
    return cos * vec3.dot(a, vec3.cross(b, c)) - sin * vec3.dot(a, vec3.project_out(c, b))


def _shares(axes: Array, n: Array) -> Array:
    """Rates ``(3, n)`` of three axes ``(3, 3, n)`` whose sum turns about ``n``, times their triple product."""
    a, b, c = axes[:, 0], axes[:, 1], axes[:, 2]
    normals = jnp.stack([vec3.cross(b, c), vec3.cross(c, a), vec3.cross(a, b)], axis=1)
    return vec3.dot(normals, n[:, None])


def _opposed(axes: Array, first: int) -> Array:
    """Rates ``(7, n)`` of the first and third of three joints that cancel where their axes lie in one line."""
    against = jnp.where(vec3.dot(axes[:, first], axes[:, first + 2]) < 0.0, 1.0, -1.0).astype(axes.dtype)
    return jnp.zeros_like(axes[0]).at[first].set(1.0).at[first + 2].set(against)
