"""The self-motion at a posture, in joint space: what any arm's kinematics says of it, whatever its class.

At a fixed target the postures of an arm with seven joints form curves. Here are a curve's direction and curvature at a
posture, and the smallest step onto it from a posture beside it. Unlike the redundancy parameter, the length along the
curve never turns back: where two branches meet the curve passes through.
"""

import functools
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxik.arm import Arm
from jaxik.kinematics import carry_axes
from jaxik.numerics import fused_separately, sincos_apart, vec3

_RESTS = 1e-9  # of a joint's rate along the curve: no limit of a joint that rests bounds the way


class Tangent(NamedTuple):
    """The curve of postures on target near a posture, the batch last.

    Attributes:
        error: Square of the distance from the target [arm lengths and rad], ``(n,)``.
        correction: Least joint motion onto the curve, to first order, ``(joint, n)`` [rad].
        direction: Unit joint motion along it, of either sign, ``(joint, n)``.
        bend: Second derivative of the joint angles in the length along it, ``(joint, n)`` [1/rad].
        room: Distance of the elbow to each half-space, negative inside the keep-out, ``(half_spaces, n)`` [m].
        room_rate: Its derivative in the length, likewise [m/rad].
    """

    error: Array
    correction: Array
    direction: Array
    bend: Array
    room: Array
    room_rate: Array


def tangent(arm: Arm, position: Array, directions: Array, q: Array) -> Tangent:
    """Return the self-motion at joint angles ``(joint, ..., n)`` for targets ``(3, ..., n)`` and ``(3, 3, ..., n)``."""
    points, reached, axes = carry_axes(arm, *sincos_apart(q), arm.tool_rotation)
    error, columns, levers = _columns(arm, position, directions, points, reached, axes)
    inverse = _inverse(_gram(columns))
    along = _null_vector(columns, *_longest(columns, inverse), inverse)
    pull, room, rate = _second(arm, points, axes, levers, along)
    correction, bend = _least_motions(columns, inverse, jnp.stack([error, pull], axis=1))
    return Tangent(jnp.sum(error * error, axis=0), -correction, along, -bend, room, rate)


def correction(arm: Arm, position: Array, directions: Array, q: Array) -> Array:
    """Return the least joint motion onto the curve, to first order, ``(joint, ..., n)`` [rad].

    **Differentiability**: in target and arm at a posture on target, whose Jacobian is taken to be constant.
    """
    error, columns = error_and_columns(arm, position, directions, q)
    columns = lax.stop_gradient(columns)
    return -_least_motions(columns, _inverse(_gram(columns)), jnp.stack([error, error], axis=1))[0]


def error_and_columns(arm: Arm, position: Array, directions: Array, q: Array) -> tuple[Array, Array]:
    """Return what a posture misses its target by, ``(6, ..., n)``, and its derivatives, ``(6, joint, ..., n)``.

    Lengths are in arm lengths. The derivatives are those at the target: elsewhere the error of the rotation has others.
    """
    points, reached, axes = carry_axes(arm, *sincos_apart(q), arm.tool_rotation)
    return _columns(arm, position, directions, points, reached, axes)[:2]


