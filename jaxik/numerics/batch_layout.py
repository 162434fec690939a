"""The batch first, as callers have it, and last, as the solver works with it."""

import math

import jax.numpy as jnp
from jax import Array


def to_batch_last(x: Array, batch: tuple[int, ...], rank: int) -> Array:
    """``(*batch, ...)`` with ``rank`` trailing axes, broadcast to ``batch``, as ``(..., n)``."""
    core = x.shape[x.ndim - rank :]
    flat = jnp.broadcast_to(x, batch + core).reshape((math.prod(batch), *core))
    return jnp.moveaxis(flat, 0, -1)


def to_batch_first(x: Array, batch: tuple[int, ...]) -> Array:
    """``(..., n)`` back to ``(*batch, ...)``."""
    return jnp.moveaxis(x, -1, 0).reshape(batch + x.shape[:-1])


def merge_leading(x: Array, kept: int) -> Array:
    """All axes but the last ``kept`` made one (by their sizes, which an empty batch leaves no doubt about)."""
    return x.reshape((math.prod(x.shape[: x.ndim - kept]), *x.shape[x.ndim - kept :]))
