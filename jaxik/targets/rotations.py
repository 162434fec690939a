"""Rotations: matrices from and to quaternions and rotation vectors, and the nearest rotation to a matrix.

All take leading batch axes and keep the dtype. Those whose types are ``Any`` also take NumPy arrays and then return
NumPy arrays: files and viewers work in float64 whatever JAX's default is. Products are sums written out, since a matrix
product in float32 keeps ten bits only on some accelerators.
"""

from types import ModuleType
from typing import Any

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxik.targets.arrays import as_floats


def matrix_from_wxyz(wxyz: Any) -> Any:
    """Return the rotation matrices ``(*batch, 3, 3)`` of quaternions ``(*batch, 4)``, scalar first, of any length.

    A quaternion without length gives a matrix of zeros, which the solver refuses as an invalid target.
    """
    xp = _namespace(wxyz)
    square = (wxyz * wxyz).sum(-1)[..., None, None]
    given = square > 0.0
    w, x, y, z = (wxyz[..., i] for i in range(4))
    first = (-y * y - z * z, x * y - w * z, x * z + w * y)
    second = (x * y + w * z, -x * x - z * z, y * z - w * x)
    third = (x * z - w * y, y * z + w * x, -x * x - y * y)
    parts = xp.stack([*first, *second, *third], -1).reshape(*w.shape, 3, 3)
    turned = xp.eye(3, dtype=wxyz.dtype) + 2.0 / xp.where(given, square, 1.0) * parts
    return xp.where(given, turned, 0.0)


def wxyz_from_matrix(rotation: Any) -> Any:
    """Return unit quaternions ``(*batch, 4)``, scalar first and not negative, of rotation matrices ``(*batch, 3, 3)``.

    The outer product ``4 q qᵀ`` is linear in the matrix. Its row with the largest diagonal entry, which is at least 1,
    is q without division by a small number at any angle (Shepperd 1978); multiplied by the outer product once more, it
    is the quaternion of the nearest rotation up to the square of the matrix's error.

    The derivative is finite at every rotation. At half turns, where q and -q both have scalar 0 and the sign jumps, it
    is that of the side returned.
    """
    xp, r = _namespace(rotation), rotation
    a, b, c = r[..., 0, 0], r[..., 1, 1], r[..., 2, 2]
    wx, wy, wz = r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]
    xy, xz, yz = r[..., 0, 1] + r[..., 1, 0], r[..., 0, 2] + r[..., 2, 0], r[..., 1, 2] + r[..., 2, 1]
    diagonal = [1.0 + a + b + c, 1.0 + a - b - c, 1.0 + b - a - c, 1.0 + c - a - b]
    entries = [diagonal[0], wx, wy, wz, wx, diagonal[1], xy, xz, wy, xy, diagonal[2], yz, wz, xz, yz, diagonal[3]]
    outer = xp.stack(entries, -1).reshape(*a.shape, 4, 4)
    largest = xp.argmax(xp.stack(diagonal, -1), -1)
    row = xp.where((largest[..., None] == xp.arange(4))[..., None], outer, 0.0).sum(-2)
    row = rotate(outer, row)
    unit = row / xp.sqrt((row * row).sum(-1, keepdims=True))
    return xp.where(unit[..., :1] < 0.0, -unit, unit)


def matrix_from_rotation_vector(vector: Any) -> Any:
    """Return the rotation matrices ``(*batch, 3, 3)`` of rotation vectors ``(*batch, 3)`` [rad]: axis times angle.

    Rodrigues' formula with sin(x) / x, smooth at zero and everywhere.
    """
    xp = _namespace(vector)
    square = (vector * vector).sum(-1)[..., None, None]
    small = square < float(xp.finfo(vector.dtype).eps)
    angle = xp.sqrt(xp.where(small, 1.0, square))
    sinc = xp.where(small, 1.0 - square / 6.0, xp.sin(angle) / angle)
    half = xp.where(small, 0.5 - square / 24.0, 2.0 * (xp.sin(0.5 * angle) / angle) ** 2)
    identity = xp.eye(3, dtype=vector.dtype)
    twice = vector[..., :, None] * vector[..., None, :] - (vector * vector).sum(-1)[..., None, None] * identity
    return identity + sinc * cross_matrix(vector) + half * twice


def rotate(matrix: Any, vector: Any) -> Any:
    """Return matrices ``(*batch, m, n)`` times vectors ``(*batch, n)``."""
    return (matrix * vector[..., None, :]).sum(-1)


