"""Vectors and matrices as tuples of columns: the solver's working form.

A vector is ``(x, y, z)`` with each component an array of the batch shape, a matrix a tuple of its three column vectors.
A batch of N poses is then a few arrays of length N, which the compiler turns into straight vector code; an (N, 3, 3)
layout inside the solver costs a transpose at every use.
"""

from collections.abc import Sequence

import jax.numpy as jnp
from jax import Array

Vec3 = tuple[Array, Array, Array]
Mat3 = tuple[Vec3, Vec3, Vec3]


def split_vector(v: Array) -> Vec3:
    """``(*batch, 3)`` to columns."""
    return v[..., 0], v[..., 1], v[..., 2]


def split_matrix(m: Array) -> Mat3:
    """``(*batch, 3, 3)`` to columns."""
    return split_vector(m[..., :, 0]), split_vector(m[..., :, 1]), split_vector(m[..., :, 2])


def join_vector(v: Sequence[Array]) -> Array:
    """Columns to ``(*batch, len(v))``."""
    return jnp.stack(jnp.broadcast_arrays(*v), axis=-1)


def join_matrix(m: Mat3) -> Array:
    """Columns to ``(*batch, 3, 3)``."""
    return jnp.stack([join_vector(c) for c in m], axis=-1)


def dot(a: Vec3, b: Vec3) -> Array:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vec3, b: Vec3) -> Vec3:
    """Vector product a × b."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def add(a: Vec3, b: Vec3) -> Vec3:
    """Sum."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def sub(a: Vec3, b: Vec3) -> Vec3:
    """Difference a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def scale(s: Array | float, v: Vec3) -> Vec3:
    """Scalar times vector."""
    return s * v[0], s * v[1], s * v[2]


def combine(weights: Sequence[Array], vectors: Sequence[Vec3]) -> Vec3:
    """Weighted sum of vectors: a matrix given by columns times a vector."""
    total = scale(weights[0], vectors[0])
    for w, v in zip(weights[1:], vectors[1:], strict=True):
        total = add(total, scale(w, v))
    return total


def where(condition: Array, a: Vec3, b: Vec3) -> Vec3:
    """Componentwise selection."""
    return jnp.where(condition, a[0], b[0]), jnp.where(condition, a[1], b[1]), jnp.where(condition, a[2], b[2])


def project_out(v: Vec3, n: Vec3) -> Vec3:
    """The part of v across the unit vector n."""
    return sub(v, scale(dot(v, n), n))


def matmul(a: Mat3, b: Sequence[Vec3]) -> tuple[Vec3, ...]:
    """Matrix product a b, for any number of columns of b."""
    return tuple(combine(c, a) for c in b)


def transpose(a: Mat3) -> Mat3:
    """Transpose."""
    return (a[0][0], a[1][0], a[2][0]), (a[0][1], a[1][1], a[2][1]), (a[0][2], a[1][2], a[2][2])


def transposed_matmul(a: Mat3, b: Sequence[Vec3]) -> tuple[Vec3, ...]:
    """Matrix product aᵀ b, for any number of columns of b."""
    return tuple((dot(a[0], c), dot(a[1], c), dot(a[2], c)) for c in b)
