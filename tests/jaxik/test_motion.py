"""The planner as a function of arrays: many paths at once, derivatives of the optimum, and no better one elsewhere."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
from jaxik.planning.newton import Band
from jaxik.planning.problem import make_problem
from jaxik.planning.refinement import refine
from jaxik.redundancy import self_motion

MODEL = jaxik.presets.iiwa14()
SEARCH = 12


@pytest.fixture(scope="module")
def path():
    wave = jaxik.fit_path(MODEL.arm, jaxik.example_path("wave"))
    return wave[::10]


def best(path, arm=MODEL.arm, shift=None):
    target = path.target
    if shift is not None:
        target = jaxik.Pose(target.position + shift, target.rotation)
    return jaxik.least_energy_motion(arm, target, path.time, search=SEARCH)


@pytest.mark.parametrize("width", [1, 2])
def test_bands_are_solved_as_the_dense_matrix_is(width):
    rng = np.random.default_rng(width)
    diagonals = [rng.normal(size=9) + (6.0 if d == 0 else 0.0) for d in range(width + 1)]
    dense = np.diag(diagonals[0])
    for d in range(1, width + 1):
        diagonals[d][9 - d :] = 0.0
        dense += np.diag(diagonals[d][: 9 - d], d) + np.diag(diagonals[d][: 9 - d], -d)
    b = rng.normal(size=9)
    x = Band(tuple(map(jnp.asarray, diagonals))).solve(jnp.asarray(b))
    np.testing.assert_allclose(x, np.linalg.solve(dense, b), rtol=1e-12)


def test_the_self_motion_is_the_solver_and_its_rates_are_its_derivatives(path):
    swivel = jnp.linspace(-3.0, 3.0, len(path))
    motion = self_motion(MODEL.arm, path.target).branch(jnp.arange(8)[:, None])
    solved = jaxik.solve_ik(MODEL.arm, path.target, swivel).q
    rates = motion.rates(swivel)
    np.testing.assert_allclose(jnp.transpose(rates.q, (2, 1, 0)), solved, atol=1e-11)
    first = jax.jvp(motion.angles, (swivel,), (jnp.ones_like(swivel),))[1]
    np.testing.assert_allclose(rates.first, first, atol=1e-9)
    second = jax.jvp(lambda s: motion.slopes(s)[1], (swivel,), (jnp.ones_like(swivel),))[1]
    np.testing.assert_allclose(rates.second, second, rtol=1e-9, atol=1e-9)


def test_the_other_solution_of_shoulder_and_wrist_is_another_branch(path):
    swivel = jnp.linspace(-3.0, 3.0, len(path))
    motion = self_motion(MODEL.arm, path.target)
    for branch, other in ((0, 5), (2, 7)):
        turned = motion.other_solution(motion.branch(branch).angles(swivel))
        np.testing.assert_allclose(turned, motion.branch(other).angles(swivel), atol=1e-12)


@pytest.mark.slow
def test_many_paths_at_once_are_each_alone(path):
    shifts = 0.03 * jnp.asarray(np.random.default_rng(0).normal(size=(3, 1, 3)))
    together = jax.vmap(lambda shift: best(path, shift=shift))(shifts)
    for i, shift in enumerate(shifts):
        alone = best(path, shift=shift)
        np.testing.assert_allclose(together.energy[i], alone.energy, rtol=1e-10)
        np.testing.assert_allclose(together.q[i], alone.q, atol=1e-6)
        assert bool(alone.converged)


@pytest.mark.slow
def test_the_optimum_moves_as_its_derivative_says(path):
    """Against differences of plans made anew: energy and swivel, in targets, times and arm."""
    rng = np.random.default_rng(1)
    moved = jnp.asarray(rng.normal(size=path.target.position.shape))
    longer = jnp.array([0.0, 0.02, 0.1])

    def planned(s):
        arm = dataclasses.replace(MODEL.arm, wrist=MODEL.arm.wrist + s * longer, tool_position=MODEL.arm.tool_position)
        target = jaxik.Pose(path.target.position + s * moved, path.target.rotation)
        motion = jaxik.least_energy_motion(arm, target, path.time * (1 + s), search=SEARCH)
        return motion.energy, motion.swivel, motion.branch

    value, rate = jax.jvp(lambda s: planned(s)[:2], (0.0,), (1.0,))
    step = 1e-5
    ahead, behind = planned(step), planned(-step)
    assert (ahead[2] == behind[2]).all()
    np.testing.assert_allclose(rate[0], (ahead[0] - behind[0]) / (2 * step), rtol=1e-6)
    np.testing.assert_allclose(rate[1], (ahead[1] - behind[1]) / (2 * step), rtol=1e-4, atol=1e-4)
    assert jnp.abs(rate[1]).max() > 0.1
    backward = jax.grad(lambda s: planned(s)[0])(0.0)
    np.testing.assert_allclose(backward, rate[0], rtol=1e-9)
    assert np.isfinite(value[0])


def test_no_restart_finds_a_better_motion(path):
    """Newton from 400 random smooth swivels in random branches: none ends lower."""
    arm, count = MODEL.arm, 400
    found = best(path)
    rng = np.random.default_rng(2)
    waves = np.cos(np.outer(np.arange(4), np.linspace(0, np.pi, len(path))))
    starts = rng.uniform(-np.pi, np.pi, (count, 1)) + (rng.normal(size=(count, 4)) * [0.0, 1.0, 0.5, 0.3]) @ waves
    branches = np.broadcast_to(rng.integers(0, 8, (count, 1)), starts.shape)
    problem = make_problem(arm, path.target, path.time)

    def restart(swivel, branch):
        end = refine(problem, swivel, branch, 60)
        return end.cost.energies(end.cost.joints(end.newton.x))[0]

    energies = np.asarray(jax.jit(lambda s, b: jax.lax.map(lambda x: restart(*x), (s, b)))(starts, branches))
    energies = energies[np.isfinite(energies)]
    assert len(energies) > 50
    assert found.energy <= energies.min() * (1 + 1e-3)
    assert np.sum(energies > 1.5 * found.energy) > 10  # the landscape is not convex: the search is the point


def test_a_guess_takes_the_place_of_the_search_and_few_steps_will_do(path):
    found = best(path)
    off = 0.02 * jnp.sin(jnp.arange(len(path)))
    guess = found.swivel + off, found.branch
    whole = jaxik.least_energy_motion(MODEL, path.target, path.time, guess=guess)
    np.testing.assert_allclose(whole.energy, found.energy, rtol=1e-10)
    few = jaxik.least_energy_motion(MODEL, path.target, path.time, guess=guess, iterations=2)
    none = jaxik.least_energy_motion(MODEL, path.target, path.time, guess=guess, iterations=0)
    assert whole.energy <= few.energy < none.energy
    assert few.energy < (1 + 1e-4) * whole.energy


def test_statuses_tell_what_is_wrong(path):
    found = best(path)
    assert found.ok
    assert found.raise_if_invalid() is found
    fast = jaxik.least_energy_motion(MODEL, path.target, path.time / 40, guess=(found.swivel, found.branch))
    assert fast.status == jaxik.PlanStatus.TOO_FAST
    away = jaxik.Pose(path.target.position.at[3].add(9.0), path.target.rotation)
    lost = jaxik.least_energy_motion(MODEL, away, path.time, guess=(found.swivel, found.branch))
    assert lost.status == jaxik.PlanStatus.UNREACHABLE
    np.testing.assert_array_equal(np.flatnonzero(~lost.feasible), [3])
    with pytest.raises(jaxik.UnreachableError, match="1 of 1 paths have no motion; some waypoints"):
        lost.raise_if_invalid()


@pytest.fixture(scope="module")
def energy_and_slope(path):
    """Energy and its gradient in a shift of the path, and status and violation."""

    def energy(shift):
        motion = best(path, shift=shift)
        return motion.energy, (motion.status, motion.violation)

    return jax.jit(jax.value_and_grad(energy, has_aux=True))


@pytest.mark.parametrize(
    "shift",
    [[0.3, 0.0, 0.0], [1.0, 0.0, 0.0], [-0.5, -0.3, 0.4], [0.0, 0.0, -0.9], [-0.66, 0.0, -0.5], [0.1, 0.9, 0.3]],
)
def test_descent_on_the_energy_brings_a_path_back_into_reach(energy_and_slope, shift):
    """Part of it or all of it out of reach, or beyond joint limits."""
    shift, first = jnp.asarray(shift), None
    for _ in range(40):
        (energy, (status, violation)), slope = energy_and_slope(shift)
        assert np.isfinite(energy)
        assert np.isfinite(slope).all()
        if status == jaxik.PlanStatus.OK:
            break
        assert violation > 0
        first = energy if first is None else first
        shift = shift - 0.05 * slope / jnp.linalg.norm(slope)
    assert status == jaxik.PlanStatus.OK
    assert violation == 0
    assert energy < first


def test_the_energy_of_no_motion_has_the_slope_of_its_differences(energy_and_slope):
    shift, along = jnp.array([0.9, 0.1, 0.1]), jnp.array([0.6, 0.0, 0.8])
    (_, (status, _)), slope = energy_and_slope(shift)
    assert status == jaxik.PlanStatus.UNREACHABLE
    ahead, behind = (energy_and_slope(shift + h * along)[0][0] for h in (1e-5, -1e-5))
    np.testing.assert_allclose(slope @ along, (ahead - behind) / 2e-5, rtol=1e-4)


def test_a_target_that_is_no_number_leaves_energy_and_gradient_finite(path):
    away = jaxik.Pose(path.target.position.at[3].set(jnp.nan), path.target.rotation)
    guess = jnp.full(len(path), 2.0), jnp.zeros(len(path), int)

    def energy(time):
        motion = jaxik.least_energy_motion(MODEL, away, time, guess=guess)
        return motion.energy, motion.status

    (value, status), slope = jax.value_and_grad(energy, has_aux=True)(path.time)
    assert status == jaxik.PlanStatus.UNREACHABLE
    assert np.isfinite(value)
    assert np.isfinite(slope).all()
