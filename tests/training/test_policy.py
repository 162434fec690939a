"""The elbow policy: its paths, its network, its motions against forward kinematics, and its training."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
import training
from jaxik.planning.fast import CANDIDATES, best_candidate, candidates, no_start, path_batch, planner
from training.loop import LoopConfig
from training.policy.random_paths import followable, random_paths
from training.waypoint_net import WaypointNet

MODEL = jaxik.presets.iiwa14()
ARM = MODEL.arm
SINGLE = ARM.astype(jnp.float32)


@pytest.fixture(scope="module", autouse=True)
def some_at_once():
    """So few paths at once that the tests' batches are worked on in parts."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planner, "AT_ONCE", 8)
        yield


@pytest.fixture(scope="module")
def paths():
    return training.held_out_paths(ARM, 12, seed=3, waypoints=40)


@pytest.fixture(scope="module")
def restless():
    """A policy whose network changes every swivel, and leaves the limits here and there."""
    policy = training.make_policy(ARM, key=jax.random.key(0), width=8)
    last = 3.0 * jax.random.normal(jax.random.key(1), policy.net.last.shape, jnp.float32)
    return eqx.tree_at(lambda p: p.net.last, policy, last)


def test_a_path_depends_on_the_seed_and_its_number_alone():
    key = jax.random.key(5)
    many = random_paths(key, SINGLE, jnp.arange(6), 8)
    few = random_paths(key, SINGLE, jnp.array([4, 2]), 8)
    for a, b in zip(jax.tree.leaves(many), jax.tree.leaves(few), strict=True):
        np.testing.assert_allclose(a[jnp.array([4, 2])], b, rtol=1e-6, atol=1e-6)
    assert not np.array_equal(many.time, random_paths(jax.random.key(6), SINGLE, jnp.arange(6), 8).time)


def test_followable_paths_have_room_in_one_branch(paths):
    width = np.asarray(jaxik.swivel_arcs(ARM, paths.target).width)  # (path, K, branch)
    assert followable(ARM, paths).all()
    judged = np.linspace(0, 39, 8).round().astype(int)
    assert (width[:, judged].min(axis=1).max(axis=-1) > 0.5).all()


@pytest.mark.slow
def test_a_motion_reaches_its_targets_inside_every_limit(paths, restless):
    # Of a path that is judged at eight waypoints some others may be out of reach: no branch serves it.
    served = np.asarray(jaxik.swivel_arcs(ARM, paths.target).valid).any(-1).all(1).any(-1)
    np.testing.assert_array_equal(restless(paths.target, paths.time, knots=16).feasible, served)
    assert served.sum() >= 10
    paths = jax.tree.map(lambda x: x[np.flatnonzero(served)], paths)
    motion = restless(paths.target, paths.time, knots=16)
    branch = motion.branch
    solution = jaxik.solve_ik(ARM, paths.target, motion.swivel.astype(float))
    pick = lambda x: jnp.take_along_axis(x, branch.reshape(*branch.shape, *(1,) * (x.ndim - 2)), 2)[:, :, 0]  # noqa: E731
    assert (pick(solution.status) <= jaxik.Status.NEAR_SINGULAR).all()
    q = pick(solution.q)
    assert ((q >= ARM.lower - 1e-9) & (q <= ARM.upper + 1e-9)).all()
    # Single precision, and more of its rounding where a shoulder or wrist is almost aligned.
    np.testing.assert_allclose(np.sin((q - motion.q.astype(float)) / 2), 0, atol=5e-4)
    reached = jaxik.forward_kinematics(ARM, motion.q.astype(float))
    np.testing.assert_allclose(reached.position, paths.target.position, atol=1e-4)
    # The repair had work to do: without it some waypoints are outside.
    index = np.unique(np.linspace(0, 39, 16).round().astype(int))
    float32 = jax.tree.map(lambda x: x[:, index].astype(jnp.float32), paths)
    batch = path_batch(SINGLE, float32.target, float32.time, restless.weights, no_start(SINGLE, len(paths.time)))
    candidate = best_candidate(batch, CANDIDATES)
    swivel = restless.answer(batch, candidate)
    assert float(candidate.motion.excess(candidate.motion.angles(swivel), swivel).max()) > 0.05


