"""Plans in joint space, for arms solved by refinement: on target, in limits, with derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
from jaxik import Path, Pose, forward_kinematics
from jaxik.numerics import compiled_sooner
from jaxik.planning.candidates import CANDIDATES
from jaxik.planning.capability import postures_near
from jaxik.planning.feasible_targets import FeasibleTargets
from jaxik.planning.motion import refine_best
from jaxik.planning.postures.search import FoundPostures
from jaxik.planning.problem import PlanningProblem
from jaxik.redundancy import feasible_coordinates, parameter_motion, posture_charts
from tests.helpers.outer_joint_arms import postures

WAYPOINTS = 32
HOME = jnp.array([0.3, 0.4, -0.2, -1.6, 0.3, -0.9, 0.5])


@pytest.fixture(scope="module")
def arm():
    return jaxik.presets.gen3().arm


def loop(arm, q, shift=0.0):
    """A loop of the tool from a posture's pose, turning to and fro."""
    tool, angle = forward_kinematics(arm, q), np.linspace(0, 2 * np.pi, WAYPOINTS)
    zero = np.zeros_like(angle)
    offset = 0.1 * np.stack([1 - np.cos(angle), np.sin(angle), zero], axis=1) + shift
    c, s = np.cos(0.4 * np.sin(angle)), np.sin(0.4 * np.sin(angle))
    turn = np.stack([c, -s, zero, s, c, zero, zero, zero, zero + 1], axis=1).reshape(-1, 3, 3)
    return Path(Pose(tool.position + offset, jnp.asarray(turn) @ tool.rotation), jnp.linspace(0.0, 4.0, WAYPOINTS))


def energy(q, time):
    return float(jnp.sum(jnp.diff(q, axis=0) ** 2 / jnp.diff(time)[:, None]))


def test_charts_follow_the_self_motion_to_the_limits(arm):
    q = postures(arm, 5, 64)
    target = forward_kinematics(arm, q)
    charts = posture_charts(arm, target.position.T, jnp.moveaxis(target.rotation, 0, -1), q.T)
    h, x = 2e-6, 0.5 * jnp.asarray(np.random.default_rng(0).uniform(-1, 1, 64)) * charts.widest

    @compiled_sooner
    def rates_and_ends(charts):
        ends = feasible_coordinates(charts)
        return jax.lax.map(charts.rates, jnp.stack([x, x + h, x - h, *ends])), ends

    rates, coordinates = rates_and_ends(charts)
    reached = forward_kinematics(arm, jnp.swapaxes(rates.q[0], 0, 1))
    assert float(jnp.abs(reached.position - target.position).max()) < 1e-9
    assert float(jnp.abs(reached.rotation - target.rotation).max()) < 1e-9
    here, ahead, behind, *ends = rates.q
    np.testing.assert_allclose(jnp.sum(charts.along * (here - q.T), axis=0), x, atol=1e-12)
    np.testing.assert_allclose(rates.first[0], (ahead - behind) / (2 * h), atol=1e-6)
    np.testing.assert_allclose(rates.second[0], (rates.first[1] - rates.first[2]) / (2 * h), atol=1e-5)
    for at, end, sign in zip(ends, coordinates, (-1, 1), strict=True):
        room = jnp.min(jnp.minimum(at - arm.lower[:, None], arm.upper[:, None] - at)[~arm.turning], axis=0)
        held = sign * end < charts.widest
        assert float(room.min()) > -1e-9
        assert int(held.sum()) > 0
        np.testing.assert_allclose(room[held], 0.0, atol=1e-9)


@pytest.mark.slow
def test_plans_are_motions_with_derivatives(arm):
    path = loop(arm, HOME)
    plan = jaxik.plan(arm, path).raise_if_invalid()
    assert plan.lower_bound is None
    motion = jnp.asarray(plan.trajectory.q)
    reached = forward_kinematics(arm, motion)
    assert float(jnp.abs(reached.position - path.target.position).max()) < 1e-9
    assert float(jnp.abs(reached.rotation - path.target.rotation).max()) < 1e-9
    assert bool(jnp.all((motion >= arm.lower - 1e-9) & (motion <= arm.upper + 1e-9)))
    np.testing.assert_allclose(energy(motion, path.time), plan.energy, rtol=1e-12)
    np.testing.assert_allclose(jnp.sin(plan.swivel - motion[:, arm.outer_joint]), 0.0, atol=1e-9)

    found = FoundPostures(jnp.broadcast_to(motion, (CANDIDATES, *motion.shape)), jnp.array(True), jnp.ones(1, bool))

    @compiled_sooner
    def least(shift):
        def energy_and_joints(shift):
            target = loop(arm, HOME, jnp.array([1.0, 0.5, -0.3]) * shift).target
            known = FeasibleTargets(jnp.zeros((WAYPOINTS, 7, 1)), *[jnp.ones((WAYPOINTS, 1), bool)] * 2)
            problem = PlanningProblem(parameter_motion(arm, target), known, path.time, jaxik.energy.joint_motion())
            refined = refine_best(problem, found)
            return jnp.append(refined.q[:, 3], refined.energy), refined.ok & refined.converged

        return jax.jvp(energy_and_joints, (shift,), (jnp.ones_like(shift),), has_aux=True)

    h = 1e-4
    at, slope, ok = least(jnp.asarray(0.0))
    assert bool(ok)
    np.testing.assert_allclose(at[-1], plan.energy, rtol=1e-9)
    assert float(motion.max(axis=0)[5]) == float(arm.upper[5])  # where a limit holds too
    np.testing.assert_allclose(slope, (least(jnp.asarray(h))[0] - least(jnp.asarray(-h))[0]) / (2 * h), rtol=1e-3)


@pytest.mark.slow
def test_an_example_is_placed_and_slowed_until_it_can_be_planned(arm):
    path = jaxik.example_path("wave")[::7]  # turns the hand by 2.3 rad/s, at any scale; the wrist takes 1.2
    placed = jaxik.fit_path(arm, path)
    p = placed.placement
    assert p.scale == 1
    assert p.clock > 1
    assert p.describe().endswith(f"{float(p.clock):.2f} times slower")
    np.testing.assert_allclose(placed.time, p.clock * path.time)
    np.testing.assert_allclose(placed.target.position, p.translation + path.target.position @ p.rotation.T, atol=1e-12)
    assert jaxik.plan(arm, placed).ok


def test_postures_near_the_middle_of_the_limits_are_ranked_first(arm):
    q = jnp.stack([HOME, arm.upper * jnp.where(arm.turning, 0, 1), HOME])
    target = forward_kinematics(arm, q)
    away = Pose(target.position.at[2, 0].add(2.0), target.rotation)
    near = postures_near(arm, jax.tree.map(np.asarray, away))
    assert near[0] > 2 * near[1]
    assert near[2] < 1e-6 < near[1]
