"""Plans: they reach, keep every limit, cost what they say, and are found again from any reading of the path."""

import re
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
from jaxik.planning import planner, search_size, swivel_grid
from jaxik.planning.check import check
from jaxik.planning.motion import search_at
from jaxik.planning.result import listed

MODEL = jaxik.presets.iiwa14()


@pytest.fixture(scope="module")
def drawing():
    return jaxik.fit_path(MODEL.arm, jaxik.example_path("wave"))


@pytest.fixture(scope="module")
def wave(drawing):
    return drawing[::10]


@pytest.fixture(scope="module")
def planned(wave):
    return jaxik.plan(MODEL, wave)


def test_the_motion_reaches_every_waypoint(planned, wave):
    tool = jaxik.forward_kinematics(MODEL.arm, jnp.asarray(planned.trajectory.q))
    np.testing.assert_allclose(tool.position, wave.target.position, atol=1e-10)
    np.testing.assert_allclose(tool.rotation, wave.target.rotation, atol=1e-9)


def test_between_waypoints_the_tool_keeps_to_its_way(drawing):
    """Against forward kinematics at 20 places of every step; within a millimeter, and more on fewer waypoints."""
    worst = []
    for every in (1, 10):
        plan = jaxik.plan(MODEL, drawing[::every], gap=None).raise_if_invalid()
        time, corner = np.asarray(drawing[::every].time), np.asarray(drawing[::every].target.position)
        share = np.linspace(0, 1, 21)[:, None]
        q = plan.trajectory.sample(time[:-1] + share * np.diff(time))
        tool = np.asarray(jaxik.forward_kinematics(MODEL.arm, jnp.asarray(q)).position)
        dense = corner[:-1] + np.linspace(0, 1, 400)[:, None, None] * np.diff(corner, axis=0)
        far = np.linalg.norm(tool[:, None] - dense, axis=-1).min(axis=1).max(axis=0)
        np.testing.assert_allclose(plan.path_deviation(), far, rtol=0.05, atol=2e-4)
        assert f"{1e3 * plan.path_deviation().max():.2g} mm of path deviation" in plan.report()
        worst.append(plan.path_deviation().max())
    assert worst[0] < 1e-3 < worst[1]


def test_the_motion_keeps_limits_and_speeds(planned):
    q = planned.trajectory.q
    assert (q >= np.asarray(MODEL.arm.lower)).all()
    assert (q <= np.asarray(MODEL.arm.upper)).all()
    assert (np.abs(planned.trajectory.qd) <= np.asarray(MODEL.arm.velocity_limit)).all()


def test_the_plan_says_what_it_costs(planned, wave):
    q = planned.trajectory.q
    by_hand = (np.diff(q, axis=0) ** 2 / np.diff(wave.time)[:, None]).sum()
    np.testing.assert_allclose(planned.energy, by_hand, rtol=1e-12)
    assert planned.energy <= planned.energy_before_refinement * (1 + 1e-12)
    assert planned.reachable_prefix == len(wave)
    assert planned.status == jaxik.PlanStatus.OK
    assert planned.trajectory.joint_names == MODEL.joint_names
    assert f"{planned.energy:.6g} rad²/s" in planned.report()


def test_swivel_and_branch_give_the_motion_back(planned, wave):
    q = jaxik.solve_ik(MODEL.arm, wave.target, jnp.asarray(planned.swivel)).q
    np.testing.assert_allclose(q[np.arange(len(wave)), planned.branch], planned.trajectory.q, atol=1e-12)


def test_no_constant_swivel_in_any_branch_costs_less(planned, wave):
    grid = swivel_grid(MODEL.arm, wave.target, 48)
    energy = (np.diff(grid.q, axis=0) ** 2).sum(-1) / np.diff(wave.time)[:, None, None]
    held = np.where(grid.ok.all(axis=0), energy.sum(axis=0), np.inf)
    assert np.isfinite(held).any()
    assert planned.energy < held.min()


