"""Joint motions without jumps of a full turn."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxik.arm import Arm


def turning_joints(arm: Arm) -> tuple[bool, ...]:
    """Joints whose range spans a full turn or more: for them 2 pi is no motion."""
    span = np.asarray(arm.upper) - np.asarray(arm.lower)
    return tuple(bool(s >= 2 * np.pi * (1 - 1e-6)) for s in span)


def unwrap(q: Float[Array, "waypoint joint"], turning: Sequence[bool] | Array) -> Float[Array, "waypoint joint"]:
    """Adds full turns so that turning joints never step by more than half a turn.

    **Differentiability**: derivative one in q.
    """
    step = jnp.diff(q, axis=0)
    turns = jnp.cumsum(jnp.round(step / (2 * jnp.pi)), axis=0)
    turns = jnp.concatenate([jnp.zeros_like(q[:1]), turns]) * jnp.asarray(turning, q.dtype)
    return q - 2 * jnp.pi * turns
