"""Joint ranges, on rows of angles."""

import jax.numpy as jnp
from jax import Array

from jaxik.arm.arm import Arm


def fit_to_limits(arm: Arm, joints: tuple[int, ...], angles: Array) -> Array:
    """Moves each angle by a turn where only that lies in its joint's range.

    Args:
        arm: The arm.
        joints: The joint each row belongs to.
        angles: ``(rows, n)`` [rad] in (-pi, pi].
    """
    low, high = _range(arm, joints, angles)
    up, down = angles + 2 * jnp.pi, angles - 2 * jnp.pi
    return jnp.where((angles < low) & (up <= high), up, jnp.where((angles > high) & (down >= low), down, angles))


def within_limits(arm: Arm, joints: tuple[int, ...], fitted: Array) -> Array:
    """Which of the angles that :func:`fit_to_limits` gave are inside, ``(rows, n)``.

    Being at a limit counts as inside to 4096 eps (1e-12 rad in float64): a joint vector on its limit must survive the
    trip through forward and inverse kinematics.
    """
    low, high = _range(arm, joints, fitted)
    return (fitted >= low) & (fitted <= high)


def _range(arm: Arm, joints: tuple[int, ...], angles: Array) -> tuple[Array, Array]:
    slack = 4096 * float(jnp.finfo(angles.dtype).eps)
    index = jnp.asarray(joints)
    return arm.lower[index, None] - slack, arm.upper[index, None] + slack
