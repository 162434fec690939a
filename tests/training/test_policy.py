"""The elbow policy: its prices against solve_ik, its motions against forward kinematics."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
import training
from training.elbow_charts import elbow_charts
from training.loop import LoopConfig
from training.network import WaypointNet
from training.paths import followable, random_paths
from training.policy import interpolation, no_start
from training.prices import EXCESS, Start, constant_prices

MODEL = jaxik.presets.iiwa14()
ARM = MODEL.arm
SINGLE = ARM.astype(jnp.float32)


@pytest.fixture(scope="module")
def paths():
    return training.held_out_paths(ARM, 12, seed=3, waypoints=40)


@pytest.fixture(scope="module")
def restless():
    """A policy whose network says something everywhere, and leaves the limits here and there."""
    policy = training.make_policy(jax.random.key(0), ARM, width=8)
    last = 2.0 * jax.random.normal(jax.random.key(1), policy.nets[0].last.shape, jnp.float32)
    return eqx.tree_at(lambda p: p.nets[0].last, policy, last)


def test_a_path_depends_on_the_seed_and_its_number_alone():
    key = jax.random.key(5)
    many = random_paths(key, SINGLE, jnp.arange(6), 8)
    few = random_paths(key, SINGLE, jnp.array([4, 2]), 8)
    for a, b in zip(jax.tree.leaves(many), jax.tree.leaves(few), strict=True):
        np.testing.assert_allclose(a[jnp.array([4, 2])], b, rtol=1e-6, atol=1e-6)
    assert not np.array_equal(many.time_s, random_paths(jax.random.key(6), SINGLE, jnp.arange(6), 8).time_s)


def test_followable_paths_have_room_in_one_branch(paths):
    width = np.asarray(jaxik.swivel_arcs(ARM, paths.target).width)  # (path, K, branch)
    assert followable(ARM, paths).all()
    judged = np.linspace(0, 39, 8).round().astype(int)
    assert (width[:, judged].min(axis=1).max(axis=-1) > 0.5).all()


@pytest.mark.parametrize("started", [False, True])
def test_prices_are_those_of_postures(paths, started):
    few = jax.tree.map(lambda x: x[:3, ::8], paths)
    candidates = jnp.array([-2.0, 0.3, 1.7])[:, None] * jnp.ones(3)
    weight = jnp.arange(1.0, 8.0)
    start = no_start(ARM, 3)
    if started:
        start = Start(0.1 * jnp.arange(21.0).reshape(7, 3), jnp.array([1.0, 2.0, 0.5]))
    times = few.time_s.T
    prices, excess = constant_prices(ARM, elbow_charts(ARM, few.target), times, candidates, weight, start)
    near = lambda d: d - 2 * np.pi * np.round(d / (2 * np.pi))  # noqa: E731
    lower, upper = np.asarray(ARM.lower), np.asarray(ARM.upper)
    for path in range(3):
        for place in range(3):
            swivel = jnp.full(times.shape[0], candidates[place, path])
            target = jax.tree.map(lambda x, i=path: x[i], few.target)
            q = np.moveaxis(np.asarray(jaxik.solve_ik(ARM, target, swivel).q), 1, 0)
            rate = 1 / np.diff(np.asarray(times)[:, path])
            motion = (np.asarray(weight) * near(np.diff(q, axis=1)) ** 2 * rate[:, None]).sum((1, 2))
            coming = (np.asarray(weight) * near(q[:, 0] - np.asarray(start.q)[:, path]) ** 2).sum(-1)
            motion = motion + coming * float(start.rate[path])
            over = np.maximum(np.maximum(lower - q, q - upper), 0).mean(1).sum(-1)
            over += (np.abs(np.diff(q, axis=1)) > np.pi).sum((1, 2))
            np.testing.assert_allclose(excess[:, place, path], over, atol=1e-9)
            np.testing.assert_allclose(prices[:, place, path], motion * (1 + EXCESS * over), rtol=1e-9)


def test_a_motion_reaches_its_targets_inside_every_limit(paths, restless):
    # Of a path that is judged at eight waypoints some others may be out of reach: no branch serves it.
    served = np.asarray(jaxik.swivel_arcs(ARM, paths.target).valid).any(-1).all(1).any(-1)
    np.testing.assert_array_equal(restless(paths.target, paths.time_s, knots=20).feasible, served)
    assert served.sum() >= 10
    paths = jax.tree.map(lambda x: x[np.flatnonzero(served)], paths)
    motion = restless(paths.target, paths.time_s, knots=20)
    branch = jnp.broadcast_to(motion.branch[:, None], motion.swivel.shape)
    solution = jaxik.solve_ik(ARM, paths.target, motion.swivel.astype(float))
    pick = lambda x: jnp.take_along_axis(x, branch.reshape(*branch.shape, *(1,) * (x.ndim - 2)), 2)[:, :, 0]  # noqa: E731
    assert (pick(solution.status) <= jaxik.Status.NEAR_SINGULAR).all()
    q = pick(solution.q)
    assert ((q >= ARM.lower - 1e-9) & (q <= ARM.upper + 1e-9)).all()
    np.testing.assert_allclose(np.sin((q - motion.q.astype(float)) / 2), 0, atol=1e-4)  # single precision
    reached = jaxik.forward_kinematics(ARM, motion.q.astype(float))
    np.testing.assert_allclose(reached.position, paths.target.position, atol=1e-4)
    # The projection had work to do: without it some waypoints are outside.
    index = np.unique(np.linspace(0, 39, 20).round().astype(int))
    float32 = jax.tree.map(lambda x: x[:, index].astype(jnp.float32), paths)
    proposal = restless.propose(float32.target, float32.time_s, no_start(SINGLE, len(paths.time_s)))
    free = proposal.charts.joints(proposal.swivels[-1])
    assert float(proposal.charts.excess(SINGLE, free, proposal.swivels[-1]).max()) > 0.05


def test_one_path_is_a_batch_of_one(paths, restless):
    path = jax.tree.map(lambda x: x[0], paths)
    one, many = restless(path.target, path.time_s, knots=20), restless(paths.target, paths.time_s, knots=20)
    assert one.swivel.shape == (40,)
    np.testing.assert_allclose(one.swivel, many.swivel[0], atol=1e-4)


def test_a_file_gives_the_same_bits_back(tmp_path, restless):
    training.save_policy(restless, tmp_path / "p")
    again = training.load_policy(tmp_path / "p")
    assert jax.tree.structure(again) == jax.tree.structure(restless)
    assert all(np.array_equal(a, b) for a, b in zip(jax.tree.leaves(again), jax.tree.leaves(restless), strict=True))
    (tmp_path / "p").write_bytes((tmp_path / "p").read_bytes()[:-100])
    with pytest.raises(jaxik.FileFormatError, match="do not fit"):
        training.load_policy(tmp_path / "p")
    (tmp_path / "q").write_text("no policy")
    with pytest.raises(jaxik.FileFormatError, match="not a jaxik-policy"):
        training.load_policy(tmp_path / "q")


def test_interpolation_keeps_knots_and_straight_lines():
    index = np.array([0, 3, 5, 11, 12])
    matrix = np.asarray(interpolation(index, 13))
    np.testing.assert_allclose(matrix[index], np.eye(5), atol=1e-6)
    np.testing.assert_allclose(matrix.sum(axis=1), 1, atol=1e-6)
    even = np.arange(0, 13, 3)
    np.testing.assert_allclose(np.asarray(interpolation(even, 13)) @ even, np.arange(13), atol=1e-5)


def test_a_network_without_neighbors_sees_each_waypoint_alone():
    x = jax.random.normal(jax.random.key(0), (3, 5, 2), jnp.float32)
    for dilations, alone in (((0, 0), True), ((1, 2), False)):
        net = WaypointNet(3, 2, 8, dilations, jax.random.key(1))
        net = eqx.tree_at(lambda n: n.last, net, jnp.ones((2, 8), jnp.float32))
        changed = np.abs(np.asarray(net(x) - net(x.at[:, 2, 0].add(1.0)))).max(axis=(0, 2)) > 1e-6
        assert (changed.sum() == 1) == alone


@pytest.mark.slow
def test_a_short_training_halves_what_the_constant_swivel_wastes(paths):
    config = training.PolicyConfig(loop=LoopConfig(steps=120, batch=128, validate_every=60), plans=0, beams=1)
    trained = training.train(config, MODEL)
    score = training.evaluate(trained.policy, paths)
    before = training.evaluate(training.make_policy(jax.random.key(0), ARM), paths)
    assert score.violations == 0
    assert np.median(score.excess) < 0.7 * np.median(before.excess)
    assert trained.by_energy.losses[-20:].mean() < trained.by_energy.losses[:20].mean() - 0.03
