"""The fast planner: its search and steps against solve_ik and dense algebra, its motions against forward kinematics."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
import training
from jaxik.numerics import principal
from jaxik.planning.fast import planner
from jaxik.planning.fast.branch_changes import interpolate
from jaxik.planning.fast.coarse_costs import CELLS, cell_swivels
from jaxik.planning.fast.coarse_search import coarse_search, searched_knots
from jaxik.planning.fast.gauss_newton import gauss_newton_step
from jaxik.planning.fast.knots import interpolation, knots_for
from jaxik.planning.fast.path_batch import EXCESS, StartPostures, SwivelPath, no_start, path_batch
from tests.helpers.compiling import hardly_optimized

MODEL = jaxik.presets.iiwa14()
ARM = MODEL.arm
BATCH = jax.jit(path_batch)
SEARCH = jax.jit(coarse_search, static_argnums=1)
STEP = jax.jit(gauss_newton_step)
KNOTS = 16


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
def motion(paths):
    return jaxik.plan_batch(ARM, paths.target, paths.time, knots=KNOTS)


@pytest.fixture(scope="module")
def few(paths):
    """Four paths of five waypoints that the arms come to from somewhere, in double precision."""
    some = jax.tree.map(lambda x: x[:4, ::9], paths)
    start = StartPostures(0.1 * jnp.arange(28.0).reshape(7, 4), jnp.linspace(0.0, 2.0, 4))
    return some, BATCH(ARM, some.target, some.time, jnp.arange(1.0, 8.0), start)


def energies(q, time):
    """Σ Δq² / dt of joint angles ``(path, K, joint)``."""
    q, time = np.asarray(q, float), np.asarray(time)
    return (np.diff(q, axis=1) ** 2 / np.diff(time, axis=1)[..., None]).sum(axis=(1, 2))


def test_no_coarse_motion_costs_less_than_the_ones_found(few):
    """The cost of every cell and branch by solve_ik, and the least cost through each middle cell by another program."""
    paths, batch = few
    weight, start, times = np.asarray(batch.weights), batch.start, np.asarray(batch.time)
    swivel, branch = map(np.asarray, SEARCH(batch, 6))
    grid = np.asarray(jax.jit(cell_swivels)(batch.motion))  # (K, elbow bit, cell, path)
    bit = np.arange(8) >> 1 & 1
    lower, upper = np.asarray(ARM.lower), np.asarray(ARM.upper)
    # One branch, an aligned shoulder, an aligned wrist; to a branch from a branch, and to a cell from a cell.
    change = np.arange(8)[:, None] ^ np.arange(8)
    cell = np.arange(CELLS)
    off = (cell[:, None] - cell + CELLS // 2) % CELLS - CELLS // 2
    allowed = np.isin(change, (0, 1, 4))[:, None, :, None] & (np.abs(off) <= 1)[None, :, None]
    for path in range(4):
        at = grid[..., path][:, bit]  # (K, branch, cell)
        target = jax.tree.map(lambda x, i=path: x[i, :, None, None], paths.target)
        q = np.asarray(jaxik.solve_ik(ARM, target, jnp.asarray(at)).q)[:, np.arange(8), :, np.arange(8)]
        q = np.moveaxis(q, 0, 1)  # (K, branch, cell, joint)
        rate = 1 / np.diff(times[:, path])
        over = np.maximum(np.maximum(lower - q, q - upper), 0).sum(-1)
        apart = q[1:, :, :, None, None] - q[:-1, None, None]
        moved = (apart**2 @ weight) * rate[:, None, None, None, None]
        approach = (q[0] - np.asarray(start.q)[:, path]) ** 2 @ weight * float(start.rate[path])
        held = np.einsum("kbcbc->bc", moved) * (1 + EXCESS * over.mean(0))
        per_excess = EXCESS * held.min() / len(over)
        moved[:, ~allowed] = np.inf
        forward = [approach + per_excess * over[0]]
        for k in range(len(rate)):
            forward.append((moved[k] + forward[-1]).min(axis=(2, 3)) + per_excess * over[k + 1])
        rest = 0 * approach
        for k in range(len(rate) - 1, len(rate) // 2 - 1, -1):
            rest = (moved[k] + (rest + per_excess * over[k + 1])[:, :, None, None]).min(axis=(0, 1))
        through = (forward[len(rate) // 2] + rest).min(axis=0)
        found = []
        for candidate in range(6):
            b = branch[candidate, :, path]
            off_cell = np.abs(
                np.asarray(principal(jnp.asarray(at[np.arange(len(b)), b] - swivel[candidate, :, path, None])))
            )
            c = off_cell.argmin(axis=1)
            assert off_cell.min(axis=1).max() < 1e-9
            mine = approach[b[0], c[0]] + per_excess * over[np.arange(len(b)), b, c].sum()
            mine += sum(moved[k, b[k + 1], c[k + 1], b[k], c[k]] for k in range(len(rate)))
            assert mine == pytest.approx(through[c[len(c) // 2]], rel=1e-3)  # ties go to the first branch
            found.append(mine)
        # But for cells on a ridge: a joint may be half a turn off there, and rounding says to which end of its range.
        assert found[0] == pytest.approx(through.min(), rel=1e-3)
        assert (np.diff(found) > -1e-3 * found[0]).all()


@pytest.mark.parametrize("knots", [2, 3, 4, 16, 17, 32])
def test_the_search_sees_an_odd_number_of_knots(knots):
    index = searched_knots(knots)
    assert len(index) % 2 == 1
    assert knots == 2 or (index[0], index[-1]) == (0, knots - 1)
    assert (np.diff(index) > 0).all()


def test_an_interpolated_motion_passes_through_the_alignment():
    """A wrist that passes its alignment: the branch changes, the joints go straight on."""
    q = jnp.linspace(-0.3, 0.4, 41)[:, None] * jnp.array([0.3, 0.2, -0.2, 0.3, 0.2, 1.0, 0.4])
    q = q + jnp.array([0.2, 0.7, 0.3, -1.2, 0.4, 0.0, 0.1])
    q = q.at[:, 2].add(0.5 * jnp.sin(jnp.linspace(0.0, jnp.pi, 41)))
    target = jax.tree.map(lambda x: x[None], jaxik.forward_kinematics(ARM, q))
    swivel, branch = jaxik.swivel_of(ARM, q)
    assert set(np.asarray(branch[0] ^ branch)) == {0, 1}
    batch = BATCH(ARM, target, jnp.arange(41.0)[None], jnp.ones(7), no_start(ARM, 1))
    index = np.array([0, 40])
    bent, along = interpolate(batch.motion, index, SwivelPath(swivel[index][:, None], branch[index][:, None]))
    np.testing.assert_array_equal(along[:, 0], branch)
    np.testing.assert_array_equal(bent[index, 0], swivel[index])
    straight = jnp.interp(jnp.arange(41), index, jnp.unwrap(swivel[index]))[:, None]

    def off(swivel):
        return np.abs(np.asarray(principal(batch.motion.branch(along).angles(swivel)[..., 0].T - q))).max()

    assert off(bent) < 0.3 * off(straight)  # which misses it, so that joints turn


@pytest.mark.parametrize("limits", ["far", "near"])
def test_a_gauss_newton_step_is_the_least_squares_solution(few, limits):
    """The oracle: residuals written out, their Jacobian by automatic differentiation, dense normal equations."""
    _, batch = few
    weight, start, times, arm = batch.weights, batch.start, batch.time, ARM
    swivel, branch = (x[0] for x in SEARCH(batch, 6))
    motion = jax.jit(lambda batch, branch: batch.motion.branch(branch))(batch, branch)
    if limits == "near":  # joints that are beyond their limits by a little here and there
        q = motion.angles(swivel)
        arm = dataclasses.replace(arm, upper=jnp.min(jnp.max(q, axis=1), axis=1) - 0.01)
        batch = batch._replace(motion=batch.motion._replace(arm=arm))
    joints = jax.jit(lambda motion, swivel: motion.slopes(swivel))(motion, swivel)
    step = STEP(batch, motion, swivel, *joints)
    rate = 1.0 / jnp.diff(times, axis=0)
    push = 30.0 * jnp.max(weight) * jnp.mean(rate, axis=0)

    def residuals(x, path):
        q = motion.angles(jnp.broadcast_to(x[:, None], swivel.shape))[:, :, path]
        moved = jnp.sqrt(weight[:, None] * rate[:, path]) * principal(jnp.diff(q, axis=1))
        approach = jnp.sqrt(weight * start.rate[path]) * (q[:, 0] - start.q[:, path])
        low, high = q - (arm.lower[:, None] + 0.02), (arm.upper[:, None] - 0.02) - q
        missing = jnp.sqrt(push[path]) * jnp.minimum(jnp.minimum(low, high), 0.0)
        return jnp.concatenate([moved.ravel(), approach, missing.ravel()])

    both = jax.jit(lambda x, path: (residuals(x, path), jax.jacfwd(residuals)(x, path)))
    for path in range(4):
        x = swivel[:, path]
        r, slope = map(np.asarray, both(x, path))
        normal = slope.T @ slope
        normal += 1e-3 * np.trace(normal) / len(x) * np.eye(len(x))
        np.testing.assert_allclose(step[:, path], np.clip(-np.linalg.solve(normal, slope.T @ r), -0.6, 0.6), atol=1e-9)


def test_long_paths_have_more_knots():
    path = jaxik.fit_path(ARM, jaxik.example_path("wave"))
    travel = np.linalg.norm(np.diff(path.target.position, axis=0), axis=1).sum() / float(ARM.length)
    turns = np.einsum("kij,lij->kl", path.target.rotation, path.target.rotation)
    travel += np.arccos(np.clip((np.diagonal(turns, 1) - 1) / 2, -1, 1)).sum()
    ten = jax.tree.map(lambda x: jnp.concatenate([x, x[::-1]] * 5), path.target)
    wanted = lambda travel: next((n for n in (16, 32, 64, 128) if travel <= 0.3 * n), 128)  # noqa: E731
    assert knots_for(ARM, path.target) == wanted(travel)
    assert knots_for(ARM, ten) == wanted(10 * travel) > wanted(travel)


def test_interpolation_keeps_knots_and_straight_lines():
    index = np.array([0, 3, 5, 11, 12])
    matrix = np.asarray(interpolation(index, 13))
    np.testing.assert_allclose(matrix[index], np.eye(5), atol=1e-6)
    np.testing.assert_allclose(matrix.sum(axis=1), 1, atol=1e-6)
    even = np.arange(0, 13, 3)
    np.testing.assert_allclose(np.asarray(interpolation(even, 13)) @ even, np.arange(13), atol=1e-5)


@pytest.mark.slow
def test_motions_reach_their_targets_inside_every_limit(paths, motion):
    # Of a path that is judged at eight waypoints some others may be out of reach: no branch serves it.
    served = np.asarray(jaxik.swivel_arcs(ARM, paths.target).valid).any(-1).all(1).any(-1)
    np.testing.assert_array_equal(motion.ok, served)
    np.testing.assert_array_equal(motion.feasible, served)
    assert served.sum() >= 10
    good = np.flatnonzero(served)
    target = jax.tree.map(lambda x: x[good], paths.target)
    swivel, branch, q = (np.asarray(x)[good] for x in (motion.swivel, motion.branch, motion.q))
    assert (np.abs(np.diff(swivel, axis=1)) < np.pi).all()
    solution = jaxik.solve_ik(ARM, target, jnp.asarray(swivel, float))
    pick = lambda x: jnp.take_along_axis(x, branch.reshape(*branch.shape, *(1,) * (x.ndim - 2)), 2)[:, :, 0]  # noqa: E731
    assert (pick(solution.status) <= jaxik.Status.NEAR_SINGULAR).all()
    exact = pick(solution.q)
    assert ((exact >= ARM.lower - 1e-9) & (exact <= ARM.upper + 1e-9)).all()
    # Single precision, and more of its rounding where a shoulder or wrist is almost aligned.
    np.testing.assert_allclose(np.sin((exact - q.astype(float)) / 2), 0, atol=5e-4)
    reached = jaxik.forward_kinematics(ARM, q.astype(float))
    np.testing.assert_allclose(reached.position, target.position, atol=1e-4)
    np.testing.assert_allclose(reached.rotation, target.rotation, atol=5e-4)
    speed = np.abs(np.diff(q, axis=1)) / np.diff(np.asarray(paths.time)[good], axis=1)[..., None]
    assert (speed <= np.asarray(ARM.velocity_limit) * (1 + 1e-4)).all()


@pytest.fixture(scope="module")
def least():
    """Function of paths and start postures that returns the planner's least-energy motions, in one program."""

    @jax.jit
    def least(paths, start, approach_time):
        def one(row):
            target, time, start = row
            ends = {"start": start, "approach_time": approach_time}
            return jaxik.least_energy_motion(ARM, target, time, search=24, **ends)

        return jax.lax.map(one, (paths.target, paths.time, start))

    return least


