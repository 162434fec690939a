"""Repaired motions: against the planner's refinement, and on paths where moving single waypoints fails."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
from jaxik.planning.fast.path_batch import SwivelPath, no_start, path_batch
from jaxik.planning.fast.repair import _better, _Ranked, _refined
from training.policy.random_paths import random_paths

MODEL = jaxik.presets.iiwa14()
ARM = MODEL.arm


@pytest.fixture(scope="module")
def reach():
    """The least-energy motion along a path, and an arm whose sixth joint may not go quite as far as it does there."""
    path = jaxik.fit_path(ARM, jaxik.example_path("reach"))
    motion = jaxik.least_energy_motion(ARM, path.target, path.time, search=32)
    top = jnp.max(motion.q[:, 5])
    away = jnp.where(jnp.abs(motion.q[:, 5] - top) < 0.02)[0]
    assert 1 < len(away) < 60
    return path, motion, dataclasses.replace(ARM, upper=ARM.upper.at[5].set(top - 0.02))


@partial(jax.jit, static_argnames="steps")
def _refine(arm, target, time, first, others, smooth, steps):
    batch = path_batch(arm, jax.tree.map(lambda x: x[None], target), time[None], jnp.ones(7), no_start(arm, 1))
    other = lambda number: jax.tree.map(lambda x: x[number], others)  # noqa: E731
    best = _refined(batch, first, other, len(others.swivel), smooth, steps)
    q = batch.motion.branch(best.branch[:, None]).angles(best.swivel[:, None])
    return best, batch.energy(q)[0]


def refined(arm, path, first, others, smooth, steps=3):
    """Swivels and branches on the host, and their energy."""
    # A single other motion is given twice: then one program serves all tests.
    others = SwivelPath(*(jnp.concatenate([x, x])[:2] for x in others))
    best, energy = _refine(arm, path.target, path.time, SwivelPath(*first), others, smooth, steps)
    return np.asarray(best.swivel), np.asarray(best.branch), float(energy)


def in_limits(arm, path, swivel, branch):
    found = jaxik.solve_ik(arm, path.target, jnp.asarray(swivel))
    return bool(jnp.take_along_axis(found.ok, jnp.asarray(branch)[:, None], 1).all())


def test_a_kink_is_refined_to_the_least_motion_within_limits(reach):
    path, motion, tight = reach
    proposal = motion.swivel, motion.branch
    others = tuple(x[None] for x in proposal)
    assert not in_limits(tight, path, *proposal)
    best = float(jaxik.least_energy_motion(tight, path.target, path.time, guess=proposal).energy)
    _, _, kinked = refined(tight, path, proposal, others, motion.energy, steps=0)
    swivel, branch, energy = refined(tight, path, proposal, others, motion.energy)
    assert in_limits(tight, path, swivel, branch)
    assert kinked > 1.02 * best
    assert best * (1 - 1e-9) <= energy < (1 + 1e-6) * best


def test_another_candidate_is_taken_where_the_branch_proposed_has_no_arcs(reach):
    path, motion, _ = reach
    good = motion.swivel, motion.branch
    # The elbow bends to one side only: half of the branches are gone.
    sign = float(jnp.sign(motion.q[0, 3]))
    side = "upper" if sign < 0 else "lower"
    arm = dataclasses.replace(ARM, **{side: getattr(ARM, side).at[3].set(0.0)})
    valid = np.asarray(jaxik.swivel_arcs(arm, path.target).valid).any(-1).all(0)
    assert valid.sum() == 4
    for other in np.flatnonzero(~valid):
        proposal = motion.swivel, jnp.full_like(motion.branch, other)
        aside = motion.swivel + jnp.pi, motion.branch
        others = tuple(jnp.stack([a, b]) for a, b in zip(aside, good, strict=True))
        swivel, branch, energy = refined(arm, path, proposal, others, motion.energy)
        np.testing.assert_array_equal(branch, motion.branch)
        assert energy < 1.05 * float(motion.energy)
        # And where the others propose this branch too, every branch is tried.
        nowhere = tuple(x[None] for x in proposal)
        swivel, branch, _ = refined(arm, path, proposal, nowhere, motion.energy)
        assert np.isfinite(swivel).all()
        assert valid[branch[0]]
        assert in_limits(arm, path, swivel, branch)


def test_a_motion_of_the_expected_energy_is_left_alone(reach):
    """Another candidate, even a cheaper one, is not tried: most paths would be slowed for nothing."""
    path, motion, _ = reach
    aside = motion.swivel + 0.1, motion.branch
    others = tuple(x[None] for x in (motion.swivel, motion.branch))
    _, _, costly = refined(ARM, path, aside, others, jnp.asarray(1e3), steps=0)
    swivel, _, energy = refined(ARM, path, aside, others, jnp.asarray(costly / 1.01), steps=0)
    np.testing.assert_allclose(swivel, aside[0], atol=1e-9)
    assert energy > 1.001 * float(motion.energy)


def test_a_bad_target_has_no_swivel_and_the_others_keep_theirs(reach):
    path, motion, _ = reach
    position = path.target.position.at[7].set(jnp.nan).at[20].set(10.0)
    bad = jaxik.Path(jaxik.Pose(position, path.target.rotation), path.time)
    proposal = motion.swivel, motion.branch
    others = tuple(x[None] for x in proposal)
    for smooth in (motion.energy, jnp.asarray(jnp.nan)):
        swivel, _, _ = refined(ARM, bad, proposal, others, smooth)
        assert np.isnan(swivel[[7, 20]]).all()
    swivel, branch, _ = refined(ARM, bad, proposal, others, motion.energy)
    good = np.delete(np.arange(len(swivel)), [7, 20])
    assert np.isfinite(swivel[good]).all()
    rest = jaxik.Path(jax.tree.map(lambda x: x[good], path.target), path.time[good])
    assert in_limits(ARM, rest, swivel[good], branch[good])


NAN = float("nan")


@pytest.mark.parametrize(
    ("better", "worse"),
    [
        # Waypoints without an arc, joints too fast, energy.
        ((0, True, 9e9), (1, False, 1.0)),
        ((2, True, NAN), (3, False, NAN)),  # where a waypoint has no swivel the energy is nan
        ((0, False, 9e9), (0, True, 1.0)),
        ((1, False, 9e9), (1, True, 1.0)),
        ((0, False, 1.0), (0, False, 1.1)),
        ((0, True, 1.0), (0, True, 1.1)),
        ((0, False, 1.0), (0, False, NAN)),
        ((0, True, 1.0), (0, True, NAN)),
    ],
)
def test_waypoints_without_an_arc_count_before_speeds_and_speeds_before_energy(better, worse):
    def ranked(values, branch):
        missing, fast, energy = values
        path = SwivelPath(jnp.full(3, float(branch)), jnp.full(3, branch))
        return _Ranked(jnp.asarray(missing), jnp.asarray(fast), jnp.asarray(energy), path)

    first, second = ranked(better, 1), ranked(worse, 2)
    for picked in (_better(first, second), _better(second, first)):
        np.testing.assert_equal(jax.device_get(picked), jax.device_get(first))


def test_of_equal_motions_the_one_that_came_first_is_kept():
    path = SwivelPath(jnp.zeros(3), jnp.zeros(3, int))
    for energy in (1.0, NAN):
        came, later = (
            _Ranked(jnp.asarray(1), jnp.asarray(False), jnp.asarray(energy), path._replace(branch=path.branch + i))
            for i in range(2)
        )
        np.testing.assert_array_equal(_better(later, came).path.branch, came.path.branch)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "row", "knots"), [(52, 1037, 32), (51, 1596, 32), (51, 1336, 16)])
def test_paths_on_which_moved_waypoints_jumped(seed, row, knots):
    """Three of 3000 random paths: with each waypoint moved by itself they cost 5 to 46 times the least energy."""
    paths = random_paths(jax.random.key(seed), ARM, jnp.array([row], jnp.int32), 100)
    path = jax.tree.map(lambda x: x[0], paths)
    motion = jaxik.plan_batch(ARM, path.target, path.time, knots=knots)
    assert motion.feasible
    assert in_limits(ARM, path, motion.swivel.astype(float), motion.branch)
    best = jaxik.least_energy_motion(ARM, path.target, path.time, search=64).energy
    energy = jaxik.energy.joint_motion()(ARM, motion.q.astype(float), path.time)
    assert float(energy) < 1.02 * float(best)
