"""Joint ranges, on rows of angles."""

import jax
import jax.numpy as jnp
from jax import Array

from jaxik.arm.arm import Arm
from jaxik.numerics import tolerances

_TURN = 2 * jnp.pi


def fit_to_limits(arm: Arm, joints: tuple[int, ...], angles: Array) -> Array:
    """Move each angle by the full turns that bring it into its joint's range, the fewest that do; else leave it.

    An angle at a limit counts as inside to 4096 eps (1e-12 rad in float64, 5e-4 in float32), so that joint angles on a
    limit survive forward and inverse kinematics. It is then put exactly on the limit.

    Args:
        arm: The arm; its ranges may lie any number of turns from zero.
        joints: Joint of each row.
        angles: Angles, ``(rows, n)`` [rad] in (-pi, pi].

    Returns:
        The angles, ``(rows, n)`` [rad].

    **Differentiability**: derivative one in the angles.
    """
    lower, upper = _range(arm, joints)
    slack = tolerances(angles.dtype).limit
    low, high = lower - slack, upper + slack
    # The turn in which the part of the range nearest to zero lies; from there one turn suffices.
    near = angles + _TURN * jnp.round(jnp.clip(0.0, low, high) / _TURN)
    moved = jnp.where(near < low, near + _TURN, jnp.where(near > high, near - _TURN, near))
    on_range = clip_value(moved, lower, upper)
    return jnp.where(jnp.abs(moved - on_range) <= slack, on_range, angles)


def within_limits(arm: Arm, joints: tuple[int, ...], fitted: Array) -> Array:
    """Return the mask ``(rows, n)`` of angles from :func:`fit_to_limits` that are within their limits, exactly."""
    lower, upper = _range(arm, joints)
    return (fitted >= lower) & (fitted <= upper)


def resting_angle(arm: Arm) -> Array:
    """Return the angle of the last of seven joints where a pointing target leaves it alone: 0, or its nearest limit."""
    return jnp.clip(jnp.zeros_like(arm.lower[6]), arm.lower[6], arm.upper[6])


@jax.custom_jvp
def clip_value(angle: Array, lower: Array, upper: Array) -> Array:
    """Clip an angle that may be outside its limits by rounding; the derivative is that of the angle."""
    return jnp.clip(angle, lower, upper)


@clip_value.defjvp
def _clip_value_jvp(primals: tuple[Array, ...], tangents: tuple[Array, ...]) -> tuple[Array, Array]:
    return clip_value(*primals), tangents[0]


def _range(arm: Arm, joints: tuple[int, ...]) -> tuple[Array, Array]:
    index = jnp.asarray(joints)
    return arm.lower[index, None], arm.upper[index, None]
