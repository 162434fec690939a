"""The proof: what holds on cells, what steps cost at least, and that nothing found by other means costs less."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
from jaxik import energy as energies
from jaxik.planning import planner
from jaxik.planning.certificate import bound as bounds
from jaxik.planning.certificate import proof
from jaxik.planning.certificate.cells import Enclosure, cover, split
from jaxik.planning.certificate.quadratic import Parabola, Quadratic2
from jaxik.planning.certificate.static_cost import StaticCost
from jaxik.planning.certificate.steps import Joints, Links, all_links, least_costs
from jaxik.planning.check import check
from jaxik.planning.motion import from_guess, refine_best
from jaxik.planning.problem import make_problem
from jaxik.redundancy import self_motion
from tests.helpers.arms import random_arm
from tests.helpers.postures import quick
from tests.helpers.reachable import postures as reachable
from tests.helpers.reachable import target_of
from tests.helpers.rivals import finer_routes, random_starts, refiner

MODEL = jaxik.presets.iiwa14()
SELF_MOTION = jax.jit(self_motion)
ANGLES = jax.jit(lambda motion, branch, swivel: motion.branch(branch).angles(swivel))
ENERGIES = {
    "joint motion": energies.joint_motion(),
    "holding": energies.holding(),
    "both": energies.joint_motion(jnp.linspace(0.5, 2.0, 7) ** 2) + 1e-3 * energies.holding(),
}


@pytest.fixture(scope="module")
def wave():
    return jaxik.fit_path(MODEL.arm, jaxik.example_path("wave"))[::10]


@pytest.fixture(scope="module")
def proved(wave):
    return jaxik.plan(MODEL, wave)


def test_least_values_on_the_square_are_those_of_a_fine_sweep():
    bowl = Quadratic2(*np.random.default_rng(0).normal(size=(6, 400)))
    side = np.linspace(-1, 1, 201)
    u, w = side[:, None, None], side[None, :, None]
    b = bowl
    swept = (b.constant + b.a * u + b.b * w + b.aa * u * u + b.bb * w * w + 2 * b.ab * u * w).min(axis=(0, 1))
    least = b.minimum()
    assert (least <= swept + 1e-12).all()
    assert (least >= swept - 5e-4).all()
    line = Parabola(*bowl[:3])
    swept = (line.value + line.slope * side[:, None] + line.curve * side[:, None] ** 2).min(axis=0)
    np.testing.assert_allclose(line.minimum(), swept, atol=5e-4)


def near_singular_arm(seed):
    """Targets whose shoulder or wrist can be within 1e-6 to 0.1 rad of alignment."""
    arm, rng = random_arm(seed, 7, keep_out=1), np.random.default_rng(seed)
    q = reachable(arm, 24, seed=seed)
    q[::2, 1] = 10.0 ** rng.uniform(-6, -1, 12)
    q[::3, 5] = 10.0 ** rng.uniform(-6, -1, 8)
    return arm, target_of(arm, q)


@pytest.mark.parametrize("seed", [0, 1])
def test_joints_stay_within_what_a_cell_says(seed):
    arm, target = near_singular_arm(seed)
    motion = SELF_MOTION(arm, target)
    cells = cover(Enclosure(motion), jaxik.swivel_arcs(arm, target), 0.3)
    assert cells.error[np.isfinite(cells.error)].max() > 1e-4
    known = np.isfinite(cells.error)
    assert known.mean() > 0.99
    at = motion.at(cells.layer)
    for u in np.linspace(-1, 1, 11):
        q = np.asarray(ANGLES(at, jnp.asarray(cells.branch), jnp.asarray(cells.middle + u * cells.half)))
        off = q - cells.center - u * cells.slope
        off -= 2 * np.pi * np.round(off / (2 * np.pi))
        assert (np.abs(off) <= cells.error + 1e-12)[known].all()


def test_a_cover_misses_no_feasible_swivel_and_halves_make_the_whole(wave):
    arcs = jaxik.swivel_arcs(MODEL.arm, wave.target)
    enclose = Enclosure(SELF_MOTION(MODEL.arm, wave.target))
    cells = cover(enclose, arcs, 0.3)
    length = np.zeros((len(wave), 8))
    np.add.at(length, (cells.layer, cells.branch), 2 * cells.half)
    np.testing.assert_allclose(length, np.where(arcs.valid, arcs.end - arcs.start, 0.0).sum(-1), atol=1e-9)
    halves = split(enclose, cells)
    np.testing.assert_allclose(halves.half[::2] + halves.half[1::2], cells.half)
    np.testing.assert_allclose(halves.middle[::2] + halves.middle[1::2], 2 * cells.middle)


def test_no_step_between_two_cells_costs_less_or_is_left_out(wave):
    """Random postures of random cells, and steps as small as motions make them."""
    arm, rng = MODEL.arm, np.random.default_rng(0)
    motion = SELF_MOTION(arm, wave.target)
    cells = cover(Enclosure(motion), jaxik.swivel_arcs(arm, wave.target), 0.3)
    weight = np.linspace(0.5, 2.0, 7)
    joints = Joints(weight, np.asarray(arm.velocity_limit), np.zeros(7, bool))
    first, second = (np.flatnonzero(cells.layer == k) for k in (4, 5))
    dt = float(wave.time[5] - wave.time[4])
    links = all_links(joints, cells, cells.radius, first, second, dt)
    everything = Links(np.repeat(first, len(second)), np.tile(second, len(first)))
    u, w = rng.uniform(-1, 1, (2, len(everything.a)))

    def angles(index, place):
        swivel = jnp.asarray(cells.middle[index] + place * cells.half[index])
        return np.asarray(ANGLES(motion.at(cells.layer[index]), jnp.asarray(cells.branch[index]), swivel))

    step = angles(everything.b, w) - angles(everything.a, u)
    slow = (np.abs(step) <= joints.speed[:, None] * dt).all(axis=0)
    kept = set(zip(links.a.tolist(), links.b.tolist(), strict=True))
    assert all(pair in kept for pair in zip(everything.a[slow].tolist(), everything.b[slow].tolist(), strict=True))
    assert len(kept) < 0.2 * len(slow)
    bowl = least_costs(joints, cells, everything, dt)
    least = bowl.constant + bowl.a * u + bowl.b * w + bowl.aa * u * u + bowl.bb * w * w + 2 * bowl.ab * u * w
    true = weight @ step**2 / dt
    assert (least <= true + 1e-9).all()
    assert np.median((true - least)[slow] / true[slow]) < 0.2


def test_a_proof_needs_the_waypoints_where_the_motion_bends():
    """A cube's edges in 200 waypoints: at even steps a proof of one percent took all of them, and 34 s."""
    rng = np.random.default_rng(0)
    time = np.cumsum(rng.uniform(0.5, 1.5, 200))
    corners = np.array([0, 30, 55, 90, 120, 150, 199])
    speed = rng.normal(size=(len(corners) - 1, 7))
    edges = np.repeat(np.arange(len(corners) - 1), np.diff(corners))
    q = np.concatenate([np.zeros((1, 7)), np.cumsum(speed[edges] * np.diff(time)[:, None], axis=0)])
    weight = np.linspace(0.5, 2.0, 7)
    np.testing.assert_array_equal(proof._index(q, time, weight, 1e-9), corners)
    bent = q + 0.02 * np.sin(np.arange(200))[:, None]

    def cost(index):
        return (np.diff(bent[index], axis=0) ** 2 @ weight / np.diff(time[index])).sum()

    every = np.arange(200)
    for loss in (0.5, 0.05, 0.0):
        few = proof._index(bent, time, weight, loss * cost(every))
        assert few[0] == 0
        assert few[-1] == 199
        assert (np.diff(few) > 0).all()
        assert cost(every) * (1 - loss) <= cost(few) * (1 + 1e-12)


