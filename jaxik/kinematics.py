"""Forward kinematics: joint angles to points and poses."""

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxik import columns as col
from jaxik.arm import Arm
from jaxik.shapes import as_floats, check_joints
from jaxik.staging import stage
from jaxik.targets import Pose


@jax.jit
def forward_kinematics(arm: Arm, q: Float[ArrayLike, "*batch joint"]) -> Pose:
    """Pose of the tool in the arm's base frame.

    Args:
        arm: The arm.
        q: Joint angles, ``(*batch, n_joints)`` [rad].

    Returns:
        Position ``(*batch, 3)`` [m] and rotation ``(*batch, 3, 3)``, in the dtype of ``q``.

    Raises:
        ValueError: If the last axis of ``q`` is not the arm's number of joints.

    **Differentiability**: smooth everywhere in ``q`` and in every array of the arm.

    References:
        Product of exponentials: K. Lynch, F. Park, "Modern Robotics", 2017, section 4.1.
    """
    (q,) = as_floats(q)
    check_joints(arm, q)
    arm, batch = arm.astype(q.dtype), q.shape[:-1]
    points, rotation = carry(arm, *_sincos(q, batch), arm.tool_rotation)
    return Pose(col.batch_first(points[:, 3], batch), col.batch_first(rotation, batch))


@jax.jit
def joint_positions(arm: Arm, q: Float[ArrayLike, "*batch joint"]) -> Float[Array, "*batch 4 3"]:
    """Shoulder, elbow, wrist and tool point in the base frame, for drawing.

    Args:
        arm: The arm.
        q: Joint angles, ``(*batch, n_joints)`` [rad].

    Returns:
        The four points, ``(*batch, 4, 3)`` [m].

    Raises:
        ValueError: If the last axis of ``q`` is not the arm's number of joints.

    **Differentiability**: smooth everywhere in ``q`` and in every array of the arm.
    """
    (q,) = as_floats(q)
    check_joints(arm, q)
    arm, batch = arm.astype(q.dtype), q.shape[:-1]
    points, _ = carry(arm, *_sincos(q, batch), arm.tool_rotation[:, :0])
    return col.batch_first(jnp.swapaxes(points, 0, 1), batch)


def carry(arm: Arm, sin: Array, cos: Array, directions: Array) -> tuple[Array, Array]:
    """Carries the arm's points, and directions fixed to the tool, through the joints from the wrist inwards.

    Args:
        arm: The arm.
        sin: Sines of the joint angles, ``(n_joints, ..., n)``.
        cos: Cosines.
        directions: Columns at zero joint angles, ``(3, k)``.

    Returns:
        Shoulder, elbow, wrist and tool point ``(3, 4, ..., n)``, and the directions ``(3, k, ..., n)``.
    """
    batch = sin.ndim - 1
    points = jnp.stack([arm.shoulder, arm.elbow, arm.wrist, arm.tool_position], axis=1)
    links = points[:, 1:] - points[:, :-1]
    # What a joint turns: the hand and its directions, beyond the elbow the forearm too, beyond the shoulder all.
    joins = {3: links[:, 1:2], 2: links[:, 0:1]}
    moved = _behind(jnp.concatenate([links[:, 2:], directions], axis=1), batch)
    for joint in reversed(range(arm.n_joints)):
        if joint in joins:
            joining = jnp.broadcast_to(_behind(joins[joint], batch), (3, 1, *moved.shape[2:]))
            moved = jnp.concatenate([joining, moved], axis=1)
        moved = _turned(arm.axes[joint], sin[joint], cos[joint], moved)
    start = jnp.broadcast_to(_behind(arm.shoulder[:, None], batch), moved[:, :1].shape)
    reached = jnp.concatenate([start, start + jnp.cumsum(moved[:, :3], axis=1)], axis=1)
    return reached, moved[:, 3:]


def _sincos(q: Array, batch: tuple[int, ...]) -> tuple[Array, Array]:
    """Library functions, not the solver's polynomials: a caller's angles may be of any size."""
    q = col.batch_last(q, batch, 1)
    return jnp.sin(q), jnp.cos(q)


def _behind(constant: Array, batch: int) -> Array:
    """A constant with batch axes of length one behind it."""
    return constant.reshape(constant.shape + (1,) * batch)


@stage
def _turned(axis: Array, sin: Array, cos: Array, v: Array) -> Array:
    """Vectors ``(3, k, ...)`` turned about a unit axis (Rodrigues)."""
    axis = _behind(axis, v.ndim - 1)
    along = col.dot(axis, v) * axis
    return along + cos * (v - along) + sin * col.cross(jnp.broadcast_to(axis, v.shape), v)
