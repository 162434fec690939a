"""Angles on the circle: wrapping, differences, and motions without jumps of a full turn."""

import jax.numpy as jnp
from jax import Array


def wrap(angle: Array) -> Array:
    """An angle of at most one turn too many, brought back to (-pi, pi]."""
    angle = jnp.where(angle > jnp.pi, angle - 2 * jnp.pi, angle)
    return jnp.where(angle <= -jnp.pi, angle + 2 * jnp.pi, angle)