def test_a_plan_is_proved_to_a_percent(proved):
    assert proved.ok
    assert 0 < proved.lower_bound <= proved.energy
    assert proved.gap <= 0.01
    np.testing.assert_allclose(proved.gap, 1 - proved.lower_bound / proved.energy)
    assert f"no motion costs less than {proved.lower_bound:.6g}" in proved.report()
    assert "proof" in proved.seconds


@pytest.mark.slow
def test_no_random_restart_comes_below_the_bound(proved, wave):
    """2000 refinements from swivels that drift at random, in every branch."""
    problem, rng = make_problem(MODEL.arm, wave.target, wave.time), np.random.default_rng(0)
    drift = np.cumsum(rng.normal(scale=0.3, size=(2000, len(wave))), axis=1)
    swivel = jnp.asarray(rng.uniform(-np.pi, np.pi, (2000, 1)) + drift)
    branch = jnp.asarray(np.arange(2000) % 8)

    def energy(swivel, branch):
        guess = from_guess(problem, swivel, branch)
        motion = refine_best(problem, guess._replace(swivel=guess.swivel[:1], branch=guess.branch[:1]))
        speed = jnp.abs(jnp.diff(motion.q, axis=0)) / jnp.diff(wave.time)[:, None]
        slow = jnp.all(speed <= MODEL.arm.velocity_limit * (1 + 1e-9))
        return jnp.where(slow & jnp.isfinite(motion.energy), motion.energy, jnp.inf)

    energies = np.asarray(
        jax.jit(lambda s, b: jax.lax.map(lambda x: energy(*x), (s, b), batch_size=100))(swivel, branch)
    )
    assert np.isfinite(energies).sum() > 200
    assert np.nanmin(energies) >= proved.lower_bound
    assert proved.energy <= np.nanmin(energies) * (1 + 1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arm", "name", "every"),
    [
        (jaxik.presets.iiwa14().arm, "figure-eight", 1),  # several minima within a hundredth of each other
        (jaxik.presets.iiwa7().arm, "figure-eight", 2),  # its local minima are mirrored in all branches
        (jaxik.presets.meccanoid("left").arm, "reach", 1),  # the best one passes a singular posture between waypoints
    ],
    ids=["iiwa14", "iiwa7", "meccanoid"],
)
def test_no_rival_is_better(arm, name, every):
    """2000 random smooth restarts and a grid 20 times finer than the search's: none lower by more than 0.1 %."""
    path = jaxik.fit_path(arm, jaxik.example_path(name))[::every]
    plan = jaxik.plan(arm, path).raise_if_invalid()
    refined, starts = refiner(arm, path), random_starts(arm, path, 2000)
    restarts = np.concatenate([refined(*(x[i : i + 250] for x in starts)) for i in range(0, 2000, 250)])
    finer = refined(*finer_routes(arm, path, 32))
    assert np.isfinite(restarts).sum() > 500
    best = min(restarts.min(), finer.min())
    assert plan.lower_bound <= best
    assert plan.energy <= 1.001 * best
    assert plan.gap <= 0.01


