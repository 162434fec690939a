"""Scalar building blocks that stay exact and differentiable where the textbook forms do not."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array


class Tolerances(NamedTuple):
    """Thresholds of the geometry, each a multiple of the dtype's resolution eps.

    Attributes:
        singular: 64 eps. Sine below which a direction carries no information: the inputs' own rounding is a few eps, and
            anything above still has relative accuracy eps / sine, which the derivatives need.
        near_singular: eps^(3/8): 1.3e-6 in float64, 2.5e-3 in float32. Sine below which NEAR_SINGULAR is reported: joint
            speeds there exceed the tool's by about a million (float64).
        rotation: 1e-6 in float64, 3.6e-5 in float32. Largest entry of RᵀR - I and of det R - 1 taken for rounding: targets
            computed in float32 and passed on in float64 stay valid.
    """

    singular: float
    near_singular: float
    rotation: float


def tolerances(dtype: jnp.dtype) -> Tolerances:
    """The thresholds for a dtype."""
    eps = float(jnp.finfo(dtype).eps)
    return Tolerances(singular=64 * eps, near_singular=eps**0.375, rotation=max(1e-6, 300 * eps))


@jax.custom_jvp
def unit_sqrt(x: Array) -> Array:
    """Square root of x clipped to [0, 1], with a bounded derivative.

    The derivative is that of the root inside, at most 1 / (2 sqrt(64 eps)) at the lower end, where the root's own is
    infinite, and exactly zero once x is outside by more than rounding: there the clipped value no longer moves.
    """
    return jnp.sqrt(jnp.clip(x, 0.0, 1.0))


@unit_sqrt.defjvp
def _unit_sqrt_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    (x,), (dx,) = primals, tangents
    floor = tolerances(x.dtype).singular
    inside = (x >= -floor) & (x <= 1.0 + floor)
    slope = jnp.where(inside, 0.5 / jnp.sqrt(jnp.clip(x, floor, 1.0)), 0.0)
    return unit_sqrt(x), slope * dx


def arctan2(y: Array, x: Array) -> Array:
    """Angle of (x, y) in (-pi, pi]."""
    return jnp.arctan2(y, x)


def sincos(x: Array) -> tuple[Array, Array]:
    """Sine and cosine of x [rad]."""
    return jnp.sin(x), jnp.cos(x)


def wrap(angle: Array) -> Array:
    """An angle of at most one turn too many, brought back to (-pi, pi]."""
    angle = jnp.where(angle > jnp.pi, angle - 2 * jnp.pi, angle)
    return jnp.where(angle <= -jnp.pi, angle + 2 * jnp.pi, angle)
