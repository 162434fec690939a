"""Keeps bad rows from harming anything: they are replaced before the arithmetic, and say so in their status."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxik.arm import Arm
from jaxik.numerics import Tolerances, fused_separately, tolerances, vec3


class Screened(NamedTuple):
    """A target whose every row is finite and proper, batch last."""

    position: Array  # (3, n)
    directions: Array  # the rotation (3, 3, n), or the unit pointing direction alone (3, 1, n)
    swivel: Array
    invalid: Array
    nonfinite: Array


@fused_separately
def screen(arm: Arm, position: Array, directions: Array, swivel: Array) -> Screened:
    """Puts the arm's zero posture in the place of every unusable row.

    Selecting before the arithmetic also makes the derivative of a replaced row exactly zero and leaves every other
    row's untouched.
    """
    tol = tolerances(swivel.dtype)
    home, home_axes = arm.tool_position[:, None], arm.tool_rotation[:, :, None]
    nonfinite = ~(_all(jnp.isfinite(position)) & _all(jnp.isfinite(directions)) & jnp.isfinite(swivel))
    if directions.shape[1] == 3:
        proper, usable = _is_rotation(directions, tol), directions
    else:
        home_axes = home_axes[:, 2:]
        usable, has_length = unit_direction(directions, home_axes)
        proper = has_length & _can_point(arm, tol)
    proper = proper & (jnp.abs(swivel) <= tol.angle)
    return Screened(
        position=jnp.where(nonfinite, home, within_squares(position)),
        directions=jnp.where(nonfinite | ~proper, home_axes, usable),
        swivel=jnp.where(nonfinite | ~proper, 0.0, swivel),
        invalid=~proper,
        nonfinite=nonfinite,
    )


def within_squares(x: Array) -> Array:
    """Numbers cut off where their squares' products would overflow: 1e77 in float64, 4e9 in float32.

    So long a position is out of reach all the same.
    """
    bound = float(jnp.finfo(x.dtype).max) ** 0.25
    return jnp.clip(x, -bound, bound)


def unit_direction(direction: Array, instead: Array) -> tuple[Array, Array]:
    """Normalises directions ``(3, 1, n)`` of any length; a row without one, or not finite, becomes ``instead``.

    Returns:
        Unit vectors, and which rows were given as a direction.
    """
    # Scaling by the largest entry first keeps the length of very long or short directions from over- or underflowing.
    # It is a mere scale, so no derivative: that of a maximum is NaN where an entry is.
    largest = jnp.max(jnp.abs(jax.lax.stop_gradient(direction[:, 0])), axis=0)
    proper = (largest >= jnp.finfo(largest.dtype).tiny) & jnp.isfinite(largest)
    scaled = jnp.where(proper, direction / jnp.where(proper, largest, 1.0), instead)
    return scaled / jnp.sqrt(vec3.dot(scaled, scaled)), proper


def _is_rotation(axes: Array, tol: Tolerances) -> Array:
    x, y, z = axes[:, 0], axes[:, 1], axes[:, 2]
    off = jnp.stack([vec3.dot(x, x) - 1.0, vec3.dot(y, y) - 1.0, vec3.dot(x, y), *(vec3.cross(x, y) - z)])
    return _all(jnp.abs(off) <= tol.rotation)


def _can_point(arm: Arm, tol: Tolerances) -> Array:
    """Whether the hand lies along the tool's z axis and the last joint, if there is one, only rolls it."""
    hand, z = arm.tool_position - arm.wrist, arm.tool_rotation[:, 2]
    aside = vec3.cross(hand, z)
    straight = vec3.dot(aside, aside) <= tol.rotation**2 * vec3.dot(hand, hand)
    if arm.n_joints == 6:
        return straight
    roll = vec3.cross(arm.axes[6], z)
    return straight & (vec3.dot(roll, roll) <= tol.rotation**2)


def _all(conditions: Array) -> Array:
    """Conjunction over every axis but the last."""
    return jnp.all(conditions, axis=tuple(range(conditions.ndim - 1)))
