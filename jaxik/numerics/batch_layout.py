"""Conversion between the batch first, as callers have it, and last, as the solver works with it."""

import math

import jax.numpy as jnp
from jax import Array


def to_batch_last(x: Array, batch: tuple[int, ...], rank: int) -> Array:
    """Bring ``(*batch, ...)`` with ``rank`` trailing axes, broadcast to ``batch``, into the form ``(..., n)``."""
    core = x.shape[x.ndim - rank :]
    flat = jnp.broadcast_to(x, batch + core).reshape((math.prod(batch), *core))
    return jnp.moveaxis(flat, 0, -1)


def to_batch_first(x: Array, batch: tuple[int, ...]) -> Array:
    """Bring ``(..., n)`` back into the form ``(*batch, ...)``."""
    return jnp.moveaxis(x, -1, 0).reshape(batch + x.shape[:-1])


def merge_leading(x: Array, kept: int) -> Array:
    """Merge all axes but the last ``kept`` into one (by their sizes, so that an empty batch is no special case)."""
    return x.reshape((math.prod(x.shape[: x.ndim - kept]), *x.shape[x.ndim - kept :]))
