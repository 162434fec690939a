"""Plans for arms with an outer joint: on target, in limits, no worse than simpler motions; failures name waypoints."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
from jaxik import Path, PlanStatus, Pose, forward_kinematics, solve_ik
from jaxik.redundancy import has_swivel, parameter_motion
from tests.helpers.outer_joint_arms import postures, random_outer_joint_arm

WAYPOINTS = 32


def loop(arm, q):
    """A loop of the tool from a posture's pose, turning to and fro."""
    tool, angle = forward_kinematics(arm, q), np.linspace(0, 2 * np.pi, WAYPOINTS)
    zero = np.zeros_like(angle)
    offset = 0.08 * np.stack([1 - np.cos(angle), np.sin(angle), zero], axis=1)
    c, s = np.cos(0.3 * np.sin(angle)), np.sin(0.3 * np.sin(angle))
    turn = np.stack([c, -s, zero, s, c, zero, zero, zero, zero + 1], axis=1).reshape(-1, 3, 3)
    return Path(Pose(tool.position + offset, jnp.asarray(turn) @ tool.rotation), jnp.linspace(0.0, 4.0, WAYPOINTS))


@pytest.mark.parametrize("mirrored", [False, True])
def test_rates_are_derivatives_in_the_parameter(mirrored):
    arm = random_outer_joint_arm(30, mirrored=mirrored)
    q = postures(arm, 30, 128)
    parameter, branch = jaxik.swivel_of(arm, q)
    motion = parameter_motion(arm, forward_kinematics(arm, q)).branch(branch)
    assert not has_swivel(arm)
    rates = jax.jit(lambda m, p: m.rates(p))(motion, parameter)
    first, second = jax.jvp(
        lambda p: jax.jvp(motion.angles, (p,), (jnp.ones_like(p),))[1], (parameter,), (jnp.ones_like(parameter),)
    )
    calm = jnp.max(jnp.abs(first), axis=0) < 10
    assert int(calm.sum()) > 40
    for mine, other in ((rates.first, first), (rates.second, second)):
        size = 1 + jnp.max(jnp.abs(other), axis=0)
        assert float((jnp.max(jnp.abs(mine - other), axis=0) / size)[calm].max()) < 1e-6
    np.testing.assert_allclose(jnp.abs(jnp.sin((rates.q - q.T) / 2)).max(), 0.0, atol=1e-6)


@pytest.mark.slow
def test_plans_are_motions_that_nothing_simple_beats_and_failures_name_the_waypoint():
    arm = jaxik.presets.franka_fr3().arm
    q = jnp.array([0.3, 0.2, -0.2, -2.2, 0.3, 2.2, 0.5])
    path = loop(arm, q)
    plan = jaxik.plan(arm, path).raise_if_invalid()
    assert plan.lower_bound is None
    assert plan.gap is None
    motion = jnp.asarray(plan.trajectory.q)
    reached = forward_kinematics(arm, motion)
    assert float(jnp.abs(reached.position - path.target.position).max()) < 1e-9
    assert float(jnp.abs(reached.rotation - path.target.rotation).max()) < 1e-9
    assert bool(jnp.all((motion >= arm.lower - 1e-9) & (motion <= arm.upper + 1e-9)))
    np.testing.assert_allclose(plan.swivel, motion[:, arm.outer_joint], atol=1e-9)

    def energy(parameter):
        found = solve_ik(arm, path.target, jnp.asarray(parameter))
        rows = jnp.arange(WAYPOINTS), jnp.asarray(plan.branch)
        steps = jnp.diff(found.q[rows], axis=0)
        cost = jnp.sum(steps**2 / jnp.diff(path.time)[:, None])
        return float(jnp.where(jnp.all(found.ok[rows]), cost, jnp.inf))

    np.testing.assert_allclose(energy(plan.swivel), plan.energy, rtol=1e-9)
    rng, smooth = np.random.default_rng(0), np.linspace(0, np.pi, WAYPOINTS)
    for size in (1e-3, 1e-2, 0.1):
        for wave in range(4):
            change = size * (rng.normal() * np.cos(wave * smooth) + 0.1 * rng.normal(size=WAYPOINTS))
            assert energy(plan.swivel + change) > plan.energy * (1 - 1e-12)
    for held in np.linspace(float(arm.lower[6]), float(arm.upper[6]), 40):
        assert energy(np.full(WAYPOINTS, held)) > plan.energy

    begun = jaxik.plan(arm, path, start=q).raise_if_invalid()
    np.testing.assert_allclose(begun.trajectory.q[0], q, atol=1e-9)
    assert begun.energy >= plan.energy * (1 - 1e-9)

    away = jnp.where(jnp.arange(WAYPOINTS)[:, None] > 19, 5.0, 0.0)
    far = dataclasses.replace(path, target=Pose(path.target.position + away, path.target.rotation))
    failure = jaxik.plan(arm, far)
    assert failure.status == PlanStatus.UNREACHABLE
    assert "waypoint 20 to 31" in failure.problems[0]
    assert failure.reachable_prefix == 20
