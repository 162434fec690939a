"""Vectors and matrices with the batch last: the solver's working form.

A vector is an array ``(3, ..., n)``, a matrix ``(3, 3, ..., n)`` with row and column first; whatever follows is one or
more batch axes, the long one at the end. One operation on such an array is one pass of straight vector code over all
rows of the batch, where ``(n, 3, 3)`` would cost a transpose at every use. Sums over the short axes are written out,
since a reduction is a pass of its own.
"""

import jax
import jax.numpy as jnp
from jax import Array
from jax.core import ShapedArray
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir


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
    behind = jnp.broadcast_shapes(a.shape[2:], b.shape[2:])
    return _product.bind(jnp.broadcast_to(a, a.shape[:2] + behind), jnp.broadcast_to(b, b.shape[:2] + behind))


def _written_out(a: Array, b: Array) -> Array:
    terms = [a[:, None, i] * b[None, i] for i in range(a.shape[1])]
    if not terms:  # the derivative in half-spaces of an arm without any
        return jnp.zeros((a.shape[0], *b.shape[1:]), a.dtype)
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total


# A primitive, so that its transpose is two products again: that of the written-out sum is made of padded slices, which
# cost forty times the product itself.
_product = Primitive("vec3_product")
_product.def_impl(jax.jit(_written_out))
_product.def_abstract_eval(lambda a, b: ShapedArray((a.shape[0], *b.shape[1:]), a.dtype))
mlir.register_lowering(_product, mlir.lower_fun(_written_out, multiple_results=False))
ad.defbilinear(
    _product,
    lambda ct, a, b: _product.bind(ct, transpose(b)),
    lambda ct, a, b: _product.bind(transpose(a), ct),
)


def _mapped(arguments: tuple[Array, Array], axes: tuple[int | None, int | None]) -> tuple[Array, int]:
    """A batch axis goes behind rows and columns, where any number of axes may be."""
    size = next(x.shape[axis] for x, axis in zip(arguments, axes, strict=True) if axis is not None)
    a, b = (batching.bdim_at_front(x, axis, size) for x, axis in zip(arguments, axes, strict=True))
    return _product.bind(jnp.moveaxis(a, 0, 2), jnp.moveaxis(b, 0, 2)), 2


batching.primitive_batchers[_product] = _mapped


def transpose(a: Array) -> Array:
    """Rows and columns exchanged."""
    return jnp.swapaxes(a, 0, 1)


def project_out(v: Array, n: Array) -> Array:
    """The part of v across the unit vector n."""
    return v - dot(v, n) * n
