"""The elbow policy: its search and steps against solve_ik and dense algebra, its motions against forward kinematics."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
import training
from jaxik.planning.fast import candidates as outlook
from jaxik.planning.fast.branch_changes import filled
from jaxik.planning.fast.coarse_costs import CELLS, Start, cell_swivels
from jaxik.planning.fast.coarse_search import EXCESS, best_valleys, coarse
from jaxik.planning.fast.gauss_newton import linear_step
from jaxik.planning.fast.knots import interpolation, knots_for
from jaxik.planning.fast.path_batch import elbow_charts, near
from training.loop import LoopConfig
from training.policy import policy as policy_module
from training.policy.network import WaypointNet
from training.policy.policy import no_start
from training.policy.random_paths import followable, random_paths

MODEL = jaxik.presets.iiwa14()
ARM = MODEL.arm
SINGLE = ARM.astype(jnp.float32)
VALLEYS = jax.jit(lambda arm, target, *rest: best_valleys(arm, elbow_charts(arm, target), *rest, 6))
STEP = jax.jit(linear_step)


@pytest.fixture(scope="module", autouse=True)
def some_at_once():
    """So few paths at once that the tests' batches are worked on in parts."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(policy_module, "AT_ONCE", 8)
        yield


@pytest.fixture(scope="module")
def paths():
    return training.held_out_paths(ARM, 12, seed=3, waypoints=40)


@pytest.fixture(scope="module")
def restless():
    """A policy whose network says something everywhere, and leaves the limits here and there."""
    policy = training.make_policy(jax.random.key(0), ARM, width=8)
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


def started(count: int) -> Start:
    return Start(0.1 * jnp.arange(7.0 * count).reshape(7, count), jnp.linspace(0.0, 2.0, count))


