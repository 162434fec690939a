"""Forward kinematics: joint angles to points and poses."""

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxik.arm import Arm, ArmModel, as_arm
from jaxik.numerics import fused_separately, in_chunks, map_chunks, to_batch_first, to_batch_last, vec3
from jaxik.targets import Pose, as_array, as_floats, check_joints, cross_matrix

JOINT_ANGLES = "joint angles of shape (*batch, n_joints)"


def forward_kinematics(arm: Arm | ArmModel, q: Float[ArrayLike, "*batch joint"]) -> Pose:
    """Return the pose of the tool in the arm's base frame.

    Args:
        arm: The arm.
        q: Joint angles, ``(*batch, n_joints)`` [rad].

    Returns:
        Position ``(*batch, 3)`` [m] and rotation ``(*batch, 3, 3)``, in the dtype of ``q``.

    Raises:
        ValueError: If the last axis of ``q`` is not the arm's number of joints, or ``arm`` is not an arm.

    **Differentiability**: smooth everywhere in ``q`` and in every array of the arm.

    References:
        Product of exponentials: K. Lynch, F. Park, "Modern Robotics", 2017, section 4.1.
    """
    arm, q = as_arm(arm, any_class=True), as_array(JOINT_ANGLES, q)
    batch = jnp.shape(q)[:-1]
    if in_chunks(batch, arm, q):
        (q,) = as_floats(q)
        check_joints(arm, q)
        return map_chunks(_forward_kinematics, arm, (q,), (1,), batch)
    return _forward_kinematics(arm, q)


@jax.jit
def _forward_kinematics(arm: Arm, q: ArrayLike) -> Pose:
    (q,) = as_floats(q)
    check_joints(arm, q)
    arm, batch = arm.astype(q.dtype), q.shape[:-1]
    points, rotation = carry(arm, *batch_last_sincos(q, batch), arm.tool_rotation)
    return Pose(to_batch_first(points[:, -1], batch), to_batch_first(rotation, batch))


def joint_positions(arm: Arm | ArmModel, q: Float[ArrayLike, "*batch joint"]) -> Float[Array, "*batch 4 3"]:
    """Return shoulder, elbow, wrist and tool point in the base frame, for drawing.

    Args:
        arm: The arm.
        q: Joint angles, ``(*batch, n_joints)`` [rad].

    Returns:
        The four points, ``(*batch, 4, 3)`` [m].

    Raises:
        ValueError: If the last axis of ``q`` is not the arm's number of joints, or ``arm`` is not an arm.

    **Differentiability**: smooth everywhere in ``q`` and in every array of the arm.
    """
    return _joint_positions(as_arm(arm, any_class=True), as_array(JOINT_ANGLES, q))


@jax.jit
def _joint_positions(arm: Arm, q: ArrayLike) -> Array:
    (q,) = as_floats(q)
    check_joints(arm, q)
    arm, batch = arm.astype(q.dtype), q.shape[:-1]
    points, _ = carry(arm, *batch_last_sincos(q, batch), arm.tool_rotation[:, :0])
    on = arm.station_of_joint
    named = [points[:, station] for station in (on[1], on[3], on[4], -1)]
    return to_batch_first(jnp.stack(named), batch)


def carry(arm: Arm, sin: Array, cos: Array, directions: Array) -> tuple[Array, Array]:
    """Carry the arm's points, and directions fixed to the tool, through the joints from the wrist inwards.

    Args:
        arm: The arm.
        sin: Sines of the joint angles, ``(n_joints, ..., n)``.
        cos: Cosines.
        directions: Columns at zero joint angles, ``(3, k)``.

    Returns:
        The arm's stations (:attr:`jaxik.Arm.stations`), ``(3, 4 or 5, ..., n)``: shoulder, elbow, wrist and tool point
        of an S-R-S arm; and the directions ``(3, k, ..., n)``.
    """
    return _carried(arm, sin, cos, directions, with_axes=False)


def carry_axes(arm: Arm, sin: Array, cos: Array, directions: Array) -> tuple[Array, Array, Array]:
    """Carry the joint axes too: as :func:`carry`, and the axes in the base frame, ``(3, joint, ..., n)``."""
    points, carried = _carried(arm, sin, cos, directions, with_axes=True)
    count = directions.shape[1]
    return points, carried[:, :count], carried[:, count:][:, ::-1]


def _carried(arm: Arm, sin: Array, cos: Array, directions: Array, *, with_axes: bool) -> tuple[Array, Array]:
    """Points and directions; the axes follow these, the last joint's first."""
    batch = sin.ndim - 1
    points = jnp.stack(arm.stations, axis=1)
    links = _behind(points[:, 1:] - points[:, :-1], batch)
    joints = turns(arm.axes, sin, cos)
    # A joint turns the hand and its directions, and every link and axis beyond it.
    on, last = arm.station_of_joint, arm.n_joints - 1
    moved = jnp.concatenate([links[:, on[last] :], _behind(directions, batch)], axis=1)
    for joint in reversed(range(arm.n_joints)):
        if joint < last and on[joint] != on[joint + 1]:
            joining = jnp.broadcast_to(links[:, on[joint] : on[joint] + 1], (3, 1, *moved.shape[2:]))
            moved = jnp.concatenate([joining, moved], axis=1)
        moved = turn_by(joints[joint], moved)
        if with_axes:
            axis = _behind(arm.axes[joint][:, None], batch)
            moved = jnp.concatenate([moved, jnp.broadcast_to(axis, (3, 1, *moved.shape[2:]))], axis=1)
    count = links.shape[1]
    carried = [jnp.broadcast_to(_behind(points[:, :1], batch), moved[:, :1].shape)]
    for link in range(count):
        carried.append(carried[-1] + moved[:, link : link + 1])
    return jnp.concatenate(carried, axis=1), moved[:, count:]


@fused_separately
def turns(axes: Array, sin: Array, cos: Array) -> Array:
    """Return rotation matrices ``(joint, 3, 3, ...)`` about unit axes ``(joint, 3)`` (Rodrigues)."""
    along = axes[:, :, None] * axes[:, None, :]
    parts = along, jnp.eye(3, dtype=sin.dtype) - along, cross_matrix(axes)
    along, across, cross = (_behind(m, sin.ndim - 1) for m in parts)
    return along + cos[:, None, None] * across + sin[:, None, None] * cross


@fused_separately
def turn_by(turn: Array, v: Array) -> Array:
    """Return columns ``(3, k, ...)`` turned by rotation matrices ``(3, 3, ...)``."""
    return vec3.matmul(turn, v)


def batch_last_sincos(q: Array, batch: tuple[int, ...]) -> tuple[Array, Array]:
    """Sines and cosines of joint angles ``(*batch, joint)``, ``(joint, n)``.

    Library functions, not the solver's polynomials: a caller's angles may be of any size.
    """
    q = to_batch_last(q, batch, 1)
    return jnp.sin(q), jnp.cos(q)


def _behind(constant: Array, batch: int) -> Array:
    """A constant with batch axes of length one behind it."""
    return constant.reshape(constant.shape + (1,) * batch)
