"""Energies: formulas by value, sums and weights, gradients compared with finite differences."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
from jaxik import energy

ARM = jaxik.presets.iiwa14().arm
MAKERS = {
    "joint motion": energy.joint_motion,
    "smoothness": energy.smoothness,
    "holding torque": energy.holding,
    "servo energy": energy.servo,
    "custom": lambda: energy.custom(flexion, motion_weights=jnp.ones(7)),
}
RNG = np.random.default_rng(5)
Q = jnp.asarray(RNG.normal(size=(9, 7)))
TIME = jnp.asarray(np.cumsum(RNG.uniform(0.05, 0.2, 9)))


def flexion(q, qd, qdd, dt):
    """A user's own: smooth, of everything it is given."""
    return (q[3] ** 2 + qd[3] ** 2 + 1e-2 * qdd[3] ** 2) * dt


def test_joint_motion_by_its_formula():
    w = jnp.linspace(0.5, 2.0, 7)
    expected = sum(float(jnp.sum(w * (Q[k + 1] - Q[k]) ** 2) / (TIME[k + 1] - TIME[k])) for k in range(8))
    np.testing.assert_allclose(energy.joint_motion(w)(ARM, Q, TIME), expected, rtol=1e-13)


def test_weights_multiply_squares():
    dt, w = 0.1, jnp.linspace(0.5, 2.0, 7)
    second = Q[2:] - 2 * Q[1:-1] + Q[:-2]
    value = energy.smoothness(w)(ARM, Q, dt * jnp.arange(9.0))
    np.testing.assert_allclose(value, jnp.sum(w * second**2) / dt**3, rtol=1e-12)
    np.testing.assert_array_equal(energy.joint_motion(w).motion_weights(ARM), w)


@pytest.mark.parametrize("make", [energy.joint_motion, energy.smoothness])
def test_negative_weights_are_an_error_outside_jit(make):
    bad = jnp.ones(7).at[2].set(-0.5)
    with pytest.raises(ValueError, match=r"weights must not be negative, got \[1.0, 1.0, -0.5"):
        make(bad)
    assert jax.jit(lambda w: make(w)(ARM, Q, TIME))(bad).shape == ()


def test_smoothness_by_its_formula_on_even_times():
    dt = 0.1
    second = Q[2:] - 2 * Q[1:-1] + Q[:-2]
    value = energy.smoothness()(ARM, Q, dt * jnp.arange(9.0))
    np.testing.assert_allclose(value, jnp.sum(second**2) / dt**3, rtol=1e-12)


def test_smoothness_of_uneven_times_vanishes_for_steady_motion_and_converges_to_the_integral():
    steady = TIME[:, None] * jnp.ones(7)
    np.testing.assert_allclose(energy.smoothness()(ARM, steady, TIME), 0, atol=1e-18)
    t = jnp.linspace(0.0, 1.0, 2001) ** 1.3
    value = energy.smoothness()(ARM, jnp.sin(3 * t)[:, None] * jnp.ones(7), t)
    # the integral of (9 sin 3t)² over [0, 1], seven times
    np.testing.assert_allclose(value, 7 * 81 * (0.5 - np.sin(6) / 12), rtol=2e-3)


def test_sums_and_weights_are_linear_and_reported_term_by_term():
    a, b = energy.joint_motion(), energy.smoothness()
    both = a + 0.1 * b
    np.testing.assert_allclose(both(ARM, Q, TIME), a(ARM, Q, TIME) + 0.1 * b(ARM, Q, TIME), rtol=1e-14)
    np.testing.assert_allclose((2 * both)(ARM, Q, TIME), 2 * both(ARM, Q, TIME), rtol=1e-14)
    assert str(both) == str(jax.tree.map(jnp.asarray, both)) == "joint motion + 0.1 smoothness"
    assert jax.jit(lambda e: str(e) == "w joint motion + w smoothness")(both)
    assert both.unit == "weighted sum"
    assert a.unit == "rad²/s"
    assert set(both.parts(ARM, Q, TIME)) == {"joint motion [rad²/s]", "smoothness [rad²/s³]"}


