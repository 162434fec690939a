"""Distance of solutions from their targets, by forward kinematics of the joint angles."""

import jax.numpy as jnp
from jax import Array

from jaxik.arm import Arm
from jaxik.ik.target_checks import unit_direction, within_squares
from jaxik.kinematics import carry, turn_by, turns
from jaxik.numerics import arctan2, clipped_sqrt, fused_separately, merge_leading, sincos_apart, vec3


def residual(arm: Arm, q: Array, position: Array, directions: Array) -> tuple[Array, Array]:
    """Return the distance from the target by forward kinematics.

    It is finite too: a position that is not finite counts as very far (1e77 m in float64), a missing orientation as
    half a turn.

    Args:
        arm: The arm.
        q: Joint angles of any postures, ``(postures, joint, n)`` [rad].
        position: Tool points asked for, ``(3, n)`` [m].
        directions: Rotations ``(3, 3, n)`` or directions ``(3, 1, n)``.

    Returns:
        Distances in meters and radians, ``(postures, n)`` each.
    """
    points, reached = carry(arm, *sincos_apart(jnp.moveaxis(q, 1, 0)), _own_directions(arm, directions))
    return _distances(arm, points[:, -1], reached, position, directions)


def residual_of_branches(arm: Arm, q: Array, position: Array, directions: Array) -> tuple[Array, Array]:
    """Return :func:`residual` of the eight branches, ``(8, joint, n)``, that share their angles as solutions do."""
    n = q.shape[-1]
    bits = q.reshape(2, 2, 2, *q.shape[1:])
    # Joint first, then the bits: shoulder and elbow for the shoulder's joints, elbow and wrist for the wrist's.
    shoulder, wrist = jnp.moveaxis(bits[:, :, 0, :3], 2, 0), jnp.moveaxis(bits[0, :, :, 4:], 2, 0)
    elbow = bits[:1, :, 0, 3]
    sin, cos = sincos_apart(jnp.concatenate([merge_leading(x, 1) for x in (shoulder, elbow, wrist)]))
    parts = [(0, 3, 0, 12, (3, 2, 2, n)), (3, 4, 12, 14, (1, 2, 1, n)), (4, arm.n_joints, 14, len(sin), wrist.shape)]
    of_shoulder, of_elbow, of_wrist = (
        turns(arm.axes[i:j], sin[k:m].reshape(shape), cos[k:m].reshape(shape)) for i, j, k, m, shape in parts
    )
    hand = jnp.concatenate([(arm.tool_position - arm.wrist)[:, None], _own_directions(arm, directions)], axis=1)
    hand = jnp.broadcast_to(hand[:, :, None, None, None], (*hand.shape, 2, 2, n))
    for turn in reversed(of_wrist):
        hand = turn_by(turn, hand)
    hand = turn_by(of_elbow[0], _from(arm.wrist - arm.elbow, hand))
    rotation = turn_by(of_shoulder[0], turn_by(of_shoulder[1], of_shoulder[2]))
    reached = turn_by(rotation[..., None, :], _from(arm.elbow - arm.shoulder, hand)[:, :, None])
    reached = reached.reshape(*reached.shape[:2], 8, n)
    point = reached[:, 0] + arm.shoulder[:, None, None]
    return _distances(arm, point, reached[:, 1:], position, directions)


@fused_separately
def _from(link: Array, hand: Array) -> Array:
    """The first column, a point, seen from the other end of the link that carries it."""
    point = hand[:, :1] + link.reshape(3, 1, *[1] * (hand.ndim - 2))
    return jnp.concatenate([point, hand[:, 1:]], axis=1)


def _own_directions(arm: Arm, directions: Array) -> Array:
    """Directions of the tool at zero joint angles that a target is about."""
    return arm.tool_rotation[:, 2:] if directions.shape[1] == 1 else arm.tool_rotation


@fused_separately
def _distances(arm: Arm, point: Array, reached: Array, position: Array, directions: Array) -> tuple[Array, Array]:
    finite = jnp.isfinite(position)
    miss = point - within_squares(jnp.where(finite, position, jnp.finfo(position.dtype).max))[:, None]
    if directions.shape[1] == 1:
        wanted, given = unit_direction(directions, arm.tool_rotation[:, 2:, None])
        chord2 = 4.0
    else:
        finite = jnp.isfinite(directions)
        wanted, given, chord2 = jnp.where(finite, directions, 0.0), jnp.all(finite, axis=(0, 1)), 8.0
    # |R - R'| = 2 sqrt(2) sin(angle / 2) and |d - d'| = 2 sin(angle / 2) keep the digits that a trace or product loses.
    off = reached - wanted[:, :, None]
    half = jnp.where(given, jnp.clip(jnp.sum(vec3.dot(off, off), axis=0) / chord2, 0.0, 1.0), 1.0)
    return clipped_sqrt(vec3.dot(miss, miss)), 2.0 * arctan2(clipped_sqrt(half), clipped_sqrt(1.0 - half))