@pytest.mark.slow
def test_motions_cost_at_most_two_percent_more_than_the_least(paths, motion, least):
    assert jaxik.searched_waypoints(ARM, paths.target) == 24
    best = least(paths, jnp.zeros((12, 7)), 1e9)
    np.testing.assert_array_equal(motion.ok, best.ok)
    good = np.flatnonzero(best.ok)
    ratio = energies(motion.q, paths.time)[good] / np.asarray(best.energy)[good]
    assert ratio.max() < 1.02
    assert np.median(ratio) < 1.001


@pytest.mark.slow
def test_one_path_a_model_and_a_program_of_ones_own_give_the_same_motion(paths, motion):
    """Inside ``jit`` the parts follow each other in one program; of the weights alone, the paths are constants."""
    path = jax.tree.map(lambda x: x[0], paths)
    one = jaxik.plan_batch(MODEL, path.target, path.time, knots=KNOTS)
    assert (one.swivel.shape, one.q.shape, one.ok.shape) == ((40,), (40, 7), ())
    np.testing.assert_allclose(one.swivel, motion.swivel[0], atol=1e-4)
    by_paths = jax.jit(lambda target, time: jaxik.plan_batch(ARM, target, time))
    by_weights = jax.jit(
        lambda w: jaxik.plan_batch(ARM, paths.target, paths.time, energy=jaxik.energy.joint_motion(w), knots=KNOTS)
    )
    with hardly_optimized():
        of_paths, of_weights = by_paths(paths.target, paths.time), by_weights(jnp.ones(7))
    for compiled in (of_paths, of_weights):
        np.testing.assert_array_equal(compiled.status, motion.status)
        np.testing.assert_array_equal(compiled.branch, motion.branch)
        np.testing.assert_allclose(compiled.swivel, motion.swivel, atol=1e-4)
    square = jaxik.plan_batch(
        MODEL, *jax.tree.map(lambda x: x.reshape(3, 4, *x.shape[1:]), (paths.target, paths.time)), knots=KNOTS
    )
    np.testing.assert_array_equal(square.q.reshape(motion.q.shape), motion.q)


