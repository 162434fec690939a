"""Closed paths: motions that return exactly, cost least, are proved to, and say why where there is none."""

import json
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxik
from jaxik.cli import run
from jaxik.planning.cost import path_cost
from jaxik.planning.lattice import STARTS, SWIVELS, Lattice, best_routes
from jaxik.planning.newton import Band
from jaxik.planning.problem import make_problem
from tests.helpers.arms import random_arm

MODEL = jaxik.presets.iiwa14()
HOME = np.array([0.3, 0.6, 0.2, -1.3, 0.3, 0.8, 0.1])
ALIGNED = np.array([0.3, 0.0, 0.2, -1.3, 0.3, 0.0, 0.1])  # shoulder and wrist
COUNT = 24


def loop(arm, q=HOME, size=0.15, tilt=0.4):
    """A closed path from the target of a posture: the tool moves and tilts on a bent circle."""
    angle = np.linspace(0, 2 * np.pi, COUNT)
    away = size * np.stack([0.3 * np.sin(2 * angle), np.cos(angle) - 1, np.sin(angle)], axis=-1)
    aside = tilt * np.stack([np.sin(angle), np.zeros(COUNT), 1 - np.cos(angle)], axis=-1)
    tool = jaxik.forward_kinematics(arm, jnp.asarray(q))
    turned = jnp.asarray(Rotation.from_rotvec(aside).as_matrix()) @ tool.rotation
    return jaxik.Path(jaxik.Pose(tool.position + jnp.asarray(away), turned), jnp.linspace(0.0, 4.0, COUNT))


def spin(arm):
    """The tool turns once about its own axis and stays in its place."""
    tool = jaxik.forward_kinematics(arm, jnp.asarray(HOME))
    turned = Rotation.from_rotvec(np.linspace(0, 2 * np.pi, COUNT)[:, None] * [0, 0, 1]).as_matrix()
    target = jaxik.Pose(jnp.tile(tool.position, (COUNT, 1)), tool.rotation @ jnp.asarray(turned))
    return jaxik.Path(target, jnp.linspace(0.0, 8.0, COUNT))


@pytest.fixture(scope="module")
def path():
    return loop(MODEL.arm)


@pytest.fixture(scope="module")
def planned(path):
    return jaxik.plan(MODEL, path, end="start", gap=1e-3)


@pytest.fixture(scope="module")
def opened(path):
    return jaxik.plan(MODEL, path, gap=1e-3)


def energy_of(arm, path, swivel, branch):
    q = jaxik.solve_ik(arm, path.target, jnp.asarray(swivel)).q[np.arange(len(path)), branch]
    return float((np.diff(q, axis=0) ** 2 / np.diff(path.time)[:, None]).sum())


def test_the_motion_returns_to_the_last_digit_and_follows_the_path(planned, path):
    q = planned.raise_if_invalid().trajectory.q
    np.testing.assert_array_equal(q[-1], q[0])
    assert planned.branch[0] == planned.branch[-1]
    assert (planned.swivel[-1] - planned.swivel[0]) % (2 * np.pi) == pytest.approx(0.0, abs=1e-12)
    tool = jaxik.forward_kinematics(MODEL.arm, jnp.asarray(q))
    np.testing.assert_allclose(tool.position, path.target.position, atol=1e-10)
    np.testing.assert_allclose(tool.rotation, path.target.rotation, atol=1e-9)
    by_hand = (np.diff(q, axis=0) ** 2 / np.diff(path.time)[:, None]).sum()
    np.testing.assert_allclose(planned.energy, by_hand, rtol=1e-12)
    assert "closed: the last posture is the first" in planned.trajectory.notes


def test_what_returning_costs_is_part_of_the_proof(planned, opened):
    """The open optimum drifts. The bound of the closed path lies above it, and so is none of an open path's."""
    drift = opened.trajectory.q[-1] - opened.trajectory.q[0]
    assert np.abs(drift).max() > 0.1
    assert opened.energy < planned.lower_bound <= planned.energy
    assert planned.gap <= 1e-3


def test_the_proof_comes_upon_a_better_round_than_the_guess(planned, path):
    """A bound that were too high would leave the plan in the local minimum, a tenth above the best."""
    guess = np.full(COUNT, -1.5), 0
    stuck = jaxik.plan(MODEL, path, end="start", guess=guess, gap=None)
    assert stuck.energy > 1.05 * planned.energy
    again = jaxik.plan(MODEL, path, end="start", guess=guess, gap=3e-3)
    assert again.gap <= 3e-3
    np.testing.assert_allclose(again.energy, planned.energy, rtol=3e-3)