def test_velocities_and_accelerations_are_those_of_a_parabola_on_uneven_times(rng):
    c = jnp.asarray(rng.normal(size=(3, 7)))
    t = TIME[:, None]
    found = energy.differences(c[0] + c[1] * t + c[2] * t**2, TIME)
    np.testing.assert_allclose(found.velocity, c[1] + 2 * c[2] * t, atol=1e-11)
    np.testing.assert_allclose(found.acceleration, jnp.broadcast_to(2 * c[2], (9, 7)), atol=1e-10)


def test_velocities_and_accelerations_of_very_short_motions():
    qd, qdd = energy.differences(Q[:2], TIME[:2])
    np.testing.assert_allclose(qd[1], (Q[1] - Q[0]) / (TIME[1] - TIME[0]), rtol=1e-13)
    np.testing.assert_array_equal(qd[0], qd[1])
    for x in (qdd, *energy.differences(Q[:1], TIME[:1])):
        np.testing.assert_array_equal(x, 0)


def test_node_weights_integrate_straight_lines_exactly():
    line = 2.0 + 3.0 * TIME
    a, b = TIME[0], TIME[-1]
    np.testing.assert_allclose(energy.node_weights(TIME) @ line, 2 * (b - a) + 1.5 * (b**2 - a**2), rtol=1e-13)
    np.testing.assert_array_equal(energy.node_weights(TIME[:1]), 0)


def test_holding_by_its_formula():
    torque = jaxik.gravity_torque(ARM, Q)
    rate = np.sum(np.asarray(torque) ** 2, axis=-1)
    np.testing.assert_allclose(energy.holding()(ARM, Q, TIME), np.trapezoid(rate, TIME), rtol=1e-12)


def test_holding_a_level_rod_costs_its_textbook_torque():
    """The paper's arm stretched out level: its two rods of 3 and the hand of 1 pull with 24.5 units at the shoulder."""
    arm = jaxik.presets.paper_arm().arm
    q = jnp.zeros((2, 6)).at[:, 1].set(jnp.pi / 2)
    torque = jaxik.gravity_torque(arm, q)
    np.testing.assert_allclose(torque[0, 1], -9.81 * (3 * 1.5 + 3 * 4.5 + 1 * 6.5), rtol=1e-13)
    expected = 9.81**2 * (24.5**2 + (3 * 1.5 + 1 * 3.5) ** 2 + 0.5**2) * 4
    np.testing.assert_allclose(energy.holding()(arm, q, jnp.array([1.0, 5.0])), expected, rtol=1e-13)


def test_servo_by_its_formula():
    qd, qdd = energy.differences(Q, TIME)
    torque = np.asarray(jaxik.inverse_dynamics(ARM, Q, qd, qdd))
    motors = ARM.motors
    heat = torque**2 * np.asarray(motors.resistance / motors.torque_constant**2)
    expected = np.trapezoid(heat.sum(-1), TIME)
    for k in range(8):  # each half step by itself: work at its speed, none taken back
        speed = np.asarray(Q[k + 1] - Q[k]) / (TIME[k + 1] - TIME[k])
        for end in (k, k + 1):
            expected += np.maximum(torque[end] * speed, 0).sum() * (TIME[k + 1] - TIME[k]) / 2
    np.testing.assert_allclose(energy.servo()(ARM, Q, TIME), expected, rtol=1e-12)


def test_a_zigzag_does_work():
    """Up and down by the same step, the mean speed at every waypoint is zero; lifting costs all the same."""
    still, away = jnp.zeros(7).at[1].set(1.0), jnp.zeros(7).at[1].set(0.99)
    q, t = jnp.stack([still, away] * 51)[:101], 0.5 * jnp.arange(101.0)
    arm = dataclasses.replace(ARM, motors=jaxik.Motors(1e-12 * jnp.ones(7), jnp.ones(7)))
    lift = -float(jaxik.gravity_torque(arm, q)[:, 1].mean()) * 0.01
    np.testing.assert_allclose(energy.servo()(arm, q, t), 50 * lift, rtol=0.02)