@pytest.mark.slow
def test_another_number_of_paths_shares_the_programs(paths, motion):
    programs = planner._part._cache_size()
    for rows in (slice(0, 11), slice(3, 12)):
        some = jax.tree.map(lambda x, rows=rows: x[rows], paths)
        fewer = jaxik.plan_batch(ARM, some.target, some.time, knots=KNOTS)
        for a, b in zip(jax.tree.leaves(fewer), jax.tree.leaves(motion), strict=True):
            np.testing.assert_allclose(a, b[rows], atol=1e-5)  # vector code rounds by a row's place
    assert planner._part._cache_size() == programs


@pytest.mark.slow
def test_bad_paths_are_named_and_leave_the_others_alone(paths, motion):
    position = paths.target.position.at[0, 5].set(jnp.nan).at[1, 6].set(10.0)
    time = paths.time.at[2].multiply(1e-3).at[4, 7].set(jnp.nan)
    bad = jaxik.plan_batch(ARM, jaxik.Pose(position, paths.target.rotation), time, knots=KNOTS)
    wanted = np.asarray(motion.status).copy()
    wanted[[0, 1]], wanted[[2, 4]] = jaxik.PlanStatus.UNREACHABLE, jaxik.PlanStatus.TOO_FAST
    np.testing.assert_array_equal(bad.status, wanted)
    assert np.isnan(bad.swivel[0, 5]) & np.isnan(bad.swivel[1, 6])
    assert np.isnan(bad.q[0, 5]).all() & np.isnan(bad.q[1, 6]).all()
    assert np.isfinite(bad.q[2]).all()
    np.testing.assert_allclose(bad.swivel[5:], motion.swivel[5:], atol=1e-4)
    with pytest.raises(jaxik.UnreachableError, match=r"of 12 paths have no motion; path \(0,\): some waypoints"):
        bad.raise_if_invalid()
    good = jax.tree.map(lambda x: x[4:], motion)
    assert good.raise_if_invalid() is good
    late = jax.tree.map(lambda x: x[2], bad)
    with pytest.raises(jaxik.UnreachableError, match="1 of 1 paths have no motion; joint velocity limits"):
        late.raise_if_invalid()