def test_a_refined_motion_is_a_minimum(planned, wave):
    """Smooth bumps on the swivel, of any place and size tried, cost energy."""
    time = np.linspace(0, 1, len(wave))
    rows = np.arange(len(wave))
    for center in (0.2, 0.5, 0.8):
        for size in (1e-2, -1e-2):
            bump = size * np.exp(-(((time - center) / 0.1) ** 2))
            q = jaxik.solve_ik(MODEL.arm, wave.target, jnp.asarray(planned.swivel + bump)).q[rows, planned.branch]
            assert jaxik.energy.joint_motion()(MODEL.arm, q, wave.time) > planned.energy


@pytest.mark.slow
@pytest.mark.parametrize("name", ["wave", "hello"])
def test_every_coarse_reading_of_the_path_leads_to_the_same_motion(name, drawing, data_dir, monkeypatch):
    """Searches of 32, 48 and 96 of 201 waypoints, without a proof that would repair them."""
    path = drawing
    if name == "hello":
        path = jaxik.fit_path(MODEL.arm, jaxik.load_path(data_dir / "paths" / "hello.csv"))
        index = np.linspace(0, len(path) - 1, len(drawing)).round().astype(int)
        path = jaxik.Path(jax.tree.map(lambda x: x[index], path.target), path.time[index])
    energies = []
    for count in (32, 48, 96):
        for limit in ("_FEWEST", "_MOST"):
            monkeypatch.setattr(search_size, limit, count)
        energies.append(jaxik.plan(MODEL, path, gap=None).raise_if_invalid().energy)
    np.testing.assert_allclose(energies, energies[0], rtol=1e-5)


@pytest.mark.slow
def test_smoothness_is_weighed_in(planned, wave):
    energy = jaxik.energy.joint_motion() + 0.5 * jaxik.energy.smoothness()
    smooth = jaxik.plan(MODEL, wave, energy=energy).raise_if_invalid()
    jerky = float(energy(MODEL.arm, jnp.asarray(planned.trajectory.q), wave.time))
    assert smooth.energy < jerky
    assert smooth.energy_name == "joint motion + 0.5 smoothness"
    assert smooth.lower_bound is smooth.gap is None  # no proof of second differences
    assert "lower bound: none" in smooth.report()


def test_a_guess_takes_the_place_of_the_search(planned, wave, monkeypatch):
    first = planned.branch[0]
    assert (planned.branch == first).all()
    searches = []
    counted = lambda *a: searches.append(a) or search_at(*a)  # noqa: E731
    monkeypatch.setattr(planner, "search_at", counted)
    off = 0.1 * np.sin(np.arange(len(wave)))
    again = jaxik.plan(MODEL, wave, guess=(planned.swivel + off, first), gap=None)
    assert again.energy == pytest.approx(planned.energy, rel=1e-9)
    assert not searches
    # One that is none is followed by a search.
    again = jaxik.plan(MODEL, wave, guess=(np.full(len(wave), np.nan), first), gap=None)
    assert len(searches) == 1
    assert again.energy == pytest.approx(jaxik.plan(MODEL, wave, gap=None).energy, rel=1e-12)


def test_a_start_at_the_first_target_is_kept(wave):
    first = jax.tree.map(lambda x: x[0], wave.target)
    arcs = jaxik.swivel_arcs(MODEL.arm, first)
    branch = int(np.argmax(np.asarray(arcs.width)))
    swivel = arcs.start[branch, 0] + 0.3 * (arcs.end[branch, 0] - arcs.start[branch, 0])
    q0 = jaxik.solve_ik(MODEL.arm, first, swivel).q[branch]
    planned = jaxik.plan(MODEL, wave, start=q0, gap=None).raise_if_invalid()
    np.testing.assert_allclose(planned.trajectory.q[0], q0, atol=1e-9)