@pytest.mark.slow
def test_an_untrained_policy_plans_as_the_fast_planner_does(paths):
    weights = jnp.array([3.0, 1.0, 1.0, 2.0, 1.0, 1.0, 0.5])
    for energy, alone in (
        (jaxik.energy.joint_motion(weights), True),
        (jaxik.energy.joint_motion(weights) + jaxik.energy.smoothness(), False),
    ):
        policy = training.make_policy(MODEL, key=jax.random.key(0), energy=energy, width=8)
        assert policy.motion_alone == alone
        mine = policy(paths.target, paths.time, knots=16)
        plain = jaxik.plan_batch(MODEL, paths.target, paths.time, energy=energy, knots=16)
        np.testing.assert_array_equal(mine.status, plain.status)
        np.testing.assert_array_equal(mine.branch, plain.branch)
        np.testing.assert_allclose(mine.swivel, plain.swivel, atol=1e-4)


@pytest.mark.slow
def test_one_path_is_a_batch_of_one(paths, restless):
    path = jax.tree.map(lambda x: x[0], paths)
    one, many = restless(path.target, path.time, knots=16), restless(paths.target, paths.time, knots=16)
    assert one.swivel.shape == (40,)
    np.testing.assert_allclose(one.swivel, many.swivel[0], atol=1e-4)


@pytest.mark.slow
def test_a_target_that_cannot_be_reached_has_no_swivel(paths, restless):
    """Two bad waypoints: their paths are not feasible, and nothing else changes."""
    good = restless(paths.target, paths.time, knots=16)
    position = paths.target.position.at[0, 5].set(jnp.nan).at[1, 6].set(10.0)
    motion = restless(jaxik.Pose(position, paths.target.rotation), paths.time, knots=16)
    np.testing.assert_array_equal(motion.feasible[:2], [False, False])
    np.testing.assert_array_equal(motion.feasible[2:], good.feasible[2:])
    assert jnp.isnan(motion.swivel[0, 5]) & jnp.isnan(motion.swivel[1, 6])
    assert jnp.isnan(motion.q[0, 5]).all() & jnp.isnan(motion.q[1, 6]).all()
    np.testing.assert_allclose(motion.swivel[2:], good.swivel[2:], atol=1e-4)


def test_a_file_gives_the_same_bits_back(tmp_path, restless):
    training.save_policy(restless, tmp_path / "p")
    again = training.load_policy(tmp_path / "p")
    assert jax.tree.structure(again) == jax.tree.structure(restless)
    assert all(np.array_equal(a, b) for a, b in zip(jax.tree.leaves(again), jax.tree.leaves(restless), strict=True))
    (tmp_path / "p").write_bytes((tmp_path / "p").read_bytes()[:-100])
    with pytest.raises(jaxik.FileFormatError, match="do not match"):
        training.load_policy(tmp_path / "p")
    (tmp_path / "q").write_text("no policy")
    with pytest.raises(jaxik.FileFormatError, match="expected a jaxik-policy"):
        training.load_policy(tmp_path / "q")


def test_a_network_without_neighbors_sees_each_waypoint_alone():
    x = jax.random.normal(jax.random.key(0), (3, 5, 2), jnp.float32)
    for dilations, alone in (((0, 0), True), ((1, 2), False)):
        net = WaypointNet(3, 2, 8, dilations, jax.random.key(1))
        net = eqx.tree_at(lambda n: n.last, net, jnp.ones((2, 8), jnp.float32))
        changed = np.abs(np.asarray(net(x) - net(x.at[:, 2, 0].add(1.0)))).max(axis=(0, 2)) > 1e-6
        assert (changed.sum() == 1) == alone


@pytest.mark.slow
def test_a_trained_policy_is_near_the_planner_and_nearer_when_refined(paths, monkeypatch):
    # The steps before the comparison leave nothing to win at the knots: what training wins shows without them.
    monkeypatch.setattr(candidates, "_TRIAL_STEPS", 0)
    loop = LoopConfig(steps=180, batch=32, validate_every=1, patience=180)
    trained = training.train(training.PolicyConfig(loop=loop, plans=0, validation_rows=64), arm=MODEL)
    validations = [loss for _, loss in trained.by_energy.validation]
    # The first step's rate is zero, so that validation is of the untrained policy; its search leaves little to win.
    assert min(validations) < validations[0] - 5e-4
    score = training.evaluate(trained.policy, paths)
    assert score.violations == 0
    assert len(score.excess) >= 10
    assert score.excess.mean() < 0.05
    assert score.refined.mean() < 0.01
