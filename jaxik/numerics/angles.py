"""Angles on the circle: wrapping, shortest differences, unwrapping, and the turn that joint limits admit."""

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

_TURN = 2 * jnp.pi


def wrap(angle: Array) -> Array:
    """Bring an angle that is at most one turn outside (-pi, pi] back into it."""
    angle = jnp.where(angle > jnp.pi, angle - _TURN, angle)
    return jnp.where(angle <= -jnp.pi, angle + _TURN, angle)


def principal(angle: Array) -> Array:
    """Bring an angle, or a difference of two, within half a turn of zero, however many turns it is away."""
    return angle - _TURN * jnp.round(angle / _TURN)


def shortest(difference: Array, turning: ArrayLike) -> Array:
    """Joint motion of a step: the short way round for joints whose range exceeds a turn, else the difference itself.

    Args:
        difference: Difference of joint angles [rad].
        turning: Joints with both ways open (:attr:`jaxik.Arm.turning`), broadcast against the difference.

    Returns:
        The motion, of the difference's shape [rad].
    """
    return difference - jnp.where(turning, _TURN, 0.0).astype(difference.dtype) * jnp.round(difference / _TURN)


def unwrap(q: Array, turning: ArrayLike) -> Array:
    """Add full turns so that turning joints never step by more than half a turn.

    Args:
        q: Joint angles, ``(waypoint, joint)`` [rad].
        turning: Joints with both ways round open, ``(joint,)``.

    Returns:
        The same postures without jumps of a full turn, ``(waypoint, joint)`` [rad].

    **Differentiability**: derivative one in ``q``.
    """
    turns = jnp.cumsum(jnp.round(jnp.diff(q, axis=0) / _TURN), axis=0)
    turns = jnp.concatenate([jnp.zeros_like(q[:1]), turns]) * jnp.asarray(turning, q.dtype)
    return q - _TURN * turns


def toward(angle: Array, reference: Array, lower: Array, upper: Array) -> Array:
    """Choose the turn of an angle that lies in a range; of several such turns, the one nearest to a reference.

    An angle on a limit to rounding counts as in the range, and stays outside by that much.

    Args:
        angle: Angle [rad].
        reference: Angle to be near to [rad].
        lower: Lower end of the range [rad].
        upper: Upper end of the range [rad]. All four broadcast.

    Returns:
        The angle plus full turns: within the range where any turn is.
    """
    # An angle on its lower limit to rounding must not wrap to the far end.
    slack = 1e5 * float(jnp.finfo(angle.dtype).eps)
    only = angle - _TURN * jnp.floor((angle - lower + slack) / _TURN)
    nearest = angle - _TURN * jnp.round((angle - jnp.clip(reference, lower, upper)) / _TURN)
    past, short = nearest > upper + slack, nearest < lower - slack
    nearest = jnp.where(past, nearest - _TURN, jnp.where(short, nearest + _TURN, nearest))
    return jnp.where(upper - lower >= _TURN, nearest, only)