def test_a_start_on_a_limit_to_rounding_is_on_the_limit(wave):
    """As printed with six decimals, or kept in single precision."""
    start = np.zeros(7)
    start[[1, 3]] = MODEL.arm.upper[1], MODEL.arm.lower[3]
    for rounded in (np.round(start, 6), start.astype(np.float32), start * (1 + 1e-9)):
        at = planner.checked_inputs(MODEL.arm, wave, jaxik.energy.joint_motion(), start=rounded).ends["start"]
        assert (at >= MODEL.arm.lower).all()
        assert (at <= MODEL.arm.upper).all()
        np.testing.assert_allclose(at, start, atol=1e-6)


@pytest.mark.slow
def test_a_start_elsewhere_draws_the_first_posture_near(wave):
    first = jax.tree.map(lambda x: x[:1], wave.target)
    grid = swivel_grid(MODEL.arm, first, 128)
    start = jnp.asarray(np.clip(grid.q[0, 40, 3], np.asarray(MODEL.arm.lower), np.asarray(MODEL.arm.upper))) + 0.05
    nearest = np.linalg.norm(grid.q[0] - start, axis=-1)[grid.ok[0]].min()
    planned = jaxik.plan(MODEL, wave, start=start, approach_time=1e-4, gap=None).raise_if_invalid()
    assert np.linalg.norm(planned.trajectory.q[0] - np.asarray(start)) < nearest + 0.5


def test_passages_narrower_than_the_search_grid_are_found(planned, wave):
    """Limits drawn around a known motion leave arcs of a fraction of a grid cell: the motion is found all the same."""
    q = planned.trajectory.q
    tight = replace(MODEL.arm, lower=jnp.asarray(q.min(0) - 2e-3), upper=jnp.asarray(q.max(0) + 2e-3))
    width = np.asarray(jaxik.swivel_arcs(tight, wave.target).width)[:, planned.branch[0]]
    assert width.min() < 2 * np.pi / 256
    again = jaxik.plan(tight, wave, gap=None).raise_if_invalid()
    np.testing.assert_allclose(again.energy, planned.energy, rtol=1e-4)


def test_waypoints_out_of_reach_are_named_with_their_times(wave):
    position = wave.target.position.at[7:10].add(jnp.array([3.0, 0.0, 0.0]))
    path = jaxik.Path(jaxik.Pose(position, wave.target.rotation), wave.time)
    plan = jaxik.plan(MODEL, path)
    assert plan.status == jaxik.PlanStatus.UNREACHABLE
    assert plan.trajectory is None
    assert np.isinf(plan.energy)
    assert "at waypoint 7 to 9 (2.800 s to 3.600 s) of 21: " in plan.report()
    assert "mm out of reach" in plan.report()
    assert plan.reachable_prefix == 7
    assert jaxik.plan(MODEL, path[: plan.reachable_prefix], gap=None).ok
    with pytest.raises(jaxik.UnreachableError, match=r"waypoint"):
        plan.raise_if_invalid()


def test_waypoints_are_listed_in_runs():
    assert listed(np.array([1, 5, 6, 7]), 0.5 * np.arange(9)) == "1 (0.500 s), 5 to 7 (2.500 s to 3.500 s)"
    assert listed(np.arange(0, 16, 2), np.arange(16.0)).endswith("10 (10.000 s) and 2 more places")


@pytest.mark.parametrize("faster", [5, 50])
def test_too_little_time_is_said_with_the_time_that_would_do(wave, faster):
    """Speeds are named as the reason, whether the search finds a motion that is too fast or none at all."""
    path = jaxik.Path(wave.target, wave.time / faster)
    plan = jaxik.plan(MODEL, path, gap=None)
    assert plan.status == jaxik.PlanStatus.TOO_FAST
    assert plan.trajectory is None
    joint, times, a, b, needed, given = re.search(
        r"joint (\d) would need ([\d.]+) times its speed limit between waypoints (\d+) .* and (\d+) .*: at least "
        r"([\d.]+) s in the place of ([\d.]+) s",
        plan.problems[0],
    ).groups()
    assert int(b) == int(a) + 1
    step = float(path.time[int(b)] - path.time[int(a)])
    np.testing.assert_allclose([float(given), float(needed)], [step, float(times) * step], rtol=0.01)
    factor = float(re.match(r"([\d.]+) times slower it can be planned", plan.problems[1]).group(1))
    slow = jaxik.plan(MODEL, jaxik.Path(path.target, factor * path.time), gap=None)
    assert slow.ok
    used = np.abs(np.diff(slow.trajectory.q[:, int(joint) - 1]))[int(a)] / float(
        MODEL.arm.velocity_limit[int(joint) - 1]
    )
    np.testing.assert_allclose(used, float(needed), rtol=0.02)
    assert not jaxik.plan(MODEL, jaxik.Path(path.target, 0.7 * factor * path.time), gap=None).ok