def test_the_proof_comes_upon_a_better_motion_than_the_search(proved, wave, monkeypatch):
    """A search that ends in the worst minimum it can follow: the plan is the best one all the same."""

    def worst(problem, index):
        held = [jnp.full(len(problem.time), 0.5 * k) for k in range(12)]
        starts = [from_guess(problem, swivel, b) for swivel in held for b in range(8)]
        motions = [refine_best(problem, start) for start in starts]
        checks = [check(MODEL.arm, wave, np.asarray(motion.q)[: len(wave)]) for motion in motions]
        kept = [each.status == jaxik.PlanStatus.OK for each in checks]
        costs = [float(motion.energy) if ok else -1.0 for motion, ok in zip(motions, kept, strict=True)]
        assert max(costs) > 1.01 * proved.energy
        return starts[int(np.argmax(costs))]

    monkeypatch.setattr(planner, "search_at", worst)
    again = jaxik.plan(MODEL, wave, gap=0.003).raise_if_invalid()
    np.testing.assert_allclose(again.energy, proved.energy, rtol=3e-3)
    assert again.gap <= 0.003


@pytest.fixture(scope="module")
def lattice(wave):
    """Postures at 360 swivels, ``(waypoint, swivel, branch, joint)``, and which are allowed."""
    swivel = np.linspace(-np.pi, np.pi, 360, endpoint=False)
    rows = jax.tree.map(lambda x: jnp.repeat(x, 360, axis=0), wave.target)
    solution = jaxik.solve_ik(MODEL.arm, rows, jnp.asarray(np.tile(swivel, len(wave))))
    return tuple(np.asarray(x).reshape(len(wave), 360, 8, -1) for x in (solution.q, solution.ok))


