"""Functions a + b cos(psi) + c sin(psi) of the swivel: their values, and where they vanish."""

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxik.numerics import arctan2, clipped_sqrt


def values(coefficients: Array, sin: Array, cos: Array) -> Array:
    """Values at swivels.

    Args:
        coefficients: (a, b, c) on the second axis, ``(functions, 3, *rows)``.
        sin: Sines of the swivels, ``(*more, *rows)``.
        cos: Their cosines.

    Returns:
        ``(functions, *more, *rows)``.
    """
    lift = (1,) * (sin.ndim + 2 - coefficients.ndim)
    count, *rows = coefficients.shape[0], *coefficients.shape[2:]
    a, b, c = (coefficients[:, i].reshape(count, *lift, *rows) for i in range(3))
    return a + b * cos + c * sin


def roots(coefficients: Array, floor: float) -> tuple[Array, Array]:
    """Swivels where a + b cos + c sin vanishes.

    Args:
        coefficients: (a, b, c) on the first axis, ``(3, ...)``.
        floor: Squared amplitude, relative to 1, below which a function counts as constant, or as touching zero.

    Returns:
        Both roots ``(2, ...)`` in (-pi, pi], and whether they exist; pi where not.
    """
    a, b, c = coefficients
    amplitude2 = b * b + c * c
    gap2 = amplitude2 - a * a
    exist = (gap2 >= -floor * amplitude2) & (amplitude2 > floor * floor)
    d = clipped_sqrt(gap2)
    d = jnp.stack([d, -d])
    angle = arctan2(b * d - a * c, -a * b - c * d)
    return jnp.where(exist, angle, jnp.pi), exist


def angle_equations(entries: Array, angles: np.ndarray, sin: Array, cos: Array) -> Array:
    """Functions whose roots are the swivels where an angle of a spherical joint takes a value.

    Args:
        entries: Its entries (see :class:`jaxik.redundancy.self_motion.SelfMotion`), ``(5 or 3, 3, elbow bit, n)``.
        angles: Angle that each equation is for, 0 to 2, ``(equations,)``.
        sin: Sine of its value, that of the direction of the plane vector with delta included,
            ``(equations, elbow bit or 1, n or 1)``.
        cos: Its cosine.

    Returns:
        ``(3, equations, elbow bit, n)``.
    """
    x, y, z = entries[0], entries[1], entries[2]
    count = (entries.shape[0] + 1) // 2
    adjacent = jnp.stack([x, z, entries[3]] if count == 3 else [x, z])[angles]
    opposite = jnp.stack([y, jnp.zeros_like(z), entries[4]] if count == 3 else [y, jnp.zeros_like(z)])[angles]
    middle = (angles == 1)[:, None, None]
    # Outer angles: y cos - x sin = 0. Middle one, of which only the cosine is known: z - cos = 0.
    along_y, along_x = jnp.where(middle, 0.0, cos), jnp.where(middle, 1.0, -sin)
    equations = along_y[:, None] * opposite + along_x[:, None] * adjacent
    constant = jnp.array([1.0, 0.0, 0.0], entries.dtype)[:, None, None]
    return jnp.moveaxis(equations - jnp.where(middle, cos, 0.0)[:, None] * constant, 1, 0)


def turning_points(x: Array, y: Array) -> Array:
    """Function whose roots are where the direction of (x, y) turns back, x y' - y x' = 0: ``(3, ...)``."""
    return jnp.stack([x[1] * y[2] - y[1] * x[2], x[0] * y[2] - y[0] * x[2], y[0] * x[1] - x[0] * y[1]])
