"""Joint ranges, on rows of angles."""

import jax.numpy as jnp
from jax import Array

from jaxik.arm import Arm


def fit_to_limits(arm: Arm, joints: tuple[int, ...], angles: Array) -> tuple[Array, Array]:
    """Moves each angle by a turn where only that lies in its joint's range, and says which are inside.

    Being at a limit counts as inside to 4096 eps (1e-12 rad in float64): a joint vector on its limit must survive the
    trip through forward and inverse kinematics.

    Args:
        arm: The arm.
        joints: The joint each row belongs to.
        angles: ``(rows, n)`` [rad] in (-pi, pi].

    Returns:
        The angles and whether each is inside, ``(rows, n)``.
    """
    slack = 4096 * float(jnp.finfo(angles.dtype).eps)
    index = jnp.asarray(joints)
    low, high = arm.lower[index, None] - slack, arm.upper[index, None] + slack
    up, down = angles + 2 * jnp.pi, angles - 2 * jnp.pi
    fitted = jnp.where((angles < low) & (up <= high), up, jnp.where((angles > high) & (down >= low), down, angles))
    return fitted, (fitted >= low) & (fitted <= high)
