"""Paths of any length share a few sizes of arrays; what fills them up changes nothing and costs nothing."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
from jaxik import energy as energies
from jaxik.planning.candidates import best_candidates
from jaxik.planning.motion import evenly_spaced
from jaxik.planning.padding import padded, padded_size
from jaxik.planning.problem import make_problem
from tests.helpers.postures import quick

MODEL = jaxik.presets.iiwa14()
FILLED = 9  # waypoints behind the last one
MOTIONS = {
    "joint motion": energies.joint_motion(),
    "smoothness": energies.smoothness(),
    "holding": energies.holding(),
    "servo": energies.servo(),
    "custom": energies.custom(lambda q, qd, qdd, dt: jnp.sum(jnp.abs(q * qd) + qdd**2) * dt + 1e-3 / dt),
}


@pytest.fixture(scope="module")
def wave():
    return jaxik.fit_path(MODEL.arm, jaxik.example_path("wave"))[::6]


def least(path, search, **options):
    """The motion of exactly these arrays."""
    return jaxik.least_energy_motion(MODEL.arm, path.target, path.time, search=search, **options)


def filled(path, count=FILLED):
    """The path with its last waypoint repeated."""
    return jaxik.Path(*jax.tree.map(jnp.asarray, padded((path.target, path.time), len(path) + count)))


def test_sizes_are_few_and_waste_little():
    sizes = {padded_size(n) for n in range(1, 2049)}
    assert len(sizes) == 11
    for n in range(1, 2049):
        assert n <= padded_size(n) <= max(32, 2 * n)
        assert padded_size(padded_size(n)) == padded_size(n)
    for n in range(129, 2049):
        assert padded_size(n) < 1.5 * n + 1


@pytest.mark.parametrize("number", [1, 2, 5, 12, 13])
def test_searched_waypoints_are_those_of_the_path_alone(number):
    for last in (0, 1, 5, 11, 12, 40):
        index = evenly_spaced(last, number)
        np.testing.assert_array_equal(index, jax.jit(evenly_spaced, static_argnums=1)(jnp.asarray(last), number))
        assert index[0] == 0
        assert len(index) == number
        assert number == 1 or index[-1] == last
        assert len(np.unique(index)) == min(number, last + 1)
        assert (np.diff(index) >= 0).all()


@pytest.mark.parametrize("count", [1, 2, 4])
def test_energies_see_no_waypoint_behind_the_last_one(count):
    rng = np.random.default_rng(count)
    q, time = jnp.asarray(rng.normal(size=(count, 7))), jnp.asarray(np.cumsum(rng.uniform(0.1, 1.0, count)))
    more = jnp.concatenate([q, jnp.asarray(rng.normal(size=(FILLED, 7)))])  # wherever the joints are
    times = jnp.concatenate([time, jnp.full(FILLED, time[-1])])
    for name, energy in MOTIONS.items():
        if count == 1 and name == "custom":
            continue  # it divides by the duration
        assert energy.paddable
        of = jax.value_and_grad(lambda q, t, e=energy: e(MODEL.arm, q, t), (0, 1))
        (value, (by_q, by_time)), (same, (by_more, by_times)) = of(q, time), of(more, times)
        np.testing.assert_allclose(same, value, rtol=1e-13)
        np.testing.assert_allclose(by_more[:count], by_q, rtol=1e-11, atol=1e-12)
        np.testing.assert_array_equal(by_more[count:], 0.0)
        np.testing.assert_allclose(by_times[: count - 1], by_time[: count - 1], rtol=1e-11, atol=1e-11)
        hessian = jax.jvp(jax.grad(lambda q, e=energy: e(MODEL.arm, q, times)), (more,), (jnp.ones_like(more),))[1]
        assert np.isfinite(hessian).all()


def test_a_repeated_time_within_a_path_is_no_end():
    time = jnp.asarray([0.0, 1.0, 1.0, 2.0, 2.0])
    np.testing.assert_array_equal(energies.counted(time), [True, True, True, True, False])
    np.testing.assert_array_equal(energies.durations(time), [1.0, 0.0, 1.0, np.inf])


@pytest.mark.parametrize("count", [2, 32, 33])
def test_a_plan_is_that_of_the_exact_length(count, wave):
    """At the sizes' borders too; the search sees the same waypoints."""
    path = wave[:count]
    plan = jaxik.plan(MODEL, path, gap=None).raise_if_invalid()
    exact = least(path, jaxik.searched_waypoints(MODEL.arm, path.target)).raise_if_invalid()
    np.testing.assert_allclose(plan.energy, exact.energy, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(*(np.abs(np.diff(q, axis=0)) for q in (plan.trajectory.q, exact.q)), atol=1e-7)
    assert len(plan.swivel) == len(plan.trajectory.q) == count


def test_candidates_stay_where_their_last_waypoint_is_refined_to(wave):
    """The search at all waypoints goes on from the swivels of the last of these arrays."""
    problem = make_problem(MODEL.arm, *jax.tree.map(jnp.asarray, padded((wave[:14].target, wave[:14].time), 23)))
    swivel = np.asarray(jax.jit(best_candidates)(problem).swivel)
    some = np.isfinite(swivel[:, 0])
    assert some.any()
    np.testing.assert_array_equal(swivel[some, 14:], np.repeat(swivel[some, 13:14], FILLED, axis=1))


@pytest.mark.parametrize("case", quick("closed", slow=["ends", "pinned", "closed, smooth"]))
def test_a_padded_motion_is_that_of_the_exact_length(case, wave):
    path, options = wave[:14], {}
    q = least(path, 14).q
    if case == "ends":
        options = {"start": q[0] + 0.1, "end": q[-1] - 0.1}
    elif case == "pinned":
        options = {"start": q[0], "pinned": True, "end": q[-1], "end_pinned": True}
    elif case.startswith("closed"):
        there = jax.tree.map(lambda x: jnp.concatenate([x[:7], x[:7][::-1]]), path.target)
        path, options = jaxik.Path(there, path.time), {"end": "start"}
    if case.endswith("smooth"):
        options["energy"] = energies.joint_motion() + 0.3 * energies.smoothness()
    exact, more = least(path, 14, **options), least(filled(path), 14, **options)
    assert exact.ok
    assert more.ok
    assert more.converged
    np.testing.assert_allclose(more.energy, exact.energy, rtol=1e-10)
    np.testing.assert_allclose(more.approach_energy, exact.approach_energy, rtol=1e-7, atol=1e-12)
    # Branches that mirror each other cost the same, and rounding decides between them: steps are of one size in both.
    np.testing.assert_allclose(*(np.abs(np.diff(m.q[:14], axis=0)) for m in (more, exact)), atol=1e-7)
    np.testing.assert_array_equal(more.q[14:], np.broadcast_to(more.q[13], (FILLED, 7)))


def test_derivatives_are_those_of_the_exact_length(wave):
    """In the targets, that of the last one summed over its repetitions."""
    path = wave[:14]

    def energy(position, path):
        target = jaxik.Pose(position, path.target.rotation)
        return jaxik.least_energy_motion(MODEL.arm, target, path.time, search=14).energy

    exact, more = (jax.jit(jax.grad(energy))(p.target.position, p) for p in (path, filled(path)))
    np.testing.assert_allclose(more[:13], exact[:13], rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(more[13:].sum(axis=0), exact[13], rtol=1e-7, atol=1e-9)


def test_paths_of_different_lengths_in_one_call(wave):
    lengths = (3, 14, 23)
    rows = [filled(wave[:n], 23 - n) for n in lengths]
    stacked = jax.tree.map(lambda *x: jnp.stack(x), *((path.target, path.time) for path in rows))
    many = jax.vmap(lambda target, time: jaxik.least_energy_motion(MODEL.arm, target, time, search=14))(*stacked)
    for i, n in enumerate(lengths):
        np.testing.assert_allclose(many.energy[i], least(wave[:n], min(14, n)).energy, rtol=1e-9, atol=1e-12)


def test_failures_speak_of_the_waypoints_of_the_path(wave):
    path = wave[:20]
    away = jaxik.Path(jaxik.Pose(path.target.position.at[15:17, 0].add(9.0), path.target.rotation), path.time)
    plan = jaxik.plan(MODEL, away, gap=None)
    assert plan.status == jaxik.PlanStatus.UNREACHABLE
    assert "at waypoint 15 to 16 (" in plan.problems[0]
    assert "of 20" in plan.problems[0]
    assert plan.reachable_prefix == 15
    assert len(plan.swivel) == 20
    fast = jaxik.plan(MODEL, jaxik.Path(path.target, path.time / 400), gap=None)
    assert fast.status == jaxik.PlanStatus.TOO_FAST
    first, last = map(int, re.search(r"between waypoints (\d+) \(.*?\) and (\d+) ", fast.problems[0]).groups())
    assert 0 <= first < last <= 19


def test_another_length_compiles_nothing(wave):
    compiled = []
    listen = lambda event, *_, **__: compiled.append(event)  # noqa: E731
    jax.monitoring.register_event_duration_secs_listener(listen)
    counts = []
    for path in [wave[:n] for n in (25, 26, 31)]:
        compiled.clear()
        plan = jaxik.plan(MODEL, path)
        assert plan.ok
        assert plan.report()
        counts.append(sum("backend_compile" in event for event in compiled))
    assert counts[1:] == [0, 0]
    jax.jit(lambda x: x + len(counts))(jnp.ones(3))  # the listener hears of programs
    assert any("backend_compile" in event for event in compiled)
    jax.monitoring.unregister_event_duration_listener(listen)