@pytest.mark.slow
@pytest.mark.parametrize("approach_time", [0.05, 2.0])
def test_a_start_is_part_of_what_is_minimized(paths, motion, least, approach_time):
    """From postures anywhere, against the planner's motions from there: no joint passes through its limits."""
    good = np.flatnonzero(motion.ok)
    lower, upper = np.asarray(ARM.lower), np.asarray(ARM.upper)
    start = np.random.default_rng(0).uniform(lower, upper, (12, 7))

    def total(q):
        approach = ((np.asarray(q, float)[:, 0] - start) ** 2).sum(-1) / approach_time
        return (energies(q, paths.time) + approach)[good]

    ends = {"start": jnp.asarray(start), "approach_time": approach_time}
    began = jaxik.plan_batch(ARM, paths.target, paths.time, knots=KNOTS, **ends)
    best = least(paths, jnp.asarray(start), approach_time)
    np.testing.assert_array_equal(began.ok, best.ok)
    ratio = total(began.q) / np.asarray(best.energy + best.approach_energy)[good]
    assert (ratio < 1.01).sum() >= 8
    assert ratio.max() < 1.6  # another basin
    assert (total(began.q) < 1.001 * total(motion.q)).all()


class Shift(eqx.Module):
    """A correction that adds to the proposed swivels."""

    by: jax.Array

    def corrected(self, batch, candidate):
        assert len(batch.time) == KNOTS
        return candidate.proposal + self.by