def test_no_other_first_posture_and_no_bump_costs_less(planned, path):
    """Smooth periodic bumps on the swivel, over the seam too."""
    phase = np.linspace(0, 2 * np.pi, COUNT)
    for bump in (1.0 + 0 * phase, np.cos(phase), np.sin(phase), np.cos(2 * phase), np.exp(4 * np.cos(phase) - 4)):
        for size in (1e-2, -1e-2):
            assert energy_of(MODEL.arm, path, planned.swivel + size * bump, planned.branch) > planned.energy


ARMS = {
    "iiwa14": (MODEL.arm, HOME),
    "random": (random_arm(0), np.array([0.4, 0.8, -0.5, 1.2, 0.3, -0.7, 0.2])),
}


@pytest.mark.parametrize("name", ARMS)
def test_no_closed_motion_on_a_fine_lattice_comes_below_the_bound(name):
    """The best of all motions over 120 swivels from each of them back to it, in each branch."""
    arm, q = ARMS[name]
    path = loop(arm, q, 0.1 * float(arm.length), 0.2)
    plan = jaxik.plan(arm, path, end="start").raise_if_invalid()
    count = 120
    swivel = np.linspace(-np.pi, np.pi, count, endpoint=False)
    rows = jax.tree.map(lambda x: jnp.repeat(x, count, axis=0), path.target)
    solution = jaxik.solve_ik(arm, rows, jnp.asarray(np.tile(swivel, COUNT)))
    q, ok = (np.asarray(x).reshape(COUNT, count, 8, -1) for x in (solution.q, solution.ok))
    best = np.inf
    for branch in range(8):
        if not ok[:, :, branch].any(axis=(1, 2)).all():
            continue
        value = np.where(np.eye(count, dtype=bool) & ok[0, :, branch], 0.0, np.inf)  # (start, state)
        for k in range(1, COUNT):
            step = q[k, None, :, branch] - q[k - 1, :, None, branch]
            step = np.where(arm.turning, (step + np.pi) % (2 * np.pi) - np.pi, step)
            dt = float(path.time[k] - path.time[k - 1])
            slow = (np.abs(step) <= np.asarray(arm.velocity_limit) * dt).all(-1)
            cost = np.where(slow & ok[k, None, :, branch, 0], (step**2).sum(-1) / dt, np.inf)
            value = np.stack([(row[:, None] + cost).min(axis=0) for row in value])
        best = min(best, value.diagonal().min())
    assert plan.gap <= 0.01
    assert plan.lower_bound <= plan.energy <= best
    assert best < 1.2 * plan.energy


def test_a_start_given_is_where_the_motion_comes_back_to(planned, path):
    q = planned.trajectory.q[0] + 0.0
    swivel, branch = jaxik.swivel_of(MODEL.arm, q)
    start = np.asarray(jaxik.solve_ik(MODEL.arm, path.target[0], swivel + 0.05).q[branch])
    plan = jaxik.plan(MODEL, path, start=start, end="start").raise_if_invalid()
    np.testing.assert_allclose(plan.trajectory.q[0], start, atol=1e-9)
    np.testing.assert_array_equal(plan.trajectory.q[-1], plan.trajectory.q[0])
    assert plan.energy > planned.energy
    assert plan.gap <= 0.01


