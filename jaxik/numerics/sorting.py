"""Sorting of many short columns at once: a bitonic network along the first axis.

A library sort calls a scalar routine per column, and counting the smaller entries is quadratic. A network compares the
same rows of every column, which is vector code over the batch: 15 rounds for 32 rows.
"""

import functools
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxik.numerics.fusion import fused_separately

# Rounds compiled as one: each saves a pass through memory and repeats the comparisons of the rounds before it.
_TOGETHER = 2


def sort_columns(x: Array) -> Array:
    """Sort ``x`` of ``(rows, ...)`` in ascending order along its first axis; the derivative follows the values."""
    rows = len(x)
    size = 1 << (rows - 1).bit_length()
    padding = jnp.full((size - rows, *x.shape[1:]), jnp.inf, x.dtype)
    x = jnp.concatenate([x, padding])
    rounds = [(block, block >> k) for block in _powers(size) for k in range(1, block.bit_length())]
    for first in range(0, len(rounds), _TOGETHER):
        x = _compared(tuple(rounds[first : first + _TOGETHER]))(x)
    return x[:rows]


def _powers(size: int) -> list[int]:
    """2, 4, ... up to ``size``."""
    return [1 << k for k in range(1, size.bit_length())]


@functools.cache
def _compared(rounds: tuple[tuple[int, int], ...]) -> Callable[[Array], Array]:
    """Rounds of (block, distance): rows a distance apart compare, and blocks run up and down in turn."""

    @fused_separately
    def compared(x: Array) -> Array:
        row = np.arange(len(x))
        for block, distance in rounds:
            lower = ((row & block) == 0) == ((row & distance) == 0)  # of the two, this row takes the smaller
            sign = jnp.asarray(np.where(lower, 1, -1), x.dtype).reshape(-1, *[1] * (x.ndim - 1))
            pairs = x.reshape(len(x) // (2 * distance), 2, distance, *x.shape[1:])
            other = pairs[:, ::-1].reshape(x.shape)
            # A choice, not minimum and maximum: those would share the derivative of equal values between both.
            x = jnp.where(sign * x <= sign * other, x, other)
        return x

    return compared
