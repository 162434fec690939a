"""Forward kinematics: joint angles to points and poses."""

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxik import columns as col
from jaxik.arm import Arm
from jaxik.columns import Vec3
from jaxik.numerics import sincos
from jaxik.shapes import as_floats, check_joints
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
    arm = arm.astype(q.dtype)
    frame = tuple(col.split_vector(arm.tool_rotation[:, i]) for i in range(3))
    points, axes = _carry(arm, q, frame)
    return Pose(col.join_vector(points[-1]), col.join_matrix(axes))


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
    points, _ = _carry(arm.astype(q.dtype), q, ())
    return jnp.stack(jnp.broadcast_arrays(*(col.join_vector(p) for p in points)), axis=-2)


def tool_direction(arm: Arm, q: Array) -> tuple[Vec3, Vec3]:
    """Tool point and pointing direction as columns."""
    points, (direction,) = _carry(arm, q, (col.split_vector(arm.tool_rotation[:, 2]),))
    return points[-1], direction


def _carry(arm: Arm, q: Array, directions: tuple[Vec3, ...]) -> tuple[list[Vec3], tuple[Vec3, ...]]:
    """Carries the arm's points, and directions fixed to the tool, through the joints from the wrist inwards."""
    points = [col.split_vector(p) for p in (arm.shoulder, arm.elbow, arm.wrist, arm.tool_position)]
    links = [col.sub(b, a) for a, b in zip(points[:-1], points[1:], strict=True)]
    # links[k] turns with the joints up to and including its near end's: 3, 4, then all.
    moved = [links[2], *directions]
    for joint in reversed(range(arm.n_joints)):
        if joint == 3:
            moved = [links[1], *moved]
        if joint == 2:
            moved = [links[0], *moved]
        axis = col.split_vector(arm.axes[joint])
        sin, cos = sincos(q[..., joint])
        moved = [_turned(axis, sin, cos, v) for v in moved]
    elbow = col.add(points[0], moved[0])
    wrist = col.add(elbow, moved[1])
    return [points[0], elbow, wrist, col.add(wrist, moved[2])], tuple(moved[3:])


def _turned(axis: Vec3, sin: Array, cos: Array, v: Vec3) -> Vec3:
    """v turned about a unit axis (Rodrigues)."""
    along = col.scale(col.dot(axis, v), axis)
    across = col.sub(v, along)
    return col.add(along, col.add(col.scale(cos, across), col.scale(sin, col.cross(axis, v))))