def test_servo_of_a_slow_motion_is_the_heat_of_holding_and_the_height_won():
    """Lifting costs the potential energy, lowering nothing, and the heat grows with the time it takes."""
    arm = dataclasses.replace(ARM, motors=jaxik.Motors(1e-12 * jnp.ones(7), jnp.ones(7)))
    t = jnp.linspace(0.0, 1.0, 101)
    bow = (t**2 * (3 - 2 * t))[:, None] * jnp.zeros(7).at[1].set(1.2)  # from upright: the arm sinks forward
    sink, rise = (float(energy.servo()(arm, q, 1e3 * t)) for q in (bow, bow[::-1]))
    height = float(arm.links.mass[1:] @ arm.links.center_of_mass[1:, 2] - arm.links.mass[1:].sum() * arm.shoulder[2])
    sideways = float(arm.links.mass[1:] @ arm.links.center_of_mass[1:, 0])
    np.testing.assert_allclose(rise - sink, 9.81 * (height * (1 - np.cos(1.2)) + sideways * np.sin(1.2)), rtol=1e-3)
    assert sink < 0.01 * rise
    held = energy.servo()(ARM, jnp.broadcast_to(bow[50], bow.shape), 7 * t)
    np.testing.assert_allclose(held, 7 * energy.servo().rest_rate(ARM, bow)[50], rtol=1e-12)


def test_a_custom_function_by_its_formula():
    qd, qdd = energy.differences(Q, TIME)
    dt = energy.node_weights(TIME)
    own = energy.custom(flexion, name="flexion", unit="rad²s")
    expected = sum(float(flexion(Q[k], qd[k], qdd[k], dt[k])) for k in range(9))
    np.testing.assert_allclose(own(ARM, Q, TIME), expected, rtol=1e-12)
    assert list((2.0 * own).parts(ARM, Q, TIME)) == ["flexion [rad²s]"]
    np.testing.assert_allclose(own.rest_rate(ARM, Q), Q[:, 3] ** 2, rtol=1e-13)
    np.testing.assert_array_equal(own.motion_weights(ARM), 0)
    np.testing.assert_array_equal(energy.custom(flexion, motion_weights=jnp.full(7, 2.0)).motion_weights(ARM), 2)
    traces = []
    count = lambda e, q: traces.append(1) or e(ARM, q, TIME)  # noqa: E731
    jitted = jax.jit(count)
    jitted(own, Q), jitted(energy.custom(flexion, name="flexion", unit="rad²s"), Q)
    assert len(traces) == 1  # the same function is the same program


@pytest.mark.parametrize("name", MAKERS)
def test_separable_energies_are_the_sum_of_their_costs_and_others_are_not(name):
    e = MAKERS[name]()
    steps = jnp.sum(e.motion_weights(ARM) * jnp.diff(Q, axis=0) ** 2 / jnp.diff(TIME)[:, None])
    total = steps + energy.node_weights(TIME) @ e.rest_rate(ARM, Q)
    assert e.separable == (name in ("joint motion", "holding torque"))
    assert bool(jnp.allclose(total, e(ARM, Q, TIME), rtol=1e-12)) == e.separable
    assert (e + energy.holding()).separable == e.separable
    assert e.rest_rate(ARM, Q.reshape(3, 3, 7)).shape == (3, 3)