def test_no_coarse_motion_costs_less_than_the_ones_found(paths):
    """Every cell and branch priced by solve_ik, and the cheapest way through each middle cell by another program."""
    few = jax.tree.map(lambda x: x[:4, ::9], paths)
    weight, start, times = jnp.arange(1.0, 8.0), started(4), few.time.T
    swivel, branch = map(np.asarray, VALLEYS(ARM, few.target, times, weight, start))
    grid = np.asarray(jax.jit(lambda t: cell_swivels(elbow_charts(ARM, t)))(few.target))  # (K, elbow bit, cell, path)
    bit = np.arange(8) >> 1 & 1
    lower, upper = np.asarray(ARM.lower), np.asarray(ARM.upper)
    # One branch, an aligned shoulder, an aligned wrist; to a branch from a branch, and to a cell from a cell.
    change = np.arange(8)[:, None] ^ np.arange(8)
    cell = np.arange(CELLS)
    off = (cell[:, None] - cell + CELLS // 2) % CELLS - CELLS // 2
    allowed = np.isin(change, (0, 1, 4))[:, None, :, None] & (np.abs(off) <= 1)[None, :, None]
    for path in range(4):
        at = grid[..., path][:, bit]  # (K, branch, cell)
        target = jax.tree.map(lambda x, i=path: x[i, :, None, None], few.target)
        q = np.asarray(jaxik.solve_ik(ARM, target, jnp.asarray(at)).q)[:, np.arange(8), :, np.arange(8)]
        q = np.moveaxis(q, 0, 1)  # (K, branch, cell, joint)
        rate = 1 / np.diff(np.asarray(times)[:, path])
        over = np.maximum(np.maximum(lower - q, q - upper), 0).sum(-1)
        apart = q[1:, :, :, None, None] - q[:-1, None, None]
        motion = (apart**2 @ np.asarray(weight)) * rate[:, None, None, None, None]
        turn = q[0] - np.asarray(start.q)[:, path]
        turn -= 2 * np.pi * np.round(turn / (2 * np.pi))
        coming = turn**2 @ np.asarray(weight) * float(start.rate[path])
        held = np.einsum("kbcbc->bc", motion) * (1 + EXCESS * over.mean(0))
        price = EXCESS * held.min() / len(over)
        motion[:, ~allowed] = np.inf
        forward = [coming + price * over[0]]
        for k in range(len(rate)):
            forward.append((motion[k] + forward[-1]).min(axis=(2, 3)) + price * over[k + 1])
        going = 0 * coming
        for k in range(len(rate) - 1, len(rate) // 2 - 1, -1):
            going = (motion[k] + (going + price * over[k + 1])[:, :, None, None]).min(axis=(0, 1))
        through = (forward[len(rate) // 2] + going).min(axis=0)
        found = []
        for candidate in range(6):
            b = branch[candidate, :, path]
            near_cell = np.abs(
                np.asarray(near(jnp.asarray(at[np.arange(len(b)), b] - swivel[candidate, :, path, None])))
            )
            c = near_cell.argmin(axis=1)
            assert near_cell.min(axis=1).max() < 1e-9
            mine = coming[b[0], c[0]] + price * over[np.arange(len(b)), b, c].sum()
            mine += sum(motion[k, b[k + 1], c[k + 1], b[k], c[k]] for k in range(len(rate)))
            assert mine == pytest.approx(through[c[len(c) // 2]], rel=1e-3)  # ties go to the first branch
            found.append(mine)
        # But for cells on a ridge: a joint may be half a turn off there, and rounding says to which end of its range.
        assert found[0] == pytest.approx(through.min(), rel=1e-3)
        assert (np.diff(found) > -1e-3 * found[0]).all()


def test_a_filled_course_passes_through_the_alignment(paths):
    """A wrist that passes its alignment: the branch changes, the joints go straight on."""
    q = jnp.linspace(-0.3, 0.4, 41)[:, None] * jnp.array([0.3, 0.2, -0.2, 0.3, 0.2, 1.0, 0.4])
    q = q + jnp.array([0.2, 0.7, 0.3, -1.2, 0.4, 0.0, 0.1])
    q = q.at[:, 2].add(0.5 * jnp.sin(jnp.linspace(0.0, jnp.pi, 41)))
    target = jax.tree.map(lambda x: x[None], jaxik.forward_kinematics(ARM, q))
    swivel, branch = jaxik.swivel_of(ARM, q)
    assert set(np.asarray(branch[0] ^ branch)) == {0, 1}
    charts = elbow_charts(ARM, target)
    index = np.array([0, 40])
    course, along = filled(charts, index, swivel[index][:, None], branch[index][:, None])
    np.testing.assert_array_equal(along[:, 0], branch)
    np.testing.assert_array_equal(course[index, 0], swivel[index])
    straight = jnp.interp(jnp.arange(41), index, jnp.unwrap(swivel[index]))[:, None]

    def off(swivel):
        return np.abs(np.asarray(near(charts.of(along).joints(swivel)[..., 0].T - q))).max()

    assert off(course) < 0.3 * off(straight)  # which misses it, so that joints turn


@pytest.mark.parametrize("knots", [2, 3, 4, 16, 17, 32])
def test_the_search_looks_at_an_odd_number_of_knots(knots):
    index = coarse(knots)
    assert len(index) % 2 == 1
    assert knots == 2 or (index[0], index[-1]) == (0, knots - 1)
    assert (np.diff(index) > 0).all()


@pytest.mark.parametrize("limits", ["far", "near"])
def test_a_linear_step_is_the_least_squares_solution(paths, limits):
    """The oracle: residuals written out, their Jacobian by automatic differentiation, dense normal equations."""
    few = jax.tree.map(lambda x: x[:4, ::9], paths)
    weight, start, times = jnp.arange(1.0, 8.0), started(4), few.time.T
    swivel, branch = (x[0] for x in VALLEYS(ARM, few.target, times, weight, start))
    arm, charts = ARM, jax.jit(lambda target, branch: elbow_charts(ARM, target).of(branch))(few.target, branch)
    if limits == "near":  # joints that are beyond their limits by a little here and there
        q = charts.joints(swivel)
        arm = eqx.tree_at(lambda a: a.upper, arm, jnp.min(jnp.max(q, axis=1), axis=1) - 0.01)
    joints = jax.jit(lambda charts, swivel: charts.slopes(swivel))(charts, swivel)
    step = STEP(arm, charts, swivel, *joints, times, weight, start)
    rate = 1.0 / jnp.diff(times, axis=0)
    push = 30.0 * jnp.max(weight) * jnp.mean(rate, axis=0)

    def residuals(x, path):
        q = charts.joints(jnp.broadcast_to(x[:, None], swivel.shape))[:, :, path]
        way = jnp.sqrt(weight[:, None] * rate[:, path]) * near(jnp.diff(q, axis=1))
        coming = jnp.sqrt(weight * start.rate[path]) * near(q[:, 0] - start.q[:, path])
        low, high = q - (arm.lower[:, None] + 0.02), (arm.upper[:, None] - 0.02) - q
        missing = jnp.sqrt(push[path]) * jnp.minimum(jnp.minimum(low, high), 0.0)
        return jnp.concatenate([way.ravel(), coming, missing.ravel()])

    both = jax.jit(lambda x, path: (residuals(x, path), jax.jacfwd(residuals)(x, path)))
    for path in range(4):
        x = swivel[:, path]
        r, slope = map(np.asarray, both(x, path))
        normal = slope.T @ slope
        normal += 1e-3 * np.trace(normal) / len(x) * np.eye(len(x))
        np.testing.assert_allclose(step[:, path], np.clip(-np.linalg.solve(normal, slope.T @ r), -0.6, 0.6), atol=1e-9)


def test_long_paths_have_more_knots():
    path = jaxik.fit_path(jaxik.example_path("wave"), ARM)
    way = np.linalg.norm(np.diff(path.target.position, axis=0), axis=1).sum() / float(ARM.length)
    turns = np.einsum("kij,lij->kl", path.target.rotation, path.target.rotation)
    way += np.arccos(np.clip((np.diagonal(turns, 1) - 1) / 2, -1, 1)).sum()
    ten = jax.tree.map(lambda x: jnp.concatenate([x, x[::-1]] * 5), path.target)
    wanted = lambda way: next((n for n in (16, 32, 64, 128) if way <= 0.3 * n), 128)  # noqa: E731
    assert knots_for(ARM.length, path.target) == wanted(way)
    assert knots_for(ARM.length, ten) == wanted(10 * way) > wanted(way)


@pytest.mark.slow
def test_a_motion_reaches_its_targets_inside_every_limit(paths, restless):
    # Of a path that is judged at eight waypoints some others may be out of reach: no branch serves it.
    served = np.asarray(jaxik.swivel_arcs(ARM, paths.target).valid).any(-1).all(1).any(-1)
    np.testing.assert_array_equal(restless(paths.target, paths.time, knots=20).feasible, served)
    assert served.sum() >= 10
    paths = jax.tree.map(lambda x: x[np.flatnonzero(served)], paths)
    motion = restless(paths.target, paths.time, knots=20)
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
    # The projection had work to do: without it some waypoints are outside.
    index = np.unique(np.linspace(0, 39, 20).round().astype(int))
    float32 = jax.tree.map(lambda x: x[:, index].astype(jnp.float32), paths)
    charts = elbow_charts(SINGLE, float32.target)
    seen = restless.outlook(charts, float32.time.T, no_start(SINGLE, len(paths.time)))
    swivel = restless.answer(seen)
    assert float(seen.charts.excess(SINGLE, seen.charts.joints(swivel), swivel).max()) > 0.05


@pytest.mark.slow
def test_one_path_is_a_batch_of_one(paths, restless):
    path = jax.tree.map(lambda x: x[0], paths)
    one, many = restless(path.target, path.time, knots=20), restless(paths.target, paths.time, knots=20)
    assert one.swivel.shape == (40,)
    np.testing.assert_allclose(one.swivel, many.swivel[0], atol=1e-4)


@pytest.mark.slow
def test_a_target_that_cannot_be_reached_has_no_swivel(paths, restless):
    """Two bad waypoints: their paths are not feasible, and nothing else changes."""
    good = restless(paths.target, paths.time, knots=20)
    position = paths.target.position.at[0, 5].set(jnp.nan).at[1, 6].set(10.0)
    motion = restless(jaxik.Pose(position, paths.target.rotation), paths.time, knots=20)
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
def test_a_trained_policy_is_near_the_planner_and_nearer_with_polish(paths, monkeypatch):
    # The linear steps of the comparison leave nothing to win at the knots: what training wins shows without them.
    monkeypatch.setattr(outlook, "_LOOKS", 0)
    loop = LoopConfig(steps=90, batch=32, validate_every=1, patience=90)
    trained = training.train(training.PolicyConfig(loop=loop, plans=0, validation_rows=64), MODEL)
    looks = [loss for _, loss in trained.by_energy.validation]
    # The first step's rate is zero, so that look is of the untrained policy; its search leaves little to win.
    assert min(looks) < looks[0] - 5e-4
    score = training.evaluate(trained.policy, paths)
    assert score.violations == 0
    assert len(score.excess) >= 10
    assert score.excess.mean() < 0.05
    assert score.polished.mean() < 0.01
