"""Postures of targets at angles of the outer joint, in all branches, and their room to every border.

The room of a branch is one continuous function of the angle: the least of the rooms to the limits, to the ends of the
reach, to where its roots meet and to the keep-out, and of the distances of the arm's body. A branch is feasible where
it is not negative.
"""

import jax.numpy as jnp
from jax import Array

from jaxik.arm import OuterJointArm
from jaxik.ik import outer_joint_form
from jaxik.numerics import principal
from jaxik.obstacles import room_at_nodes


def postures(arm: OuterJointArm, position: Array, directions: Array, parameter: Array) -> tuple[Array, Array]:
    """Return joint angles and room of all branches.

    Args:
        arm: The arm; the world about its body has its rows last.
        position: Tool points, ``(3, n)`` [m].
        directions: Rotations, ``(3, 3, n)``.
        parameter: Angles of the outer joint, ``(k, n)`` [rad].

    Returns:
        Joint angles ``(8, 7, k, n)`` [rad] and room ``(8, k, n)`` [rad, arm lengths].
    """
    q, room = _within_limits(arm, position, directions, parameter)
    if arm.surroundings is not None:
        room = jnp.minimum(room, room_at_nodes(arm, jnp.moveaxis(q, 1, 0)))
    return q, room


def room_in_branch(arm: OuterJointArm, position: Array, directions: Array, branch: Array, parameter: Array) -> Array:
    """Return the room in one branch per angle, ``(k, n)`` for branches and angles ``(k, n)``."""
    q, room = _within_limits(arm, position, directions, parameter)
    room = jnp.take_along_axis(room, branch[None], axis=0)[0]
    if arm.surroundings is not None:
        room = jnp.minimum(room, room_at_nodes(arm, jnp.take_along_axis(q, branch[None, None], axis=0)[0]))
    return room


def _within_limits(arm: OuterJointArm, position: Array, directions: Array, parameter: Array) -> tuple[Array, Array]:
    """Joint angles and room of all branches regardless of the arm's body, as :func:`postures`."""
    k, n = parameter.shape

    def repeated(x: Array) -> Array:
        return jnp.broadcast_to(x[..., None, :], (*x.shape[:-1], k, n)).reshape(*x.shape[:-1], k * n)

    branches = outer_joint_form(arm, repeated(position), repeated(directions), parameter.reshape(k * n))
    q = branches.q
    center, half = 0.5 * (arm.lower + arm.upper), 0.5 * (arm.upper - arm.lower)
    inside = half[:, None] - jnp.abs(principal(q - center[:, None]))
    # The squared sines of the roots, made large enough not to hide the limits.
    room = jnp.minimum(jnp.min(inside, axis=1), 16.0 * branches.root_room)
    return q.reshape(8, 7, k, n), room.reshape(8, k, n)
