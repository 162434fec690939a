"""Energies against a simulator: what a motion is predicted to draw, and what simulated motors draw in playing it."""

import functools

import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

import jaxik
from tests.helpers.mujoco_arm import drawn_energy, mujoco_model, play

MODELS = {"iiwa14": jaxik.presets.iiwa14, "meccanoid": lambda: jaxik.presets.meccanoid("right")}
SERVO = jaxik.energy.servo()

TOLERANCE = 0.1  # of the predicted energy: the simulated arm is no rail, it follows its waypoints as servos do


@functools.cache
def case(arm, path):
    """A model and a path in its reach."""
    model = MODELS[arm]()
    return model, jaxik.fit_path(model.arm, jaxik.example_path(path))


def predicted(model, q, time):
    return float(SERVO(model.arm, jnp.asarray(q), jnp.asarray(time)))


def simulated(model, q, time):
    return drawn_energy(model.arm, play(model.arm, np.asarray(time), np.asarray(q)))


def at_fixed_swivels(model, path, count=36):
    """Motions at constant swivels that keep all limits, ``(motion, waypoint, joint)``."""
    arm = model.arm
    solution = jaxik.solve_ik(arm, path.target, jnp.linspace(-np.pi, np.pi, count, endpoint=False)[:, None])
    q = np.moveaxis(np.asarray(solution.q), 2, 1).reshape(-1, len(path), arm.n_joints)
    ok = np.moveaxis(np.asarray(solution.ok), 2, 1).reshape(-1, len(path)).all(-1)
    speed = np.abs(np.diff(q, axis=1)) / np.diff(path.time)[:, None]
    return q[ok & (speed <= np.asarray(arm.velocity_limit)).all((1, 2))]


@pytest.mark.parametrize("make", [*MODELS.values(), jaxik.presets.paper_arm])
def test_inverse_dynamics_are_the_simulators_with_a_load_too(make):
    arm = jaxik.with_payload(make().arm, 0.7, np.array([0.1, 0.0, 0.05]), 1e-3 * np.eye(3))
    model = mujoco_model(arm)
    data = mujoco.MjData(model)
    data.qpos, data.qvel, data.qacc = np.random.default_rng(2).normal(size=(3, arm.n_joints))
    mujoco.mj_inverse(model, data)
    torque = jaxik.inverse_dynamics(arm, *(np.array(x) for x in (data.qpos, data.qvel, data.qacc)))
    np.testing.assert_allclose(torque, data.qfrc_inverse, rtol=0, atol=1e-8 * np.abs(torque).max())


def test_a_better_swivel_saves_in_the_simulator_what_it_was_predicted_to():
    model, reach = MODELS["iiwa14"](), jaxik.example_path("reach")
    forward = jnp.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # the hand points away from the base
    position = jnp.array([0.5, -0.2, 0.6]) + 0.6 * reach.target.position
    path = jaxik.Path(jaxik.Pose(position, reach.target.rotation @ forward), reach.time)
    motions = at_fixed_swivels(model, path, 8)
    energies = [predicted(model, q, path.time) for q in motions]
    kept = [motions[np.argmin(energies)], motions[np.argmax(energies)]]
    (better, worse), (better_played, worse_played) = (
        [f(model, q, path.time) for q in kept] for f in (predicted, simulated)
    )
    assert worse > 1.5 * better  # else there is nothing to compare
    np.testing.assert_allclose([better_played, worse_played], [better, worse], rtol=TOLERANCE)
    np.testing.assert_allclose(1 - better_played / worse_played, 1 - better / worse, atol=0.03)


@pytest.mark.slow
@pytest.mark.parametrize(("arm", "path"), [("iiwa14", "wave"), ("meccanoid", "figure-eight")])
def test_a_plan_for_servo_energy_saves_in_the_simulator_what_it_says(arm, path):
    """Against the best that any fixed swivel does, not only against one."""
    model, placed = case(arm, path)
    plan = jaxik.plan(model, placed, energy=SERVO).raise_if_invalid()
    motions = at_fixed_swivels(model, placed)
    energies = [predicted(model, q, placed.time) for q in motions]
    fixed = motions[int(np.argmin(energies))]
    planned, held = (simulated(model, q, placed.time) for q in (plan.trajectory.q, fixed))
    np.testing.assert_allclose([planned, held], [plan.energy, min(energies)], rtol=TOLERANCE)
    assert plan.energy < min(energies)
    assert planned < held
    np.testing.assert_allclose(1 - planned / held, 1 - plan.energy / min(energies), atol=0.05)
