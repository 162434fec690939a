"""The energy that policies work with, the squared motion of the joints."""

import jax.numpy as jnp
from jax import Array

from jaxik.arm import Arm
from jaxik.planning.fast.coarse_costs import Start
from jaxik.planning.fast.path_batch import near, steps


def path_motion(q: Array, time: Array, weight: Array, start: Start) -> Array:
    """Σ w Δq² / dt of joint angles ``(joint, K, B)`` with the way from the start, ``(B,)``.

    Args:
        q: Joint angles [rad].
        time: ``(K, B)`` [s].
        weight: Of the joints' motion, ``(joint,)``.
        start: Where the arms come from.
    """
    rate = 1.0 / jnp.diff(time, axis=0)
    moved = jnp.sum(weight[:, None] * jnp.sum(steps(q) ** 2 * rate, axis=1), axis=0)
    coming = jnp.sum(weight[:, None] * near(q[:, 0] - start.q) ** 2, axis=0) * start.rate
    return moved + coming


def too_fast(arm: Arm, q: Array, time: Array) -> Array:
    """Whether a joint is faster than it may be, the shorter way where it turns without end, ``(B,)``."""
    step = jnp.diff(q, axis=1)
    turning = (arm.upper - arm.lower >= 2 * jnp.pi * (1 - 1e-6))[:, None, None]
    limit = arm.velocity_limit[:, None, None] * jnp.diff(time, axis=0)
    return jnp.any(jnp.abs(jnp.where(turning, near(step), step)) > limit, axis=(0, 1))