@pytest.mark.slow
def test_a_start_off_the_path_is_gone_back_to_from_any_last_target(path):
    arc = path[: COUNT // 2]
    start = HOME + 0.1
    both = jaxik.plan(MODEL, arc, start=start, end="start", gap=None).raise_if_invalid()
    by_hand = jaxik.plan(MODEL, arc, start=start, end=start, gap=None)
    assert both.cost == pytest.approx(by_hand.cost, rel=1e-12)
    assert both.approach_energy > 0


@pytest.mark.slow
def test_a_loop_from_the_target_of_an_aligned_posture_returns():
    """Shoulder and wrist can be aligned at the seam, and nowhere else; the first posture is free."""
    plan = jaxik.plan(MODEL, loop(MODEL.arm, ALIGNED), end="start", gap=None).raise_if_invalid()
    np.testing.assert_array_equal(plan.trajectory.q[-1], plan.trajectory.q[0])


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_ranges_of_turns_are_no_way_round(seed):
    """Random arms without limits: the joints come back as they were, and not a turn further."""
    arm = random_arm(seed)
    path = loop(arm, np.random.default_rng(seed).uniform(-1.2, 1.2, 7), 0.1 * float(arm.length))
    plan = jaxik.plan(arm, replace(path, time=3 * path.time), end="start").raise_if_invalid()
    np.testing.assert_array_equal(plan.trajectory.q[-1], plan.trajectory.q[0])
    assert plan.gap <= 0.02


@pytest.mark.slow
def test_a_turn_that_would_add_up_is_said():
    """A tool that turns once about its axis needs full turns of some joint, in every round."""
    wide = replace(MODEL.arm, lower=jnp.full(7, -6.2), upper=jnp.full(7, 6.2))
    plan = jaxik.plan(wide, spin(wide), end="start")
    assert plan.status == jaxik.PlanStatus.NOT_CLOSED
    assert "joint 7 would turn by 360° in every round, however slow" in plan.problems
    assert 'an open motion along the path can be planned: leave out end="start"' in plan.problems
    with pytest.raises(jaxik.UnreachableError, match="no motion found returns to the posture in which it begins"):
        plan.raise_if_invalid()


@pytest.mark.slow
def test_too_little_time_is_said_with_the_time_that_would_do(path):
    plan = jaxik.plan(MODEL, replace(path, time=path.time / 10), end="start")
    assert plan.status == jaxik.PlanStatus.TOO_FAST
    factor = float(plan.problems[1].split()[0])
    slower = jaxik.plan(MODEL, replace(path, time=factor * path.time / 10), end="start", gap=None)
    assert slower.ok
    assert 1 < factor < 10


def test_arrays_say_what_does_not_close_and_have_slopes(planned, path):
    """A last target that is not the first: finite energies, whose gradient closes the path."""
    guess = jnp.asarray(planned.swivel), jnp.asarray(planned.branch)

    @jax.jit
    @jax.value_and_grad
    def energy(shift):
        position = path.target.position.at[-1].add(shift)
        motion = jaxik.least_energy_motion(
            MODEL, jaxik.Pose(position, path.target.rotation), path.time, end="start", guess=guess
        )
        return motion.energy + 0 * jax.lax.stop_gradient(motion.violation)

    shift = jnp.array([0.02, 0.0, -0.01])
    value, slope = energy(shift)
    assert np.isfinite(value)
    assert slope @ shift > 0.9 * jnp.linalg.norm(slope) * jnp.linalg.norm(shift)
    np.testing.assert_allclose(energy(0 * shift)[0], planned.energy, rtol=1e-9)
    apart = jaxik.Pose(path.target.position.at[-1].add(shift), path.target.rotation)
    motion = jaxik.least_energy_motion(MODEL, apart, path.time, end="start", guess=guess)
    assert motion.status == jaxik.PlanStatus.NOT_CLOSED
    assert motion.violation > 0


def test_the_optimum_moves_as_its_derivative_says(planned, path, rng):
    guess = jnp.asarray(planned.swivel), jnp.asarray(planned.branch)
    moved = jnp.asarray(rng.normal(size=(COUNT, 3)))
    moved = moved.at[-1].set(moved[0])

    @jax.jit
    def best(s):
        target = jaxik.Pose(path.target.position + s * moved, path.target.rotation)
        motion = jaxik.least_energy_motion(MODEL, target, path.time, end="start", guess=guess)
        return motion.energy, motion.q

    _, rate = jax.jvp(best, (0.0,), (1.0,))
    ahead, behind = best(1e-5), best(-1e-5)
    np.testing.assert_allclose(rate[0], (ahead[0] - behind[0]) / 2e-5, rtol=1e-5)
    np.testing.assert_allclose(rate[1], (ahead[1] - behind[1]) / 2e-5, rtol=1e-4, atol=1e-4)
    np.testing.assert_array_equal(rate[1][-1], rate[1][0])
    np.testing.assert_allclose(jax.grad(lambda s: best(s)[0])(0.0), rate[0], rtol=1e-9)


@pytest.mark.parametrize(
    ("change", "options", "said"),
    [
        (0.03, {"end": "start"}, r"last target is its first: these are 30 mm and 0° apart"),
        (
            0.0,
            {"end": "begin"},
            "end needs to be a posture, \"start\" for a motion that returns, or None; got 'begin'",
        ),
        (None, {"end": "start"}, "a closed path needs at least 3 waypoints; got 2"),
    ],
)
def test_what_is_no_closed_path_is_refused(path, change, options, said, without_type_checks):
    position = path.target.position.at[-1, 2].add(change or 0.0)
    moved = jaxik.Path(jaxik.Pose(position, path.target.rotation), path.time)
    with pytest.raises(ValueError, match=said):
        jaxik.plan(MODEL, moved if change is not None else path[:: COUNT - 1], **options)


def test_a_turn_between_the_ends_is_said_in_degrees(path):
    turned = path.target.rotation.at[-1].set(path.target.rotation[-1] @ Rotation.from_euler("y", 3, True).as_matrix())
    with pytest.raises(ValueError, match="0 mm and 3° apart"):
        jaxik.plan(MODEL, replace(path, target=jaxik.Pose(path.target.position, turned)), end="start")


def test_the_command_line_returns_too(path, tmp_path, capsys):
    jaxik.save_path(path, tmp_path / "loop.csv")
    words = ["plan", str(tmp_path / "loop.csv"), "--arm", "iiwa14", "--closed", "--gap", "0", "--json"]
    assert run([*words, "--out", str(tmp_path / "x.csv")]) == 0
    assert json.loads(capsys.readouterr().out)["status"] == "OK"
    trajectory = jaxik.load_trajectory(tmp_path / "x.csv")
    np.testing.assert_array_equal(trajectory.q[-1], trajectory.q[0])
    jaxik.save_path(path[:-1], tmp_path / "arc.csv")
    words[1] = str(tmp_path / "arc.csv")
    assert run(words) == 1
    assert "add the first target as the last waypoint" in capsys.readouterr().err


@pytest.mark.parametrize(("width", "count"), [(1, 2), (1, 9), (2, 3), (2, 4), (2, 9)])
def test_a_bordered_band_is_solved_as_the_dense_matrix_is(width, count, rng):
    diagonals = [np.pad(rng.normal(size=count - d) + (8 if d == 0 else 0), (0, d)) for d in range(width + 1)]
    border = np.append(0.0, rng.normal(size=count - 1))
    dense = np.diag(diagonals[0])
    for d in range(1, width + 1):
        dense += np.diag(diagonals[d][: count - d], d) + np.diag(diagonals[d][: count - d], -d)
    dense[0] += border
    dense[:, 0] += border
    band, b = Band(tuple(map(jnp.asarray, diagonals)), jnp.asarray(border)), rng.normal(size=count)
    np.testing.assert_allclose(band.solve(jnp.asarray(b)), np.linalg.solve(dense, b), rtol=1e-11)
    np.testing.assert_allclose(band.times(jnp.asarray(b)), dense @ b, rtol=1e-11)


@pytest.mark.parametrize("smooth", [0.0, 0.3])
@pytest.mark.parametrize("count", [3, 4, 8])
def test_gradient_and_hessian_are_those_of_the_value(smooth, count, path):
    energy = jaxik.energy.joint_motion()
    energy = energy + smooth * jaxik.energy.smoothness() if smooth else energy
    few = path[:count]
    problem = make_problem(MODEL.arm, few.target, few.time, energy, closed=True)
    swivel = 2.2 + 0.1 * jnp.cos(jnp.arange(count)).at[-1].set(1.0)
    cost = path_cost(problem, jnp.zeros(count, int), swivel)
    x = swivel  # of which the last follows from the first
    whole = lambda x: cost.value(cost.joints(cost.swivels(x)))  # noqa: E731
    value, gradient, band = cost(x)
    np.testing.assert_allclose(value, whole(x), rtol=1e-12)
    np.testing.assert_allclose(gradient, jax.grad(whole)(x), atol=1e-8)
    np.testing.assert_allclose(cost.gradient(*cost.slopes(x)), gradient, atol=1e-12)
    dense = jnp.stack([band.times(row) for row in jnp.eye(count)])
    np.testing.assert_allclose(dense, jax.hessian(whole)(x), rtol=1e-7, atol=1e-7)


def test_closed_routes_are_the_best_from_their_start_back_to_it():
    """A joint that is the swivel, pulled to places that the first and the last waypoint disagree about."""
    count = 5
    at = (np.arange(SWIVELS) + 0.5) * 2 * np.pi / SWIVELS - np.pi
    swivel = np.broadcast_to(at[:, None], (8, SWIVELS, count))
    wanted = np.array([-0.6, 0.0, 0.3, 0.0, 0.9])
    node = (swivel - wanted) ** 2
    one = jnp.ones(1)
    shared = None, jnp.ones(count - 1), one, 99 * one, jnp.zeros(1, bool)
    lattice = Lattice(jnp.asarray(swivel), jnp.asarray(swivel[None]), jnp.ones(swivel.shape, bool))
    routes = best_routes(lattice, jnp.asarray(node), *shared, closed=True)
    best = np.inf
    step = np.abs(np.arange(SWIVELS)[:, None] - np.arange(SWIVELS)) <= 8
    for branch in range(8):
        value = np.where(np.eye(SWIVELS, dtype=bool), node[branch, :, 0], np.inf)  # (start, state)
        for k in range(1, count):
            cost = np.where(step, (at[:, None] - at) ** 2, np.inf) + node[branch, None, :, k]
            value = (value[:, :, None] + cost).min(axis=1)
        around = value.min(axis=0).reshape(STARTS, -1)  # the cheapest end of each neighborhood is tried as a start
        starts = around.argmin(axis=1) + np.arange(STARTS) * around.shape[1]
        best = min(best, value[starts, starts].min())
    finite = np.isfinite(np.asarray(routes.cost))
    np.testing.assert_array_equal(routes.swivel[finite, 0], routes.swivel[finite, -1])
    np.testing.assert_array_equal(routes.branch[finite, 0], routes.branch[finite, -1])
    np.testing.assert_allclose(routes.cost.min(), best, rtol=1e-12)
