"""Energies: formulas by value, sums and weights, gradients against differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

import jaxik
from jaxik import energy

ARM = jaxik.presets.iiwa14().arm
RNG = np.random.default_rng(5)
Q = jnp.asarray(RNG.normal(size=(9, 7)))
TIME_S = jnp.asarray(np.cumsum(RNG.uniform(0.05, 0.2, 9)))


def test_joint_motion_by_its_formula():
    w = jnp.linspace(0.5, 2.0, 7)
    expected = sum(float(jnp.sum((w * (Q[k + 1] - Q[k])) ** 2) / (TIME_S[k + 1] - TIME_S[k])) for k in range(8))
    np.testing.assert_allclose(energy.joint_motion(w)(ARM, Q, TIME_S), expected, rtol=1e-13)


def test_smoothness_by_its_formula_on_even_times():
    dt = 0.1
    second = Q[2:] - 2 * Q[1:-1] + Q[:-2]
    value = energy.smoothness()(ARM, Q, dt * jnp.arange(9.0))
    np.testing.assert_allclose(value, jnp.sum(second**2) / dt**3, rtol=1e-12)


def test_smoothness_of_uneven_times_vanishes_for_steady_motion_and_converges_to_the_integral():
    steady = TIME_S[:, None] * jnp.ones(7)
    np.testing.assert_allclose(energy.smoothness()(ARM, steady, TIME_S), 0, atol=1e-18)
    t = jnp.linspace(0.0, 1.0, 2001) ** 1.3
    value = energy.smoothness()(ARM, jnp.sin(3 * t)[:, None] * jnp.ones(7), t)
    # the integral of (9 sin 3t)² over [0, 1], seven times
    np.testing.assert_allclose(value, 7 * 81 * (0.5 - np.sin(6) / 12), rtol=2e-3)


def test_sums_and_weights_are_linear_and_reported_term_by_term():
    a, b = energy.joint_motion(), energy.smoothness()
    both = a + 0.1 * b
    np.testing.assert_allclose(both(ARM, Q, TIME_S), a(ARM, Q, TIME_S) + 0.1 * b(ARM, Q, TIME_S), rtol=1e-14)
    np.testing.assert_allclose((2 * both)(ARM, Q, TIME_S), 2 * both(ARM, Q, TIME_S), rtol=1e-14)
    assert str(both) == "joint motion + 0.1 smoothness"
    assert both.unit == "weighted sum"
    assert a.unit == "rad²/s"
    assert set(both.parts(ARM, Q, TIME_S)) == {"joint motion [rad²/s]", "smoothness [rad²/s³]"}


@pytest.mark.parametrize("make", [energy.joint_motion, energy.smoothness])
def test_gradients_are_those_of_differences_forward_and_reverse(make):
    total = lambda q, t: make(jnp.linspace(1.0, 2.0, 7))(ARM, q, t)  # noqa: E731
    check_grads(total, (Q, TIME_S), order=1, modes=("fwd", "rev"), rtol=1e-5, eps=1e-5)


def test_the_weight_is_differentiable_and_the_dtype_follows_the_motion():
    slope = jax.grad(lambda w: (w * energy.joint_motion())(ARM, Q, TIME_S))(jnp.asarray(2.0))
    np.testing.assert_allclose(slope, energy.joint_motion()(ARM, Q, TIME_S), rtol=1e-13)
    small = (energy.joint_motion() + 0.5 * energy.smoothness())(
        ARM.astype(jnp.float32), Q.astype(jnp.float32), TIME_S.astype(jnp.float32)
    )
    assert small.dtype == jnp.float32


def test_what_a_search_is_told_is_the_price_of_a_step():
    """One step between two postures costs motion_weight · Δq² / dt, nothing else, for joint motion."""
    e = energy.joint_motion(jnp.linspace(1.0, 2.0, 7))
    dt = TIME_S[1] - TIME_S[0]
    step = jnp.sum(e.motion_weight(ARM) * (Q[1] - Q[0]) ** 2) / dt
    np.testing.assert_allclose(e(ARM, Q[:2], TIME_S[:2]), step, rtol=1e-13)
    np.testing.assert_array_equal(e.rest_rate(ARM, Q), 0)