def way_within(rate: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Return the ends of the way in which what changes at a rate stays between low and high."""
    moves = jnp.abs(rate) > _RESTS
    safe = jnp.where(moves, rate, 1.0)
    first, last = jnp.where(rate < 0.0, high, low) / safe, jnp.where(rate < 0.0, low, high) / safe
    return jnp.where(moves, first, -jnp.inf), jnp.where(moves, last, jnp.inf)


@fused_separately
def _columns(
    arm: Arm, position: Array, directions: Array, points: Array, reached: Array, axes: Array
) -> tuple[Array, Array, Array]:
    """Error ``(6, ...)`` and columns ``(6, joint, ...)`` of the Jacobian, lengths in arm lengths, and levers."""
    tool, size = points[:, -1], lax.stop_gradient(arm.length)  # a unit, whose derivative may be none
    levers = tool[:, None] - points[:, np.array(arm.station_of_joint)]
    columns = jnp.concatenate([vec3.cross(axes, levers) / size, axes])
    turn = 0.5 * jnp.sum(vec3.cross(directions, reached), axis=1)
    return jnp.concatenate([(tool - position) / size, turn]), columns, levers


@fused_separately
def _gram(columns: Array) -> Array:
    return _product(columns, jnp.swapaxes(columns, 0, 1))


@fused_separately
def _longest(columns: Array, inverse: Array) -> tuple[Array, Array]:
    """The joint that moves most along the curve, as a mask ``(joint, ...)``, and its column ``(6, ...)``.

    The projector on the null space is n nᵀ, whose longest column gives n with the least rounding.
    """
    spread = _product(inverse, columns)
    rest = [sum(c * s for c, s in zip(columns[:, j], spread[:, j], strict=True)) for j in range(columns.shape[1])]
    least = functools.reduce(jnp.minimum, rest)
    pick = jnp.stack([r == least for r in rest])
    alone = [jnp.where(p, c, 0.0) for p, c in zip(pick, jnp.moveaxis(columns, 1, 0), strict=True)]
    return pick, functools.reduce(jnp.add, alone)


@fused_separately
def _null_vector(columns: Array, pick: Array, column: Array, inverse: Array) -> Array:
    """The unit null vector, by projecting the joint that moves most."""
    solved = _product(inverse, column[:, None])
    along = pick.astype(columns.dtype) - _product(jnp.swapaxes(columns, 0, 1), solved)[:, 0]
    square = sum(a * a for a in along)
    return along / jnp.sqrt(jnp.maximum(square, jnp.finfo(along.dtype).tiny))


@fused_separately
def _second(arm: Arm, points: Array, axes: Array, levers: Array, along: Array) -> tuple[Array, Array, Array]:
    """Second derivatives of the pose along the direction, ``(6, ...)``; the elbow's room and its rate."""
    turned = along * axes
    behind = jnp.cumsum(turned, axis=1) - turned  # angular velocity of each axis
    spin = jnp.sum(vec3.cross(behind, turned), axis=1)
    # Of the tool point: a_i × (a_j × l_j) for i <= j.
    pull = jnp.sum(vec3.cross(turned + 2.0 * behind, vec3.cross(turned, levers)), axis=1)
    elbow = points[:, arm.station_of_joint[3]]
    origin = points[:, np.array(arm.station_of_joint[:3])]
    speed = jnp.sum(vec3.cross(turned[:, :3], elbow[:, None] - origin), axis=1)
    offset = arm.keep_out.offset.reshape(-1, *(1,) * (elbow.ndim - 1))
    normal = arm.keep_out.normal
    room, rate = offset - jnp.tensordot(normal, elbow, axes=1), -jnp.tensordot(normal, speed, axes=1)
    return jnp.concatenate([pull / arm.length, spin]), room, rate


@fused_separately
def _least_motions(columns: Array, inverse: Array, effects: Array) -> tuple[Array, Array]:
    """The least joint motions with effects ``(6, 2, ...)``."""
    motions = _product(jnp.swapaxes(columns, 0, 1), _product(inverse, effects))
    return motions[:, 0], motions[:, 1]


def _product(a: Array, b: Array) -> Array:
    """Matrix product of ``(rows, k, ...)`` and ``(k, columns, ...)``, a sum of terms that processors work in lanes."""
    return functools.reduce(jnp.add, [a[:, k, None] * b[k][None] for k in range(len(b))])


def _inverse(gram: Array) -> Array:
    """Inverse of symmetric positive matrices ``(6, 6, ...)``, kept finite where they are singular (Gauss-Jordan)."""
    count = len(gram)
    eye = jnp.eye(count, dtype=gram.dtype).reshape(count, count, *(1,) * (gram.ndim - 2))
    trace = jnp.sum(gram * eye, axis=(0, 1))
    rows = jnp.concatenate([gram, jnp.broadcast_to(eye, gram.shape)], axis=1)
    floor = 4.0 * float(jnp.finfo(gram.dtype).eps) * trace

    def eliminate(k: Array, rows: Array) -> Array:
        pivot = jnp.maximum(rows[k, k], floor)
        row = rows[k] / pivot
        return (rows - rows[:, k][:, None] * row).at[k].set(row)

    return lax.fori_loop(0, count, eliminate, rows)[:, count:]
