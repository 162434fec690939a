"""Joint ranges, on rows of angles."""

import jax.numpy as jnp
from jax import Array

from jaxik.arm.arm import Arm


def fit_to_limits(arm: Arm, joints: tuple[int, ...], angles: Array) -> Array:
    """Move each angle by a turn where only the moved one lies in its joint's range.

    Args:
        arm: The arm.
        joints: Joint of each row.
        angles: Angles, ``(rows, n)`` [rad] in (-pi, pi].

    Returns:
        The angles, ``(rows, n)`` [rad].
    """
    low, high = _range(arm, joints, angles)
    up, down = angles + 2 * jnp.pi, angles - 2 * jnp.pi
    return jnp.where((angles < low) & (up <= high), up, jnp.where((angles > high) & (down >= low), down, angles))


def within_limits(arm: Arm, joints: tuple[int, ...], fitted: Array) -> Array:
    """Return the mask ``(rows, n)`` of angles from :func:`fit_to_limits` that are within their limits.

    An angle at a limit counts as inside to 4096 eps (1e-12 rad in float64), so that joint angles on a limit survive
    forward and inverse kinematics.
    """
    low, high = _range(arm, joints, fitted)
    return (fitted >= low) & (fitted <= high)


def _range(arm: Arm, joints: tuple[int, ...], angles: Array) -> tuple[Array, Array]:
    slack = 4096 * float(jnp.finfo(angles.dtype).eps)
    index = jnp.asarray(joints)
    return arm.lower[index, None] - slack, arm.upper[index, None] + slack
