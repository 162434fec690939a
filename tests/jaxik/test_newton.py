"""Newton's method in a box against dense active sets."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import lsq_linear

from jaxik.planning.newton import Band, newton_in_box


def string(n, width, seed=0):
    """A sum of squares that couples neighbors, as residuals A x - b and as a band."""
    random = np.random.default_rng(seed)
    rows = [np.eye(n, k=d)[: n - d] for d in range(width + 1)]
    a = rows[1] - rows[0][:-1] if width == 1 else rows[2] - 2 * rows[1][:-1] + rows[0][:-2]
    a = np.concatenate([a * random.uniform(0.5, 2.0, (len(a), 1)), 0.02 * np.eye(n)])
    b = np.concatenate([0.05 * random.normal(size=len(a) - n), 0.02 * random.normal(size=n)])
    h = a.T @ a
    band = Band(tuple(jnp.pad(jnp.asarray(np.diagonal(h, d)), (0, d)) for d in range(width + 1)))
    return a, b, band, jnp.asarray(h), jnp.asarray(a.T @ b)


def bump(n):
    """Lower bounds in whose way a string is, but at the top only, and a ceiling at one side."""
    at = np.linspace(-1, 1, n)
    return 1.0 - 2.0 * np.abs(at) ** 0.7, np.where(at > 0.5, 0.2, np.inf)


@pytest.mark.parametrize(("width", "steps"), [(1, 1), (2, 3)])
def test_few_steps_solve_a_quadratic_where_many_variables_have_to_be_let_go(width, steps):
    n = 60
    a, b, band, h, g = string(n, width)
    lower, upper = bump(n)
    best = lsq_linear(a, b, (lower, upper), method="bvls", tol=1e-14).x
    held = (best <= lower + 1e-9) | (best >= upper - 1e-9)
    begin = np.maximum(lower, 0.0).clip(max=upper)

    @jax.jit
    def solve(x):
        f = lambda x: (0.5 * x @ h @ x - g @ x + 10.0, h @ x - g, band)  # noqa: E731
        return newton_in_box(f, x, jnp.asarray(lower), jnp.asarray(upper), steps)

    at_first = begin <= lower
    assert at_first.sum() - held.sum() >= 20  # one a step would not do
    np.testing.assert_allclose(solve(jnp.asarray(begin)).x, best, atol=1e-7)


def test_the_band_times_a_vector_is_the_matrix_times_it():
    for width in (1, 2):
        *_, band, h, _ = string(9, width)
        x = jnp.arange(9.0) ** 2
        np.testing.assert_allclose(band.times(x), h @ x, rtol=1e-12)
        np.testing.assert_allclose(band.solve(h @ x), x, atol=1e-8)


@pytest.mark.parametrize("begin", [-0.9, 0.0, 0.9])
def test_negative_curvature_ends_in_a_minimum_of_the_box(begin):
    """A double well in every variable, neighbors coupled: dense Hessians say that the end is a minimum."""
    n = 12
    lower, upper = np.full(n, -1.0), np.full(n, 0.4)

    def value(x):
        return jnp.sum((x**2 - 0.36) ** 2) + 0.05 * jnp.sum(jnp.diff(x) ** 2) + 0.01 * jnp.sum(x)

    def evaluate(x):
        h = jax.hessian(value)(x)
        return value(x), jax.grad(value)(x), Band((jnp.diagonal(h), jnp.pad(jnp.diagonal(h, 1), (0, 1))))

    x = jnp.clip(begin + 0.05 * jnp.arange(float(n)), -1.0, 0.4)
    end = jax.jit(lambda x: newton_in_box(evaluate, x, jnp.asarray(lower), jnp.asarray(upper), 60))(x)
    assert bool(end.done)
    gradient, at = np.asarray(jax.grad(value)(end.x)), np.asarray(end.x)
    free = (at > lower) & (at < upper)
    np.testing.assert_allclose(gradient[free], 0, atol=1e-6)
    assert (gradient[at <= lower] >= 0).all()
    assert (gradient[at >= upper] <= 0).all()
    assert np.linalg.eigvalsh(np.asarray(jax.hessian(value)(end.x))[free][:, free]).min(initial=1.0) > -1e-9