def around_the_base(wave, first, last):
    """The wave's first target carried around the axis of joint 1."""
    turn = jnp.linspace(first, last, len(wave))
    spin = jnp.zeros((len(wave), 3, 3)).at[:, 2, 2].set(1.0)
    spin = spin.at[:, 0, 0].set(jnp.cos(turn)).at[:, 1, 1].set(jnp.cos(turn))
    spin = spin.at[:, 0, 1].set(-jnp.sin(turn)).at[:, 1, 0].set(jnp.sin(turn))
    return jaxik.Path(jaxik.Pose(spin @ wave.target.position[0], spin @ wave.target.rotation[0]), wave.time)


def test_limits_that_cut_a_path_are_named_and_a_prefix_that_plans(wave):
    """Behind its back joint 1 has a gap that joint 3 closes from either side, and does not lead across."""
    limits = np.array([np.pi - 0.05, 2.0, 0.3, 2.0, 2.9, 2.0, 2.9])
    narrow = replace(MODEL.arm, lower=jnp.asarray(-limits).at[1].set(0.1), upper=jnp.asarray(limits))
    path = around_the_base(wave, np.pi - 1.0, np.pi + 1.0)
    plan = jaxik.plan(narrow, path, gap=None)
    assert plan.status == jaxik.PlanStatus.DISCONNECTED
    assert re.match(r"joint \d would have to jump by \d+° between waypoints \d+ .*, however slow", plan.problems[0])
    assert "without the limits of joint 1" in plan.problems[1]
    assert 2 < plan.reachable_prefix < len(wave)
    assert jaxik.plan(narrow, path[: plan.reachable_prefix], gap=None).ok


def test_a_pose_path_for_six_joints_says_what_to_do(wave):
    with pytest.raises(ValueError, match=r"takes pointing targets; jaxik.fit_path"):
        jaxik.plan(jaxik.presets.meccanoid("right"), wave)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"start": jnp.zeros(6)}, "one finite angle per joint"),
        ({"start": jnp.full(7, jnp.nan)}, "one finite angle per joint"),
        (
            {"start": jnp.array([0.0, 0, 0, 2.2, 0, 0, 0])},
            r"start has joint 4 at 2.2 rad, and its range is -2.094\d* to",
        ),
        (
            {"end": jnp.array([45.0, 0, 0, -90, 0, 90, 0])},
            r"end has joint 4 at -90 rad.*looks like degrees: give np.rad",
        ),
        ({"start": jnp.array([7.2, 0, 0, -31, 0, 9, 0])}, r"joint 4 at -31 rad.*if these are degrees, give np.radians"),
        ({"end": jnp.zeros(8)}, "end needs one finite angle per joint"),
        ({"guess": (jnp.zeros(3), 0)}, "guess needs swivels"),
        ({"start": jnp.zeros(7), "approach_time": 0.0}, "approach_time needs to be above 0"),
    ],
)
def test_bad_options_are_refused(wave, options, said):
    with pytest.raises(ValueError, match=said):
        jaxik.plan(MODEL, wave, **options)


