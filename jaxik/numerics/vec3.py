"""Vectors and matrices with the batch last: the solver's working form.

A vector is an array ``(3, ..., n)``, a matrix ``(3, 3, ..., n)`` with row and column first; whatever follows is one or
more batch axes, the long one at the end. One operation on such an array is one pass of straight vector code over all
rows of the batch, where ``(n, 3, 3)`` would cost a transpose at every use. Sums over the short axes are written out,
since a reduction is a pass of its own.
"""

import jax.numpy as jnp
from jax import Array


def dot(a: Array, b: Array) -> Array:
    """Scalar product over the leading axis."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Array, b: Array) -> Array:
    """Vector product a × b over the leading axis."""
    return jnp.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def matvec(a: Array, v: Array) -> Array:
    """Matrix times vector, ``(rows, 3, ...)`` by ``(3, ...)``."""
    return a[:, 0] * v[0] + a[:, 1] * v[1] + a[:, 2] * v[2]


def matmul(a: Array, b: Array) -> Array:
    """Matrix product, ``(rows, 3, ...)`` by ``(3, columns, ...)``."""
    return a[:, None, 0] * b[None, 0] + a[:, None, 1] * b[None, 1] + a[:, None, 2] * b[None, 2]


def transpose(a: Array) -> Array:
    """Rows and columns exchanged."""
    return jnp.swapaxes(a, 0, 1)


def project_out(v: Array, n: Array) -> Array:
    """The part of v across the unit vector n."""
    return v - dot(v, n) * n
