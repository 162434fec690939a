"""The present posture, weights, and ranges in which every angle stands for one posture."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxik.numerics import tolerances

TURN = 2 * np.pi


class Nearness(NamedTuple):
    """The present posture, and the ranges in which a near one is wanted.

    Attributes:
        q_now: Present joint angles, ``(joint, n)`` [rad].
        weights: Weights of the squared joint motion, ``(joint,)``.
        lower: Lower ends of the ranges, ``(joint, n)`` [rad].
        upper: Upper ends, at most a turn above, ``(joint, n)`` [rad]; below the lower ends where nothing is in range.
    """

    q_now: Array
    weights: Array
    lower: Array
    upper: Array


class Nearest(NamedTuple):
    """The least motion of n rows.

    Attributes:
        swivel: Its swivel, ``(n,)`` [rad].
        branch: Its branch, ``(n,)``.
        moved: Weighted squared joint motion, ``(n,)`` [rad²].
        off: Joint motion, ``(joint, n)`` [rad].
    """

    swivel: Array
    branch: Array
    moved: Array
    off: Array


def within_a_turn(q_now: Array, weights: Array, lower: Array, upper: Array) -> Nearness:
    """Cut ranges to at most one turn, in which each angle is at the turn nearest to the present one.

    Args:
        q_now: Present angles, ``(joint, n)`` [rad].
        weights: Weights, ``(joint,)``.
        lower: Lower ends of the ranges, ``(joint, n or 1)`` [rad].
        upper: Upper ends, likewise.
    """
    near_low = jnp.minimum(q_now - jnp.pi, upper - TURN)
    near_high = jnp.maximum(q_now + jnp.pi, lower + TURN)
    return Nearness(q_now, weights, jnp.maximum(lower, near_low), jnp.minimum(upper, near_high))


def stacked(*ranges: Nearness) -> tuple[Array, Array]:
    """Return the ends of several ranges and of a turn about the present angles, ``(range, joint, n)`` each."""
    now = ranges[0].q_now
    lower, upper = [r.lower for r in ranges], [r.upper for r in ranges]
    return jnp.stack([*lower, now - jnp.pi]), jnp.stack([*upper, now + jnp.pi])


def from_lower(angle: Array, lower: Array) -> Array:
    """Move angles to the turn that begins at a lower end, which an angle meets to rounding."""
    return angle - TURN * jnp.floor((angle - lower + tolerances(angle.dtype).limit) / TURN)