def test_servo_of_a_slow_motion_is_heat_and_work_at_rest():
    e, step = 2.0 * energy.servo(), jnp.diff(Q, axis=0)
    slow = 1e3 * TIME
    torque = e.rest_torque(ARM, Q)
    work = jnp.sum(jnp.maximum(torque[1:] * step, 0) + jnp.maximum(torque[:-1] * step, 0)) / 2
    total = work + energy.node_weights(slow) @ e.rest_rate(ARM, Q)
    np.testing.assert_allclose(e(ARM, Q, slow), total, rtol=1e-3)
    assert not np.allclose(e(ARM, Q, TIME), work + energy.node_weights(TIME) @ e.rest_rate(ARM, Q), rtol=0.1)
    np.testing.assert_array_equal((energy.holding() + energy.joint_motion()).rest_torque(ARM, Q), 0)


def test_an_arm_without_masses_is_refused_for_energies_of_torques():
    bare = dataclasses.replace(ARM, links=jax.tree.map(jnp.zeros_like, ARM.links))
    both = energy.joint_motion() + energy.servo()
    both.check(ARM)
    energy.joint_motion().check(bare)
    with pytest.raises(ValueError, match="servo energy needs masses, and every link of this arm has mass 0"):
        both.check(bare)
    np.testing.assert_array_equal(energy.servo()(bare, Q, TIME), 0)


@pytest.mark.parametrize("name", MAKERS)
def test_gradients_agree_with_finite_differences_forward_and_reverse(name, rng):
    total = jax.jit(lambda q, t: MAKERS[name]()(ARM, q, t))
    toward = jax.tree.map(lambda x: jnp.asarray(rng.normal(size=x.shape)), (Q, TIME))
    forward = jax.jit(lambda *x: jax.jvp(total, x, toward)[1])(Q, TIME)
    slope = jax.jit(jax.grad(total, (0, 1)))(Q, TIME)
    np.testing.assert_allclose(sum(jnp.sum(a * b) for a, b in zip(slope, toward, strict=True)), forward, rtol=1e-11)
    h = 1e-6
    ahead, behind = (total(Q + s * h * toward[0], TIME + s * h * toward[1]) for s in (1, -1))
    np.testing.assert_allclose(forward, (ahead - behind) / (2 * h), rtol=1e-6)


def test_the_weight_is_differentiable_and_the_dtype_follows_the_motion():
    slope = jax.grad(lambda w: (w * energy.joint_motion())(ARM, Q, TIME))(jnp.asarray(2.0))
    np.testing.assert_allclose(slope, energy.joint_motion()(ARM, Q, TIME), rtol=1e-13)
    small = (energy.joint_motion() + 0.5 * energy.smoothness())(
        ARM.astype(jnp.float32), Q.astype(jnp.float32), TIME.astype(jnp.float32)
    )
    assert small.dtype == jnp.float32


def test_the_motion_weight_is_the_cost_of_a_step():
    """One step between two postures costs motion_weights · Δq² / dt, nothing else, for joint motion."""
    e = energy.joint_motion(jnp.linspace(1.0, 2.0, 7))
    dt = TIME[1] - TIME[0]
    step = jnp.sum(e.motion_weights(ARM) * (Q[1] - Q[0]) ** 2) / dt
    np.testing.assert_allclose(e(ARM, Q[:2], TIME[:2]), step, rtol=1e-13)
    np.testing.assert_array_equal(e.rest_rate(ARM, Q), 0)


def test_derivative_bounds_hold_at_random_postures():
    """No second or third derivative exceeds its bound, and the largest comes within a factor of it."""
    holding = energy.joint_motion() + 2.0 * energy.holding()
    bounds = holding.derivative_bounds(ARM)
    hessian = jax.hessian(lambda q: holding.rest_rate(ARM, q))
    q = jnp.asarray(np.random.default_rng(3).uniform(-np.pi, np.pi, (40, 7)))
    derivatives = jax.jit(jax.vmap(hessian))(q), jax.jit(jax.vmap(jax.jacfwd(hessian)))(q)
    for bound, found in zip(bounds, derivatives, strict=True):
        assert (np.abs(found) <= bound * (1 + 1e-12) + 1e-9).all()
        assert np.abs(found).max() > 0.05 * bound.max()
    assert (energy.joint_motion() + energy.servo()).derivative_bounds(ARM) is None
