"""Motions that settle in their exact arcs: against the planner's polish, and on paths where moving waypoints fails."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
import training
from jaxik.planning.fast.motion_cost import path_motion
from jaxik.planning.fast.path_batch import elbow_charts
from jaxik.planning.fast.settling import settled
from training.policy.policy import no_start
from training.policy.random_paths import random_paths

MODEL = jaxik.presets.iiwa14()
ARM = MODEL.arm
WEIGHT = jnp.ones(7)


@pytest.fixture(scope="module")
def course():
    """The least-energy motion along a path, and an arm whose sixth joint may not go quite as far as it does there."""
    path = jaxik.fit_path(jaxik.example_path("reach"), ARM)
    motion = jaxik.least_energy_motion(ARM, path.target, path.time, search=32)
    top = jnp.max(motion.q[:, 5])
    away = jnp.where(jnp.abs(motion.q[:, 5] - top) < 0.02)[0]
    assert 1 < len(away) < 60
    return path, motion, eqx.tree_at(lambda a: a.upper, ARM, ARM.upper.at[5].set(top - 0.02))


def settle(arm, path, proposal, others, smooth, steps=3):
    charts = elbow_charts(arm, jax.tree.map(lambda x: x[None], path.target))
    start = no_start(arm, 1)

    @jax.jit
    def run(arm, target, charts, proposal, others, smooth):
        one = lambda number: jax.tree.map(lambda x: x[number], others)  # noqa: E731
        count = len(others[0])
        return settled(arm, target, charts, path.time, proposal, one, count, smooth, WEIGHT, start, steps)

    swivel, branch = run(arm, path.target, charts, proposal, others, smooth)
    q = charts.of(branch[:, None]).joints(swivel[:, None])
    return np.asarray(swivel), np.asarray(branch), float(path_motion(q, path.time[:, None], WEIGHT, start)[0])


def in_limits(arm, path, swivel, branch):
    found = jaxik.solve_ik(arm, path.target, jnp.asarray(swivel))
    return bool(jnp.take_along_axis(found.ok, jnp.asarray(branch)[:, None], 1).all())


def test_a_kink_settles_to_the_least_motion_within_limits(course):
    path, motion, tight = course
    proposal = motion.swivel, motion.branch
    others = tuple(x[None] for x in proposal)
    assert not in_limits(tight, path, *proposal)
    best = float(training.polish(tight, path.target, path.time, *proposal)[2])
    _, _, kinked = settle(tight, path, proposal, others, motion.energy, steps=0)
    swivel, branch, energy = settle(tight, path, proposal, others, motion.energy)
    assert in_limits(tight, path, swivel, branch)
    assert kinked > 1.02 * best
    assert best * (1 - 1e-9) <= energy < (1 + 1e-6) * best


def test_another_valley_is_taken_where_the_branch_proposed_has_no_arcs(course):
    path, motion, _ = course
    good = motion.swivel, motion.branch
    # The elbow bends to one side only: half of the branches are gone.
    sign = float(jnp.sign(motion.q[0, 3]))
    side = "upper" if sign < 0 else "lower"
    arm = eqx.tree_at(lambda a: getattr(a, side), ARM, getattr(ARM, side).at[3].set(0.0))
    valid = np.asarray(jaxik.swivel_arcs(arm, path.target).valid).any(-1).all(0)
    assert valid.sum() == 4
    for other in np.flatnonzero(~valid):
        proposal = motion.swivel, jnp.full_like(motion.branch, other)
        aside = motion.swivel + jnp.pi, motion.branch
        others = tuple(jnp.stack([a, b]) for a, b in zip(aside, good, strict=True))
        swivel, branch, energy = settle(arm, path, proposal, others, motion.energy)
        np.testing.assert_array_equal(branch, motion.branch)
        assert energy < 1.05 * float(motion.energy)
        # And where the others propose this branch too, every branch is tried.
        nowhere = tuple(x[None] for x in proposal)
        swivel, branch, _ = settle(arm, path, proposal, nowhere, motion.energy)
        assert np.isfinite(swivel).all()
        assert valid[branch[0]]
        assert in_limits(arm, path, swivel, branch)


def test_a_motion_that_costs_what_it_should_is_left_alone(course):
    """Another valley, even a cheaper one, is not looked into: most paths would pay for nothing."""
    path, motion, _ = course
    aside = motion.swivel + 0.1, motion.branch
    others = tuple(x[None] for x in (motion.swivel, motion.branch))
    _, _, dear = settle(ARM, path, aside, others, jnp.asarray(1e3), steps=0)
    swivel, _, energy = settle(ARM, path, aside, others, dear / 1.01, steps=0)
    np.testing.assert_allclose(swivel, aside[0], atol=1e-9)
    assert energy > 1.001 * float(motion.energy)


def test_a_bad_target_has_no_swivel_and_the_others_keep_theirs(course):
    path, motion, _ = course
    position = path.target.position.at[7].set(jnp.nan).at[20].set(10.0)
    bad = jaxik.Path(jaxik.Pose(position, path.target.rotation), path.time)
    proposal = motion.swivel, motion.branch
    others = tuple(x[None] for x in proposal)
    for smooth in (motion.energy, jnp.asarray(jnp.nan)):
        swivel, _, _ = settle(ARM, bad, proposal, others, smooth)
        assert np.isnan(swivel[[7, 20]]).all()
    swivel, branch, _ = settle(ARM, bad, proposal, others, motion.energy)
    good = np.delete(np.arange(len(swivel)), [7, 20])
    assert np.isfinite(swivel[good]).all()
    rest = jaxik.Path(jax.tree.map(lambda x: x[good], path.target), path.time[good])
    assert in_limits(ARM, rest, swivel[good], branch[good])


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "row", "knots"), [(52, 1037, 32), (51, 1596, 32), (51, 1336, 16)])
def test_paths_on_which_moved_waypoints_jumped(seed, row, knots):
    """Three of 3000 random paths: with each waypoint moved by itself they cost 5 to 46 times the least energy."""
    paths = random_paths(jax.random.key(seed), ARM, jnp.array([row], jnp.int32), 100)
    policy = training.make_policy(jax.random.key(0), ARM)
    path = jax.tree.map(lambda x: x[0], paths)
    motion = policy(path.target, path.time, knots=knots)
    assert motion.feasible
    assert in_limits(ARM, path, motion.swivel.astype(float), motion.branch)
    best = jaxik.least_energy_motion(ARM, path.target, path.time, search=64).energy
    energy = jaxik.energy.joint_motion()(ARM, motion.q.astype(float), path.time)
    assert float(energy) < 1.02 * float(best)