@pytest.mark.slow
def test_a_correction_is_kept_where_it_lowers_the_energy(paths, motion):
    plan = lambda **options: jaxik.plan_batch(ARM, paths.target, paths.time, knots=KNOTS, **options)  # noqa: E731
    none, worse = Shift(jnp.float32(0.0)), Shift(jnp.float32(0.4))
    with hardly_optimized():
        kept = plan(correct=none.corrected)
        refused = plan(correct=worse.corrected)
    for same in (kept, refused):
        np.testing.assert_allclose(same.swivel, motion.swivel, atol=1e-4)
    # A correction is kept unjudged where the energy is not joint motion alone.
    with hardly_optimized():
        taken = plan(correct=worse.corrected, by_motion=False)
    np.testing.assert_array_equal(taken.feasible, motion.feasible)
    good = np.flatnonzero(motion.ok)
    ratio = energies(taken.q, paths.time)[good] / energies(motion.q, paths.time)[good]
    assert np.median(ratio) > 1.02
    smooth = plan(correct=worse.corrected, energy=jaxik.energy.joint_motion() + jaxik.energy.smoothness())
    np.testing.assert_array_equal(smooth.swivel, taken.swivel)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda p: {"time": p.time[:, :3]}, r"expected time \(\*batch, K\).*got \(12, 3\), positions \(12, 40, 3\)"),
        (lambda p: {"time": p.time[0]}, r"expected time \(\*batch, K\).*got \(40,\), positions \(12, 40, 3\)"),
        (lambda p: {"time": 1.0}, r"expected time \(\*batch, K\).*got \(\)"),
        (lambda p: {"target": jaxik.Pose(p.target.position, p.target.rotation[0])}, r"and orientations with \(40,\)"),
        (lambda p: {"target": jaxik.Pose(p.target.position[..., :2], p.target.rotation)}, r"Pose.position of shape"),
        (lambda p: {"target": p.target.position}, "expected a jaxik.Pose"),
        (lambda p: {"target": p}, r"got a Path: pass its .target"),
        (lambda p: {"start": jnp.zeros(7)}, r"expected start of shape \(12, 7\); got \(7,\)"),
        (lambda p: {"start": jnp.zeros((12, 6))}, r"expected start of shape \(12, 7\); got \(12, 6\)"),
        (lambda p: {"start": jnp.zeros((12, 7)), "approach_time": jnp.ones(12)}, r"one approach_time.*\(12,\)"),
        (lambda p: {"candidates": 0}, "expected 1 to 16 candidates"),
        (lambda p: {"candidates": 17}, "expected 1 to 16 candidates"),
        (lambda p: {"knots": 0}, "at least one knot"),
        (lambda p: {"correct": lambda batch, candidate: candidate.proposal[1:]}, r"swivels \(16, 8\); got \(15, 8\)"),
    ],
)
def test_wrong_shapes_are_refused(paths, without_type_checks, change, message):
    arguments = {"target": paths.target, "time": paths.time, "knots": KNOTS} | change(paths)
    with pytest.raises(ValueError, match=message):
        jaxik.plan_batch(ARM, arguments.pop("target"), arguments.pop("time"), **arguments)