def compose(a: Any, b: Any) -> Any:
    """Return the products of matrices, ``(*batch, m, k)`` and ``(*batch, k, n)``."""
    return (a[..., :, :, None] * b[..., None, :, :]).sum(-2)


def cross_matrix(vector: Any) -> Any:
    """Return the matrices ``(*batch, 3, 3)`` that give the cross product with vectors ``(*batch, 3)``."""
    xp = _namespace(vector)
    x, y, z = (vector[..., i] for i in range(3))
    zero = xp.zeros_like(x)
    return xp.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(*x.shape, 3, 3)


def nearest_rotation(matrix: Float[ArrayLike, "*batch 3 3"]) -> Float[Array, "*batch 3 3"]:
    """Return the rotation nearest to a matrix: least sum of squared differences of the entries.

    For measured or learned matrices that are to become the rotation of a :class:`jaxik.Pose`.

    Args:
        matrix: Any real matrices, ``(*batch, 3, 3)``.

    Returns:
        Rotation matrices in the same dtype; a rotation is its own nearest. NaN or infinity gives NaN.

    Raises:
        ValueError: If the last two axes are not 3 by 3.

    **Differentiability**: forward and reverse, of any order, with the derivative of the projection: infinitesimal
    changes that leave the rotations are projected back. Where several rotations are equally near (matrices of rank
    below 2, and reflections whose two smallest singular values agree) one of them is returned, with derivative zero.

    References:
        K. Arun, T. Huang, S. Blostein, "Least-squares fitting of two 3-D point sets", 1987.

    Example:
        >>> R = nearest_rotation(jnp.diag(jnp.array([2.0, 1.0, 0.5])))
        >>> bool(jnp.allclose(R, jnp.eye(3), atol=1e-6))
        True
    """
    (matrix,) = as_floats(matrix)
    if matrix.shape[-2:] != (3, 3):
        raise ValueError(f"expected matrices of shape (*batch, 3, 3), got {matrix.shape}")
    return _nearest_rotation(matrix)


@jax.custom_jvp
def _nearest_rotation(matrix: Array) -> Array:
    left, _, right = jnp.linalg.svd(matrix)
    # A reflection turns back the direction in which that costs least: the last.
    sign = jnp.where(jnp.linalg.det(left) * jnp.linalg.det(right) < 0.0, -1.0, 1.0).astype(matrix.dtype)
    return compose(jnp.concatenate([left[..., :2], left[..., 2:] * sign[..., None, None]], -1), right)


@_nearest_rotation.defjvp
def _nearest_rotation_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    # With M = R S and S symmetric, a change dM turns R by the vector w in its own frame, dR = R [w], and
    # (tr(S) I - S) w is the antisymmetric part of Rᵀ dM. The inverse is written out; SVD's own derivative would divide
    # by differences of singular values, which are all equal at a rotation.
    (matrix,), (change,) = primals, tangents
    rotation = _nearest_rotation(matrix)
    back = jnp.swapaxes(rotation, -1, -2)
    stretch, turned = compose(back, matrix), compose(back, change)
    # tr(S) is at least the largest singular value: the scale of what is left.
    scale = jnp.maximum(jnp.trace(stretch, axis1=-2, axis2=-1), jnp.finfo(matrix.dtype).tiny)[..., None, None]
    system = jnp.eye(3, dtype=matrix.dtype) - 0.5 * (stretch + jnp.swapaxes(stretch, -1, -2)) / scale
    turned = (turned - jnp.swapaxes(turned, -1, -2)) / scale
    spin = jnp.stack([turned[..., 2, 1], turned[..., 0, 2], turned[..., 1, 0]], -1)
    x, y, z = (system[..., i, :] for i in range(3))
    adjugate = jnp.stack([jnp.cross(y, z), jnp.cross(z, x), jnp.cross(x, y)], -1)
    determinant = jnp.sum(x * adjugate[..., 0], -1)
    unique = determinant > 64 * float(jnp.finfo(matrix.dtype).eps)  # else zero but for rounding
    inverse = jnp.where(unique, 1.0 / jnp.where(unique, determinant, 1.0), 0.0)
    w = inverse[..., None] * rotate(adjugate, spin)
    return rotation, compose(rotation, cross_matrix(w))


def _namespace(array: Any) -> ModuleType:
    """Return ``numpy`` or ``jax.numpy``, whichever an array belongs to."""
    return array.__array_namespace__()