def test_the_energy_map_is_the_local_cost_of_a_held_swivel(planned, wave):
    """Every cell against solve_ik and the energy's own definition of its terms; nan exactly where it is infeasible."""
    energy = 2.0 * jaxik.energy.joint_motion(jnp.arange(1.0, 8.0)) + 1e-3 * jaxik.energy.holding()
    costs = jaxik.energy_map(MODEL.arm, wave, planned.branch, energy=energy, waypoints=12, swivels=40)
    index = np.unique(np.linspace(0, len(wave) - 1, 12).round().astype(int))
    np.testing.assert_array_equal(costs.time, np.asarray(wave.time)[index])
    assert costs.cost.shape == (12, 40)
    assert costs.unit == "weighted sum per s"
    few = jax.tree.map(lambda x: x[index][:, None], wave.target)
    solution = jaxik.solve_ik(MODEL.arm, few, jnp.asarray(costs.swivel))
    branch = planned.branch[index][:, None, None]
    q = np.take_along_axis(np.asarray(solution.q), branch[..., None], axis=2)[:, :, 0]
    ok = np.take_along_axis(np.asarray(solution.ok), branch, axis=2)[..., 0]
    rate = (2.0 * np.arange(1.0, 8.0) * np.diff(q, axis=0) ** 2).sum(-1) / np.diff(costs.time)[:, None] ** 2
    moving = np.concatenate([rate[:1], (rate[1:] + rate[:-1]) / 2, rate[-1:]])
    holding = 1e-3 * (np.asarray(jaxik.gravity_torque(MODEL.arm, jnp.asarray(q))) ** 2).sum(-1)
    np.testing.assert_array_equal(np.isnan(costs.cost), ~ok)
    np.testing.assert_allclose(costs.cost[ok], (moving + holding)[ok], rtol=1e-9)


def test_the_number_of_searched_waypoints_follows_the_longest_path(drawing):
    travel = np.linalg.norm(np.diff(drawing.target.position, axis=0), axis=1).sum() / float(MODEL.arm.length)
    turns = np.einsum("kij,lij->kl", drawing.target.rotation, drawing.target.rotation)
    travel += np.arccos(np.clip((np.diagonal(turns, 1) - 1) / 2, -1, 1)).sum()
    wanted = np.clip(travel / 0.16, 24, 128)
    expected = min(n for n in (12, 24, 32, 48, 64, 96, 128, 256) if n >= wanted)
    assert jaxik.searched_waypoints(MODEL, drawing.target) == min(expected, len(drawing))
    both = jax.tree.map(lambda x: jnp.stack([x, x[:1].repeat(len(x), 0)]), drawing.target)
    assert jaxik.searched_waypoints(MODEL, both) == jaxik.searched_waypoints(MODEL, drawing.target)
    assert jaxik.searched_waypoints(MODEL, drawing[:5].target) == 5
    assert jaxik.searched_waypoints(MODEL, drawing.target, density=2.0) >= 2 * min(expected, 64)


def test_a_motion_off_its_targets_fails_the_check_and_says_so(planned, wave):
    q = np.array(planned.trajectory.q)
    q[4, 3] += 1e-3
    status, problems, keeps = check(MODEL.arm, wave, q)
    assert status == jaxik.PlanStatus.CHECK_FAILED
    assert keeps == 4
    assert problems == (f"off the target at waypoint 4 ({float(wave.time[4]):.3f} s)",)


def test_a_plan_is_retimed_within_limits_and_says_its_new_energy(planned):
    fast = planned.retimed(acceleration=5.0)
    time = jnp.asarray(fast.trajectory.time)
    assert fast.trajectory.duration < planned.trajectory.duration
    np.testing.assert_array_equal(fast.trajectory.q, planned.trajectory.q)
    assert (np.abs(fast.trajectory.qd) <= np.asarray(MODEL.arm.velocity_limit) * (1 + 1e-9)).all()
    np.testing.assert_allclose(
        fast.energy, jaxik.energy.joint_motion()(MODEL.arm, jnp.asarray(fast.trajectory.q), time), rtol=1e-12
    )
