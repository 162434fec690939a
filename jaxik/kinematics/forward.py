"""Forward kinematics: joint angles to points and poses."""

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxik.arm import Arm
from jaxik.numerics import fused_separately, to_batch_first, to_batch_last, vec3
from jaxik.targets import Pose, as_floats, check_joints


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
    return Pose(to_batch_first(points[:, 3], batch), to_batch_first(rotation, batch))


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
    return to_batch_first(jnp.swapaxes(points, 0, 1), batch)


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
    links = _behind(points[:, 1:] - points[:, :-1], batch)
    turns = _turns(arm.axes, sin, cos)
    # What a joint turns: the hand and its directions, beyond the elbow the forearm too, beyond the shoulder all.
    moved = jnp.concatenate([links[:, 2:], _behind(directions, batch)], axis=1)
    for joint in reversed(range(arm.n_joints)):
        if joint in (2, 3):
            joining = jnp.broadcast_to(links[:, joint - 2 : joint - 1], (3, 1, *moved.shape[2:]))
            moved = jnp.concatenate([joining, moved], axis=1)
        moved = _turned(turns[joint], moved)
    start = jnp.broadcast_to(_behind(points[:, :1], batch), moved[:, :1].shape)
    elbow, wrist, tool = start + moved[:, :1], moved[:, 1:2], moved[:, 2:3]
    return jnp.concatenate([start, elbow, elbow + wrist, elbow + wrist + tool], axis=1), moved[:, 3:]


@fused_separately
def _turns(axes: Array, sin: Array, cos: Array) -> Array:
    """Rotation matrices ``(joint, 3, 3, ...)`` about unit axes (Rodrigues)."""
    along = axes[:, :, None] * axes[:, None, :]
    x, y, z = axes.T
    zero = jnp.zeros_like(x)
    skew = jnp.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    along, across, skew = (_behind(m, sin.ndim - 1) for m in (along, jnp.eye(3, dtype=sin.dtype) - along, skew))
    return along + cos[:, None, None] * across + sin[:, None, None] * skew


@fused_separately
def _turned(turn: Array, v: Array) -> Array:
    return vec3.matmul(turn, v)


def _sincos(q: Array, batch: tuple[int, ...]) -> tuple[Array, Array]:
    """Library functions, not the solver's polynomials: a caller's angles may be of any size."""
    q = to_batch_last(q, batch, 1)
    return jnp.sin(q), jnp.cos(q)


def _behind(constant: Array, batch: int) -> Array:
    """A constant with batch axes of length one behind it."""
    return constant.reshape(constant.shape + (1,) * batch)
