"""Building blocks against 50-digit arithmetic, in ulp, over all magnitudes and at the points where formulas change."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mpmath import mp, mpf

from jaxik.numerics.angles import wrap
from jaxik.numerics.elementary import arctan2, sincos, unit_sqrt
from jaxik.numerics.tolerances import tolerances

DTYPES = [np.float64, np.float32]


def ulps(got, exact, dtype) -> float:
    """Largest error in units of the exact value's last place."""
    with mp.workdps(50):
        return max(
            float(abs(mpf(float(g)) - e) / mpf(float(np.spacing(dtype(abs(float(e)))))))
            for g, e in zip(got, exact, strict=True)
        )


def sides(dtype, count=1000):
    """Pairs over all directions and magnitudes, and the ones where one formula hands over to the next."""
    rng = np.random.default_rng(0)
    decades = 100 if dtype == np.float64 else 15
    angle = rng.uniform(-np.pi, np.pi, count)
    radius = 10 ** rng.uniform(-decades, decades, count)
    ratio = 10 ** rng.uniform(-15, 15, count)  # nearly along an axis
    edges = np.array([[np.sin(a), np.cos(a)] for a in np.arange(-8, 9) * np.pi / 8 for _ in range(3)])
    edges = edges * (1 + np.tile([0, 1e-7, -1e-7], 17)[:, None] * [1, 0])
    y = np.concatenate([radius * np.sin(angle), rng.choice([-1, 1], count), edges[:, 0], [1, -1, 1, -1, 3e-5, 7e9]])
    x = np.concatenate([radius * np.cos(angle), ratio, edges[:, 1], [1, 1, -1, -1, 3e-5, -7e9]])
    y, x = y.astype(dtype), x.astype(dtype)
    keep = np.abs(y) > np.abs(x) * np.finfo(dtype).tiny * 1e3  # a denormal quotient is zero
    return y[keep], x[keep]


@pytest.mark.parametrize("dtype", DTYPES)
def test_arctan2_is_within_3_ulp(dtype):
    y, x = sides(dtype)
    with mp.workdps(50):
        exact = [mp.atan2(mpf(float(a)), mpf(float(b))) for a, b in zip(y, x, strict=True)]
    assert ulps(arctan2(jnp.asarray(y), jnp.asarray(x)), exact, dtype) <= 3


@pytest.mark.parametrize("dtype", DTYPES)
def test_arctan2_on_axes_diagonals_and_signed_zeros(dtype):
    y = jnp.asarray([0, 0, 1, -1, 0, -0.0, -0.0, 1, 1, -1, -1, 0.5], dtype)
    x = jnp.asarray([1, -1, 0, 0, 0, 0, 1, 1, -1, 1, -1, -0.0], dtype)
    exact = np.arctan2(np.asarray(y), np.asarray(x))
    np.testing.assert_allclose(arctan2(y, x), exact, rtol=float(2 * np.finfo(dtype).eps), atol=0)
    # (-pi, pi]: the half turn is positive whatever the sign of zero.
    assert float(arctan2(jnp.asarray(-0.0, dtype), jnp.asarray(-1.0, dtype))) == float(dtype(np.pi))


@pytest.mark.parametrize("size", [1e-300, 1e-12, 1.0, 1e12, 1e300])
def test_arctan2_of_equal_sides_is_an_odd_eighth_turn(size):
    sides = np.array([(1, 1), (1, -1), (-1, 1), (-1, -1)]) * size
    assert np.allclose(arctan2(*jnp.asarray(sides).T), np.pi * np.array([1, 3, -1, -3]) / 4, rtol=1e-15, atol=0)


def test_arctan2_derivative_is_exact_and_zero_at_the_origin():
    y, x = (v[:500] for v in sides(np.float64))
    dy, dx = jax.vmap(jax.grad(arctan2, argnums=(0, 1)))(jnp.asarray(y), jnp.asarray(x))
    r2 = y.astype(np.longdouble) ** 2 + x.astype(np.longdouble) ** 2
    np.testing.assert_allclose(dy, (x / r2).astype(float), rtol=1e-15)
    np.testing.assert_allclose(dx, (-y / r2).astype(float), rtol=1e-15)
    zero, one = jnp.zeros(()), jnp.ones(())
    assert jax.grad(arctan2, argnums=(0, 1))(zero, zero) == (0.0, 0.0)
    assert jax.grad(arctan2, argnums=(0, 1))(one, one) == (0.5, -0.5)


@pytest.mark.parametrize("dtype", DTYPES)
def test_sincos_is_within_2_ulp_of_one_up_to_its_largest_angle(dtype):
    rng = np.random.default_rng(1)
    largest = tolerances(jnp.dtype(dtype)).angle
    quarters = np.arange(-40, 41) * np.pi / 4
    x = np.concatenate(
        [
            rng.uniform(-4, 4, 800),
            rng.choice([-1, 1], 800) * 10 ** rng.uniform(-30, np.log10(largest), 800),
            quarters,
            np.nextafter(quarters, 100),
            [largest, -largest],
        ]
    ).astype(dtype)
    sin, cos = sincos(jnp.asarray(x))
    with mp.workdps(50):
        for got, f in ((sin, mp.sin), (cos, mp.cos)):
            off = max(abs(mpf(float(g)) - f(mpf(float(a)))) for g, a in zip(got, x, strict=True))
            assert float(off) <= 2 * np.finfo(dtype).eps


@pytest.mark.parametrize("dtype", DTYPES)
def test_sine_keeps_its_digits_for_small_angles(dtype):
    x = (np.random.default_rng(2).choice([-1, 1], 500) * 10 ** np.linspace(-30, -0.2, 500)).astype(dtype)
    with mp.workdps(50):
        assert ulps(sincos(jnp.asarray(x))[0], [mp.sin(mpf(float(a))) for a in x], dtype) <= 2
    assert sincos(jnp.zeros((), dtype)) == (0.0, 1.0)


@pytest.mark.parametrize("dtype", DTYPES)
def test_sincos_of_a_huge_angle_is_finite(dtype):
    sin, cos = sincos(jnp.asarray([1e18, -1e30, np.finfo(dtype).max], dtype))
    assert np.isfinite(sin).all()
    assert np.isfinite(cos).all()


def test_sincos_derivative_is_exact():
    x = jnp.linspace(-10, 10, 101)
    (sin, cos), (d_sin, d_cos) = jax.jvp(sincos, (x,), (jnp.ones_like(x),))
    assert (d_sin == cos).all()
    assert (d_cos == -sin).all()


def test_unit_sqrt_clips_and_its_derivative_is_bounded_then_zero():
    floor = tolerances(jnp.dtype(float)).singular
    x = jnp.asarray([-1.0, -2 * floor, 0.0, floor, 0.25, 1.0, 2.0])
    value, slope = jax.jvp(unit_sqrt, (x,), (jnp.ones_like(x),))
    np.testing.assert_allclose(value, [0, 0, 0, np.sqrt(floor), 0.5, 1, 1])
    steepest = 0.5 / np.sqrt(floor)
    np.testing.assert_allclose(slope, [0, 0, steepest, steepest, 1, 0.5, 0])


def test_wrap_brings_angles_into_the_half_open_turn():
    assert np.allclose(
        wrap(jnp.asarray([4.0, -4.0, np.pi, -np.pi, 0.0])), [4 - 2 * np.pi, 2 * np.pi - 4, np.pi, np.pi, 0]
    )
