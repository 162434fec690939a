"""Spherical joints: three orthogonal axes through one point, from a rotation to their angles, both solutions.

With M = Cᵀ R C Ry(delta) such a joint is ZYZ (see :mod:`jaxik.ik.arm_constants`). The third angle is read off after the
first has been undone, not from the matrix itself, so that the pair stays consistent where M02 and M12 are all rounding.
Where they vanish the first angle is 0, or as near to it as the limits of both allow, and the third takes the rest of
the turn; the derivative there is that of the motions that keep the first angle still.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxik.arm import Arm
from jaxik.numerics import Tolerances, fused_separately, tolerances, with_value, wrap


class ZYZRotation(NamedTuple):
    """Entries of a ZYZ rotation M that its angles are read from.

    Attributes:
        last: Last column, ``(3, ...)``.
        corner: First two rows of the other columns, ``(2, 2, ...)``; ``(2, 0, ...)`` leaves the third angle out.
    """

    last: Array
    corner: Array


def zyz_sides(m: ZYZRotation, tol: Tolerances) -> tuple[Array, Array, Array]:
    """Return opposite and adjacent sides of the angles of a ZYZ rotation whose middle angle is not negative.

    Returns:
        Both sides, ``(angles, ...)`` each, and the squared sine of the middle angle, ``(...)``.
    """
    x, y, z = m.last
    sine2 = x * x + y * y
    aligned = sine2 <= tol.aligned**2
    inverse = 1.0 / jnp.sqrt(jnp.maximum(sine2, tol.aligned**2))
    cos, sin = jnp.where(aligned, 1.0, x * inverse), jnp.where(aligned, 0.0, y * inverse)
    opposite = [jnp.where(aligned, 0.0, y), cos * x + sin * y]
    adjacent = [jnp.where(aligned, 1.0, x), z]
    if m.corner.shape[1]:
        third = cos * m.corner[1] - sin * m.corner[0]
        opposite.append(third[0])
        adjacent.append(third[1])
    return jnp.stack(opposite), jnp.stack(adjacent), sine2


def both_solutions(angles: Array, delta: Array) -> Array:
    """Return both solutions of a spherical joint, (q1, q2, q3) and (q1 + pi, -q2 - 2 delta, q3 + pi).

    Args:
        angles: ZYZ angles, ``(angles, ...)`` [rad].
        delta: Middle ZYZ angle less the joint's own, ``()`` or broadcast [rad].

    Returns:
        Joint angles ``(2, angles, ...)`` [rad] in (-pi, pi].
    """
    spread = (-1,) + (1,) * (angles.ndim - 1)
    middle = jnp.array([False, True, False])[: angles.shape[0]].reshape(spread)
    flip = jnp.array([False, True]).reshape((-1, 1) + (1,) * (angles.ndim - 1))
    half_turn = jnp.where(angles > 0.0, angles - jnp.pi, angles + jnp.pi)
    both = jnp.where(flip, jnp.where(middle, -angles, half_turn), angles)
    return wrap(both - jnp.where(middle, delta, jnp.zeros_like(delta)))


def split_within_limits(
    arm: Arm, first: int, delta: Array, angles: Array, aligned: Array, *, pointing: bool = False
) -> Array:
    """Split the turn of aligned joints so that both outer angles are within limits, where they can be.

    Args:
        arm: The arm.
        first: Index of the spherical joint's first joint.
        delta: Middle ZYZ angle less the joint's own, ``(1,)`` [rad].
        angles: Joint angles, ``(bit, 3 or 2, elbow bit, n)`` [rad].
        aligned: True where the middle angle is 0 or half a turn, ``(elbow bit, n)``.
        pointing: True for a wrist whose last joint the target leaves alone.

    Returns:
        The angles; the first one as near to what it was as the limits allow [rad]. Derivatives are those of ``angles``.
    """
    arm, delta, now = jax.lax.stop_gradient((arm, delta, angles))
    z = jnp.cos(now[:, 1] + delta)
    return with_value(angles, split_values(arm, first, now, z, aligned, pointing=pointing))


def split_values(arm: Arm, first: int, angles: Array, z: Array, aligned: Array, *, pointing: bool = False) -> Array:
    """Return the values of :func:`split_within_limits`, of the middle angle's cosine, ``(elbow bit, n)``."""
    lower, upper = arm.lower[first : first + 3], arm.upper[first : first + 3]
    if pointing:  # the roll of a hand that points is free
        return angles.at[:, 0].set(jnp.where(aligned, jnp.clip(angles[:, 0], lower[0], upper[0]), angles[:, 0]))
    outer = _split(lower, upper, angles[:, 0], angles[:, 2], z, aligned)
    return _joined(outer[0], angles[:, 1], outer[1])


@fused_separately
def _split(lower: Array, upper: Array, own: Array, third: Array, z: Array, aligned: Array) -> tuple[Array, Array]:
    """Both outer angles, ``(bit, elbow bit, n)``; apart from what stacks them, so that each is one vector loop."""
    t = jnp.clip(own, lower[0], upper[0])
    pole = jnp.where(z > 0.0, 1.0, -1.0).astype(t.dtype)
    ends = _finite(lower[2], upper[2])
    low, high = jnp.where(pole > 0.0, ends[0], -ends[1]), jnp.where(pole > 0.0, ends[1], -ends[0])
    # The rest for the third angle, past the lower end of its range; beyond the upper end the first angle turns.
    rest = own - t + pole * third - low
    rest = rest - 2 * jnp.pi * jnp.floor(rest / (2 * jnp.pi))
    on, back = jnp.maximum(rest - (high - low), 0.0), 2 * jnp.pi - rest
    slack = tolerances(t.dtype).limit
    can_on, can_back = t + on <= upper[0] + slack, t - back >= lower[0] - slack
    goes_on = can_on & (~can_back | (on <= back))
    split = aligned & (can_on | can_back)
    t = jnp.clip(t + jnp.where(goes_on, on, -back), lower[0], upper[0])
    rest = pole * jnp.where(goes_on, jnp.minimum(low + rest, high), low)
    return jnp.where(split, t, own), jnp.where(split, rest, third)


@fused_separately
def _joined(*angles: Array) -> Array:
    return jnp.stack(angles, axis=1)


def _finite(lower: Array, upper: Array) -> tuple[Array, Array]:
    """A range with a turn in the place of endless ends [rad]."""
    least = jnp.where(jnp.isinf(lower), jnp.where(jnp.isinf(upper), -jnp.pi, upper - 2 * jnp.pi), lower)
    return least, jnp.where(jnp.isinf(upper), least + 2 * jnp.pi, upper)
