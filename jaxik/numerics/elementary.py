"""Scalar building blocks that stay exact and differentiable where the textbook forms do not."""

import math

import jax
import jax.numpy as jnp
from jax import Array

from jaxik.numerics.fusion import fused_separately
from jaxik.numerics.tolerances import tolerances


@jax.custom_jvp
def with_value(x: Array, value: Array) -> Array:
    """Return ``value`` with the derivative of ``x``."""
    return value


@with_value.defjvp
def _with_value_jvp(primals: tuple[Array, Array], tangents: tuple[Array, Array]) -> tuple[Array, Array]:
    return primals[1], tangents[0]


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


@jax.custom_jvp
def clipped_sqrt(x: Array) -> Array:
    """Square root of x, 0 where x is not positive, with derivative 0 there and of at most 1 / (2 eps).

    The usual select around the root of a placeholder is no replacement where x is rounding: the compiler may compute x
    twice, in two kernels that round differently, take the placeholder in one and its root for the value in the other.
    """
    return jnp.sqrt(jnp.maximum(x, 0.0))


@clipped_sqrt.defjvp
def _clipped_sqrt_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    (x,), (dx,) = primals, tangents
    least = float(jnp.finfo(x.dtype).eps) ** 2
    return clipped_sqrt(x), jnp.where(x > 0.0, 0.5 / jnp.sqrt(jnp.maximum(x, least)), 0.0) * dx


# Minimax coefficients of (atan(t)/t - 1)/t² in t², for |t| <= tan(pi/8): relative error 6.5e-10 and 1.2e-18.
_ATAN_SINGLE = (
    -0.3333331555637434,
    0.19998492856293139,
    -0.1424391810218316,
    0.10596546176413013,
    -0.06084907261742606,
)
_ATAN_DOUBLE = (
    -0.3333333333333319998,
    0.1999999999995435064,
    -0.1428571428027703073,
    0.1111111078762891008,
    -0.09090897881008535767,
    0.07692062456973938617,
    -0.06663129987751329819,
    0.05848080715220633516,
    -0.05040177099479824728,
    0.03808693830984061758,
    -0.01793191546274199677,
)


@jax.custom_jvp
def arctan2(y: Array, x: Array) -> Array:
    """Angle of (x, y) in (-pi, pi], within 2 ulp; 0 at the origin.

    Branch-free polynomial: the compiler turns the library's arctan2 into one scalar call per element on CPUs, which is
    half of a solve. The derivative is the exact one, and 0 at the origin.
    """
    y, x = jnp.broadcast_arrays(y, x)
    ax, ay = jnp.abs(x), jnp.abs(y)
    small, large = jnp.minimum(ax, ay), jnp.maximum(ax, ay)
    # Above tan(pi/8) turn by -pi/4 first, with the quotient's terms so that one division serves both cases.
    turned = small > 0.41421356 * large
    numerator = jnp.where(turned, small - large, small)
    denominator = jnp.where(turned, small + large, large)
    t = numerator / jnp.where(denominator == 0.0, 1.0, denominator)
    z = t * t
    coefficients = _ATAN_SINGLE if jnp.finfo(x.dtype).bits <= 32 else _ATAN_DOUBLE
    p = jnp.full_like(z, coefficients[-1])
    for c in reversed(coefficients[:-1]):
        p = p * z + c
    angle = t + t * (z * p)
    # From here on only t, y and x are used again, so that the compiler needs no more than two passes: what was turned
    # has t < 0, or equal sides, where t is 0.
    equal = (jnp.abs(y) == jnp.abs(x)) & (y != 0.0)
    angle = jnp.where((t < 0.0) | equal, jnp.pi / 4 + angle, angle)
    angle = jnp.where(jnp.abs(y) > jnp.abs(x), jnp.pi / 2 - angle, angle)
    angle = jnp.where(x < 0.0, jnp.pi - angle, angle)
    return jnp.where(y < 0.0, -angle, angle)


@arctan2.defjvp
def _arctan2_jvp(primals: tuple[Array, Array], tangents: tuple[Array, Array]) -> tuple[Array, Array]:
    (y, x), (dy, dx) = primals, tangents
    r2 = x * x + y * y
    inverse = jnp.where(r2 == 0.0, 0.0, 1.0 / jnp.where(r2 == 0.0, 1.0, r2))
    return arctan2(y, x), (x * inverse) * dy - (y * inverse) * dx


# pi/2 in three parts, the first two short enough that their products with a quarter-turn count are exact, and Taylor
# coefficients of sin and cos on [-pi/4, pi/4] (truncation below 1e-17 and 3e-9).
_HALF_PI_DOUBLE = (1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21)
_HALF_PI_SINGLE = (1.5703125, 4.837512969970703125e-4, 7.549789948768648e-8)


@jax.custom_jvp
def sincos(x: Array) -> tuple[Array, Array]:
    """Sine and cosine of x [rad], within 2 ulp of 1 for angles up to ``tolerances(x.dtype).angle``; finite beyond.

    Branch-free polynomials, for the reason given at :func:`arctan2`. The derivatives are the exact ones.
    """
    single = jnp.finfo(x.dtype).bits <= 32
    quarter = jnp.round(x * (2.0 / jnp.pi))
    r = x
    for part in _HALF_PI_SINGLE if single else _HALF_PI_DOUBLE:
        r = r - quarter * part
    r = jnp.clip(r, -1.0, 1.0)
    z = r * r
    terms = 4 if single else 8
    sin, cos = jnp.zeros_like(z), jnp.zeros_like(z)
    for k in range(terms, 0, -1):
        sin = (sin + (-1.0) ** k / math.factorial(2 * k + 1)) * z
        cos = (cos + (-1.0) ** k / math.factorial(2 * k)) * z
    sin, cos = r + r * sin, 1.0 + cos
    # The quarter turn's number modulo 4, in floating point: 1 and 3 exchange the two, 2 and 3 turn the sign.
    turn = quarter - 4.0 * jnp.floor(0.25 * quarter)
    odd = (turn == 1.0) | (turn == 3.0)
    s, c = jnp.where(odd, cos, sin), jnp.where(odd, sin, cos)
    return jnp.where(turn >= 2.0, -s, s), jnp.where((turn == 1.0) | (turn == 2.0), -c, c)


@sincos.defjvp
def _sincos_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    (x,), (dx,) = primals, tangents
    sin, cos = sincos(x)
    return (sin, cos), (cos * dx, -sin * dx)


sincos_apart = fused_separately(sincos)
""":func:`sincos`, compiled apart from its surroundings: whoever uses both halves would compute each again."""
