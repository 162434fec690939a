"""Bad rows of a target: replaced before the arithmetic, so that they harm nothing, and marked for their status."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxik.arm import Arm
from jaxik.numerics import Tolerances, fused_separately, tolerances, vec3


class CheckedTarget(NamedTuple):
    """Target with finite and proper rows only, batch last.

    Attributes:
        position: Tool points, ``(3, n)`` [m].
        directions: Rotations ``(3, 3, n)``, or unit pointing directions ``(3, 1, n)``.
        swivel: Angles of the elbow on its circle, ``(n,)`` [rad].
        invalid: Rows whose rotation, direction or swivel was replaced, ``(n,)``.
        nonfinite: Rows that held NaN or infinity, ``(n,)``.
    """

    position: Array
    directions: Array
    swivel: Array
    invalid: Array
    nonfinite: Array


@fused_separately
def replace_bad_rows(arm: Arm, position: Array, directions: Array, swivel: Array) -> CheckedTarget:
    """Replace every bad row by the arm's zero posture.

    Selecting before the arithmetic also makes the derivative of a replaced row exactly zero, and leaves those of the
    others as they are.
    """
    tol = tolerances(swivel.dtype)
    home, home_axes = arm.tool_position[:, None], arm.tool_rotation[:, :, None]
    nonfinite = ~(_all(jnp.isfinite(position)) & _all(jnp.isfinite(directions)) & jnp.isfinite(swivel))
    if directions.shape[1] == 3:
        proper, unit = _is_rotation(directions, tol), directions
    else:
        home_axes = home_axes[:, 2:]
        unit, has_length = unit_direction(directions, home_axes)
        proper = has_length & _can_point(arm, tol)
    proper = proper & (jnp.abs(swivel) <= tol.angle)
    return CheckedTarget(
        position=jnp.where(nonfinite, home, within_squares(position)),
        directions=jnp.where(nonfinite | ~proper, home_axes, unit),
        swivel=jnp.where(nonfinite | ~proper, 0.0, swivel),
        invalid=~proper,
        nonfinite=nonfinite,
    )


def within_squares(x: Array) -> Array:
    """Clip numbers where products of their squares would overflow, at 1e77 in float64 and 4e9 in float32.

    A position that far away is out of reach all the same.
    """
    bound = float(jnp.finfo(x.dtype).max) ** 0.25
    return jnp.clip(x, -bound, bound)


def unit_direction(direction: Array, instead: Array) -> tuple[Array, Array]:
    """Normalize directions ``(3, 1, n)`` of any length; one without length, or not finite, becomes ``instead``.

    Returns:
        Unit vectors ``(3, 1, n)``, and the mask ``(n,)`` of those that are not replaced.
    """
    # Scaling by the largest entry first keeps very long or short directions from over- or underflowing. The scale
    # cancels, so it needs no derivative; that of a maximum would be NaN where an entry is.
    largest = jnp.max(jnp.abs(jax.lax.stop_gradient(direction[:, 0])), axis=0)
    proper = (largest >= jnp.finfo(largest.dtype).tiny) & jnp.isfinite(largest)
    scaled = jnp.where(proper, direction / jnp.where(proper, largest, 1.0), instead)
    return scaled / jnp.sqrt(vec3.dot(scaled, scaled)), proper


def _is_rotation(axes: Array, tol: Tolerances) -> Array:
    x, y, z = axes[:, 0], axes[:, 1], axes[:, 2]
    off = jnp.stack([vec3.dot(x, x) - 1.0, vec3.dot(y, y) - 1.0, vec3.dot(x, y), *(vec3.cross(x, y) - z)])
    return _all(jnp.abs(off) <= tol.rotation)


def _can_point(arm: Arm, tol: Tolerances) -> Array:
    """Check that the tool point is on the tool's z axis through the wrist and that a seventh joint only rolls it.

    Lengths are relative to the arm's: a hand of no length, up to rounding, has no direction of its own.
    """
    hand, z = arm.tool_position - arm.wrist, arm.tool_rotation[:, 2]
    aside = vec3.cross(hand, z)
    straight = vec3.dot(aside, aside) <= (tol.rotation * arm.length) ** 2
    if arm.n_joints == 6:
        return straight
    roll = vec3.cross(arm.axes[6], z)
    return straight & (vec3.dot(roll, roll) <= tol.rotation**2)


def _all(conditions: Array) -> Array:
    """Combine conditions over every axis but the last."""
    return jnp.all(conditions, axis=tuple(range(conditions.ndim - 1)))