@pytest.mark.parametrize("name", quick("joint motion", slow=["holding", "both"]))
def test_no_motion_on_a_fine_lattice_comes_below_the_bound(name, wave, lattice):
    """The best of all motions over 360 swivels, in each branch; its refinement would come closer still."""
    energy = ENERGIES[name]
    plan = jaxik.plan(MODEL, wave, energy=energy)
    q, ok = lattice
    rest = np.asarray(energy.rest_rate(MODEL.arm, jnp.asarray(q)) * energies.node_weights(wave.time)[:, None, None])
    weight = np.asarray(energy.motion_weights(MODEL.arm))
    best = np.inf
    for branch in range(8):
        value = np.where(ok[0, :, branch, 0], rest[0, :, branch], np.inf)
        for k in range(1, len(wave)):
            step = q[k, :, None, branch] - q[k - 1, None, :, branch]
            dt = float(wave.time[k] - wave.time[k - 1])
            slow = (np.abs(step) <= np.asarray(MODEL.arm.velocity_limit) * dt).all(-1)
            cost = np.where(slow & ok[k, :, None, branch, 0], step**2 @ weight / dt, np.inf)
            value = (cost + value).min(axis=1) + rest[k, :, branch]
        best = min(best, value.min())
    assert plan.gap <= 0.01
    assert plan.lower_bound <= plan.energy <= best
    assert best < 1.1 * plan.energy


def test_no_posture_of_a_cell_costs_less_than_it_says(wave):
    energy = energies.holding()
    motion = SELF_MOTION(MODEL.arm, wave.target)
    cells = cover(Enclosure(motion), jaxik.swivel_arcs(MODEL.arm, wave.target), 0.3)
    seconds = np.asarray(energies.node_weights(wave.time))
    below = StaticCost(MODEL.arm, energy, seconds)(cells)
    at = motion.at(cells.layer)
    for u in np.linspace(-1, 1, 7):
        q = ANGLES(at, jnp.asarray(cells.branch), jnp.asarray(cells.middle + u * cells.half)).T
        true = np.asarray(energy.rest_rate(MODEL.arm, q)) * seconds[cells.layer]
        least = below.value + below.slope * u + below.curve * u * u
        assert (least <= true).all()
        assert np.median((true - least) / true) < 0.3


@pytest.mark.slow
def test_start_and_end_postures_are_part_of_what_is_proved(proved, wave):
    q = proved.trajectory.q
    held = jaxik.plan(MODEL, wave, start=q[0], end=q[-1])
    np.testing.assert_allclose(held.energy, proved.energy, rtol=1e-6)
    np.testing.assert_allclose(held.trajectory.q[[0, -1]], q[[0, -1]], atol=1e-7)
    assert held.approach_energy == pytest.approx(0.0, abs=1e-9)
    assert held.gap <= 0.01
    beside = jaxik.plan(MODEL, wave, start=q[0] + 0.2, end=q[-1] - 0.1)
    assert beside.approach_energy > 0
    assert beside.gap <= 0.01
    assert proved.lower_bound < beside.energy
    assert proved.energy + 0.05 * 7 * 1.0 > beside.energy + beside.approach_energy > proved.energy


@pytest.mark.slow
def test_bounds_hold_in_single_precision(proved, wave):
    single = jaxik.plan(replace(MODEL, arm=MODEL.arm.astype(jnp.float32)), wave)
    assert single.gap <= 0.01
    np.testing.assert_allclose(single.energy, proved.energy, rtol=1e-3)
    assert single.lower_bound <= proved.energy


def test_out_of_room_a_proof_ends_with_what_it_has(wave, monkeypatch):
    monkeypatch.setattr(bounds, "_MOST_LINKS", 20_000)
    plan = jaxik.plan(MODEL, wave, gap=1e-3)
    assert plan.ok
    assert 0 <= plan.lower_bound <= plan.energy
    assert plan.gap > 1e-3


def test_energies_without_a_proof_say_so():
    """What a plan for one then claims is tested where such a plan is made, in test_plan."""
    both = energies.joint_motion() + energies.holding()
    assert both.provable(MODEL.arm)
    for other in (energies.smoothness(), energies.servo(), -1.0 * energies.holding()):
        assert not (both + other).provable(MODEL.arm)


@pytest.mark.parametrize("gap", [0.0, 1.0, -0.1, float("nan")])
def test_a_gap_that_is_no_share_is_refused(wave, gap):
    with pytest.raises(ValueError, match="between 0 and 1, or None for no proof"):
        jaxik.plan(MODEL, wave, gap=gap)
