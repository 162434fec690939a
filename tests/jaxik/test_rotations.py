"""Rotations against SciPy, at half turns, and the nearest rotation against its definition."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from scipy.spatial.transform import Rotation

from jaxik import nearest_rotation
from jaxik.targets import (
    compose,
    cross_matrix,
    matrix_from_rotation_vector,
    matrix_from_wxyz,
    rotate,
    wxyz_from_matrix,
)

RNG = np.random.default_rng(5)
AXES = Rotation.random(40, rng=RNG).as_matrix()[:, 0]
HALF_TURNS = np.concatenate([np.eye(3), AXES, [[0.6, 0.8, 0], [1, 1, 1] / np.sqrt(3)]])
ANY = Rotation.concatenate([
    Rotation.random(300, rng=RNG),
    Rotation.from_rotvec(1e-9 * AXES),
    Rotation.from_rotvec(1e-200 * AXES),
    Rotation.from_rotvec((np.pi - 1e-9) * AXES),
    Rotation.from_rotvec((np.pi - 1e-3) * AXES),
    Rotation.from_rotvec(np.pi * HALF_TURNS),
    Rotation.identity(1),
])  # fmt: skip


def same_up_to_sign(a, b, atol):
    return np.all(np.minimum(np.abs(a - b).max(-1), np.abs(a + b).max(-1)) <= atol)


@pytest.mark.parametrize("xp", [np, jnp])
def test_quaternions_are_those_of_scipy(xp):
    matrix = xp.asarray(ANY.as_matrix())
    found = wxyz_from_matrix(matrix)
    assert type(found) is type(matrix)
    assert same_up_to_sign(np.asarray(found), ANY.as_quat(scalar_first=True), 4e-16)
    assert np.all(np.asarray(found)[:, 0] >= 0)
    assert np.allclose(matrix_from_wxyz(found), matrix, rtol=0, atol=1e-15)


def test_the_dtype_is_kept_and_float32_is_accurate():
    matrix = jnp.asarray(ANY.as_matrix(), jnp.float32)
    found = wxyz_from_matrix(matrix)
    assert found.dtype == jnp.float32
    assert same_up_to_sign(np.asarray(found), ANY.as_quat(scalar_first=True), 3e-7)
    assert matrix_from_wxyz(found).dtype == jnp.float32
    assert matrix_from_rotation_vector(matrix[..., 0]).dtype == jnp.float32
    assert nearest_rotation(matrix).dtype == jnp.float32
    assert np.allclose(nearest_rotation(matrix), matrix, rtol=0, atol=1e-6)


def test_quaternions_of_any_length_but_zero():
    wxyz = ANY.as_quat(scalar_first=True)
    for length in (1e-100, 3.0, 1e100):
        assert np.allclose(matrix_from_wxyz(length * wxyz), ANY.as_matrix(), rtol=0, atol=1e-15)
    assert np.array_equal(matrix_from_wxyz(np.zeros((2, 4))), np.zeros((2, 3, 3)))
    gradient = jax.grad(lambda q: matrix_from_wxyz(q).sum())(jnp.zeros(4))
    assert np.array_equal(gradient, np.zeros(4))


def test_quaternion_of_a_matrix_with_an_error_is_that_of_the_nearest_rotation(rng):
    off = ANY.as_matrix() + 1e-6 * rng.normal(size=(len(ANY), 3, 3))
    nearest = Rotation.from_matrix(off).as_quat(scalar_first=True)
    assert same_up_to_sign(wxyz_from_matrix(off), nearest, 1e-10)


def test_quaternion_derivatives_are_exact_and_finite_at_half_turns():
    def quaternion(spin, start):
        return wxyz_from_matrix(compose(matrix_from_rotation_vector(spin), start))

    def expected(spin, start):  # dq = (0, w/2) q
        w, x, y, z = start
        a, b, c = spin / 2
        return np.stack([
            -a * x - b * y - c * z, a * w + b * z - c * y, b * w + c * x - a * z, c * w + a * y - b * x
        ])  # fmt: skip

    starts = jnp.asarray(ANY.as_matrix())
    for spin in (*np.eye(3), [0.3, -0.5, 0.8]):
        spin = jnp.asarray(spin)
        found, rate = jax.vmap(lambda m, spin=spin: jax.jvp(lambda v: quaternion(v, m), (0 * spin,), (spin,)))(starts)
        assert np.allclose(rate, expected(spin, np.asarray(found).T).T, rtol=0, atol=1e-14)
    reverse = jax.jit(jax.vmap(jax.jacrev(lambda m: wxyz_from_matrix(m))))(starts)
    assert np.all(np.isfinite(reverse))


@pytest.mark.parametrize("xp", [np, jnp])
def test_rotation_vectors_are_those_of_scipy(xp):
    vector = np.concatenate([ANY.as_rotvec(), 2.5 * ANY.as_rotvec(), np.zeros((1, 3))])
    assert np.allclose(
        matrix_from_rotation_vector(xp.asarray(vector)), Rotation.from_rotvec(vector).as_matrix(), rtol=0, atol=3e-15
    )


def test_rotation_vector_derivatives():
    for size in (0.0, 1e-9, 1e-4, 1.0, 3.0):
        check_grads(matrix_from_rotation_vector, (jnp.asarray(size * AXES[0]),), 2, ("fwd", "rev"), rtol=1e-6, eps=1e-4)


def test_products_are_those_of_numpy(rng):
    a, b = rng.normal(size=(2, 5, 4, 3, 3))
    assert np.allclose(compose(a, b), a @ b)
    assert np.allclose(rotate(a, b[..., 0]), np.einsum("...ij,...j", a, b[..., 0]))
    assert np.allclose(rotate(cross_matrix(a[..., 0]), b[..., 0]), np.cross(a[..., 0], b[..., 0]))


def test_nearest_rotation_of_any_matrix(rng):
    matrix = rng.normal(size=(200, 3, 3))  # half of them reflections
    found = np.asarray(nearest_rotation(matrix))
    assert np.allclose(found @ found.swapaxes(-1, -2), np.eye(3), rtol=0, atol=1e-14)
    assert np.allclose(np.linalg.det(found), 1)
    # None of many rotations around it is nearer.
    tried = Rotation.from_rotvec(rng.normal(scale=0.3, size=(500, 1, 3)).reshape(-1, 3)).as_matrix()[:, None] @ found
    distance = np.linalg.norm(tried - matrix, axis=(-2, -1)).min(0)
    assert np.all(np.linalg.norm(found - matrix, axis=(-2, -1)) <= distance + 1e-12)
    proper = np.linalg.det(matrix) > 0
    assert np.allclose(found[proper], Rotation.from_matrix(matrix[proper]).as_matrix(), rtol=0, atol=1e-12)


def test_nearest_rotation_leaves_rotations_and_ignores_size():
    matrix = ANY.as_matrix()
    for size in (1e-100, 1.0, 1e100):
        assert np.allclose(nearest_rotation(size * matrix), matrix, rtol=0, atol=2e-15)


def test_nearest_rotation_derivative_at_a_rotation_is_the_projection(rng):
    start, change = jnp.asarray(ANY.as_matrix()), jnp.asarray(rng.normal(size=(len(ANY), 3, 3)))
    _, rate = jax.jvp(nearest_rotation, (start,), (change,))
    skew = np.swapaxes(start, -1, -2) @ change
    assert np.allclose(rate, start @ (skew - np.swapaxes(skew, -1, -2)) / 2, rtol=0, atol=1e-13)


@pytest.mark.parametrize("seed", range(4))
def test_nearest_rotation_derivatives(seed):
    matrix = jnp.asarray(np.random.default_rng(seed).normal(size=(3, 3)))
    check_grads(nearest_rotation, (matrix,), 2, ("fwd", "rev"), rtol=1e-5, eps=1e-5)
    check_grads(nearest_rotation, (jnp.eye(3) + 1e-3 * matrix,), 2, ("fwd", "rev"), rtol=1e-5, eps=1e-5)


@pytest.mark.parametrize(
    "matrix",
    [np.zeros((3, 3)), np.outer([1, 2, 3], [3, 1, 2]), np.diag([1.0, 1, -1]), -np.eye(3), np.diag([1e-320, 0, 0])],
)
def test_nearest_rotation_where_several_are_equally_near(matrix):
    matrix = jnp.asarray(matrix, float)
    found = nearest_rotation(matrix)
    assert np.allclose(found @ found.T, np.eye(3), rtol=0, atol=1e-14)
    assert np.isclose(np.linalg.det(found), 1)
    for derivative in (jax.jacfwd, jax.jacrev):
        assert np.all(np.isfinite(derivative(nearest_rotation)(matrix)))


def test_nearest_rotation_of_no_number_is_none():
    assert np.all(np.isnan(nearest_rotation(jnp.full((3, 3), jnp.nan))))


def test_nearest_rotation_batched_and_compiled(rng):
    matrix = rng.normal(size=(2, 1, 5, 3, 3))
    found = jax.jit(nearest_rotation)(matrix)
    assert found.shape == matrix.shape
    assert np.allclose(found[1, 0, 3], nearest_rotation(matrix[1, 0, 3]), rtol=0, atol=1e-15)


@pytest.mark.usefixtures("without_type_checks")
def test_nearest_rotation_says_what_is_wrong():
    with pytest.raises(ValueError, match=r"expected matrices of shape \(\*batch, 3, 3\), got \(4, 4\)"):
        nearest_rotation(np.eye(4))
    with pytest.raises(ValueError, match="expected real numbers, got str"):
        nearest_rotation("x")
    assert np.array_equal(nearest_rotation([[1, 0, 0], [0, 1, 0], [0, 0, 1]]), np.eye(3))