def test_no_paths_have_no_motions(paths):
    none = jaxik.plan_batch(ARM, *jax.tree.map(lambda x: x[:0], (paths.target, paths.time)))
    assert (none.swivel.shape, none.branch.shape, none.q.shape, none.ok.shape) == ((0, 40), (0, 40), (0, 40, 7), (0,))
    assert none.raise_if_invalid() is none


@pytest.mark.slow
@pytest.mark.parametrize("waypoints", [1, 2])
def test_short_paths_start_near_the_posture_that_the_arm_comes_from(paths, waypoints):
    q = (
        0.3 * jnp.sin(jnp.arange(4.0)[:, None, None] + jnp.arange(7.0))
        + 0.02 * jnp.arange(waypoints * 1.0)[:, None]
        + 0.5
    )
    target = jaxik.forward_kinematics(ARM, q)
    time = jnp.broadcast_to(jnp.arange(waypoints * 1.0), (4, waypoints))
    with hardly_optimized():
        motion = jaxik.plan_batch(ARM, target, time, start=q[:, 0], approach_time=0.1).raise_if_invalid()
    np.testing.assert_allclose(motion.q[:, 0].astype(float), q[:, 0], atol=5e-3)
    reached = jaxik.forward_kinematics(ARM, motion.q.astype(float))
    np.testing.assert_allclose(reached.position, target.position, atol=1e-5)


@pytest.mark.slow
def test_pointing_targets_are_planned_with_the_last_joint_at_rest(paths):
    target = jaxik.Pointing(paths.target.position, paths.target.rotation[..., 2])
    motion = jaxik.plan_batch(ARM, target, paths.time, knots=KNOTS)
    served = np.asarray(jaxik.swivel_arcs(ARM, target).valid).any(-1).all(1).any(-1)
    np.testing.assert_array_equal(motion.ok, served)
    assert served.sum() >= 10
    target, motion = jax.tree.map(lambda x: x[np.flatnonzero(served)], (target, motion))
    np.testing.assert_array_equal(motion.q[..., 6], 0.0)
    reached = jaxik.forward_kinematics(ARM, motion.q.astype(float))
    np.testing.assert_allclose(reached.position, target.position, atol=1e-4)
    np.testing.assert_allclose(reached.rotation[..., 2], target.direction, atol=5e-4)
