"""Aligned shoulders and wrists, where people begin: the whole family of splits is feasible, and every call agrees."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
from jaxik import Status
from tests.helpers.arms import ALL_PRESETS, random_arm
from tests.helpers.postures import quick
from tests.helpers.reachable import aligned_postures, target_of

COUNT = 500
KINDS = [(joints, straight) for joints in ((1,), (5,), (1, 5)) for straight in (False, True)]

HOMES = [(45, 0, 0, -90, 0, 90, 0), (20, 40, 10, -80, 30, 0, 15)]


def arm_named(name):
    return ALL_PRESETS[name]().arm if isinstance(name, str) else random_arm(name, 6 + name % 2, limits=False)


def test_a_home_posture_stays_where_it_is():
    arm = jaxik.presets.iiwa7().arm
    q = np.radians([45.0, 0, 0, -90, 0, 90, 0])
    found = jaxik.solve_nearest(arm, jaxik.forward_kinematics(arm, q), q)
    np.testing.assert_allclose(found.q, q, atol=1e-12)
    assert found.status == Status.NEAR_SINGULAR
    left = jaxik.presets.meccanoid("left").arm
    q = np.radians([30.0, 90, 10, 40, 0, 0])
    found = jaxik.solve_nearest(left, target_of(left, q), q)
    np.testing.assert_allclose(found.q, q, atol=1e-12)
    assert bool(found.ok)


def test_an_elbow_on_the_border_of_its_keep_out_may_be_nearly_straight():
    """Axis 1 of the paper's arm lies in the border, and the target gives the bend to eps / bend only."""
    arm = jaxik.presets.paper_arm().arm
    for q in (
        [1.4227246914237126, 0.0, 0.80363617738244686, 0.0047388558101731926, 0.60534549812505922, 0.22642188682236841],
        [-0.21451109213807973, 0.0, 2.9076957211095986, 0.0050797514238289931, 0.134345072060997, -0.8793181680486154],
        [-1.283684316535443, 0.0, 0.10250590751965283, 0.00055606499009441812, 1.506833326134955, -1.345600132103959],
    ):
        found = jaxik.solve_nearest(arm, target_of(arm, np.array(q)), np.array(q))
        assert bool(found.ok)
        assert float(found.motion) <= 1e-9


@pytest.mark.parametrize("name", quick("iiwa7", slow=["iiwa14", "meccanoid_left", "meccanoid_right", "paper_arm"]))
def test_aligned_postures_of_presets_stay_where_they_are(name):
    check_stays(arm_named(name), COUNT)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_aligned_postures_of_random_arms_stay_where_they_are(seed):
    check_stays(arm_named(seed), COUNT)


def check_stays(arm, count):
    for joints, straight in KINDS:
        q = aligned_postures(arm, joints, straight, count)
        if not len(q):  # the limits leave no such posture
            continue
        target = target_of(arm, q)
        found = jaxik.solve_nearest(arm, target, q)
        assert np.max(found.motion) <= 1e-9, (joints, straight)
        assert np.all(found.ok), (joints, straight)
        assert np.all((found.q >= arm.lower) & (found.q <= arm.upper))
        reached = jaxik.forward_kinematics(arm, found.q)
        assert np.abs(reached.position - target.position).max() <= 1e-11 * float(arm.length)


@pytest.mark.parametrize(("lower", "upper"), [(-np.inf, np.inf), (-np.inf, 1.0), (-1.0, np.inf), (-1.0, 1.0)])
def test_a_joint_without_an_end_takes_the_rest_of_the_turn(lower, upper):
    """Joint 1 cannot be at 0, where the split of the solver's own would put it."""
    arm = jaxik.presets.iiwa7().arm
    arm = dataclasses.replace(
        arm, lower=arm.lower.at[0].set(0.2).at[2].set(lower), upper=arm.upper.at[0].set(0.9).at[2].set(upper)
    )
    q = aligned_postures(arm, (1,), False, 100)
    here = jaxik.swivel_of(arm, q)
    solution = jaxik.solve_ik(arm, target_of(arm, q), here.swivel)
    assert np.all(np.asarray(solution.ok)[np.arange(100), here.branch])
    assert np.max(np.where(solution.ok, solution.residual.position, 0.0)) < 1e-12


@pytest.mark.parametrize("joints", [(1,), (5,), (1, 5)])
def test_from_elsewhere_nothing_of_the_family_is_nearer(joints):
    """Every split on a grid, at the aligned swivel, against the answer."""
    arm = jaxik.presets.iiwa7().arm
    q = aligned_postures(arm, joints, False, 60)
    q_now = np.random.default_rng(1).uniform(arm.lower, arm.upper, q.shape)
    target = target_of(arm, q)
    found = jaxik.solve_nearest(arm, target, q_now)
    assert np.all(found.ok)
    reached = jaxik.forward_kinematics(arm, found.q)
    assert np.abs(reached.position - target.position).max() <= 1e-8 * float(arm.length)
    assert np.abs(reached.rotation - target.rotation).max() <= 1e-8
    turns = np.linspace(-np.pi, np.pi, 181)
    least = np.full(len(q), np.inf)
    for shoulder in turns if 1 in joints else [0.0]:
        for wrist in turns[::6] if joints == (1, 5) else turns if 5 in joints else [0.0]:
            other = q + np.array([shoulder, 0, -shoulder, 0, wrist, 0, -wrist])
            inside = np.all((other >= arm.lower) & (other <= arm.upper), axis=1)
            least = np.minimum(least, np.where(inside, np.sum((other - q_now) ** 2, axis=1), np.inf))
    assert np.all(np.asarray(found.motion) <= least + 1e-9)


@pytest.mark.parametrize(("joints", "straight"), KINDS)
def test_arcs_and_solutions_agree_that_an_aligned_posture_is_feasible(joints, straight):
    arm = jaxik.presets.iiwa7().arm
    q = aligned_postures(arm, joints, straight, 200)
    target, here = target_of(arm, q), jaxik.swivel_of(arm, q)
    rows = np.arange(len(q))
    solution = jaxik.solve_ik(arm, target, here.swivel)
    assert np.all(np.asarray(solution.ok)[rows, here.branch])
    arcs = jaxik.swivel_arcs(arm, target)
    off = here.swivel[:, None, None] - arcs.start
    off = off - 2 * np.pi * np.floor((off + 1e-9) / (2 * np.pi))
    inside = np.any(arcs.valid & (off <= arcs.end - arcs.start + 1e-9), axis=-1)
    assert np.all(inside[rows, here.branch])


def test_arcs_of_the_zero_posture_are_those_of_the_turns_left():
    """All four axes coincide: the sum of four angles is fixed, and narrow ranges bound the swivel from both sides."""
    arm = jaxik.presets.iiwa7().arm
    arm = dataclasses.replace(arm, lower=jnp.full(7, -0.3), upper=jnp.full(7, 0.3))
    target = jaxik.forward_kinematics(arm, jnp.zeros(7))
    arcs = jaxik.swivel_arcs(arm, target)
    here = float(jaxik.swivel_of(arm, jnp.zeros(7)).swivel)
    for swivel in here + np.linspace(-1, 1, 40):
        feasible = abs(swivel - here) <= 0.6 + 1e-9  # |q1 + q3| and |q5 + q7| are at most 0.6
        assert bool(arcs.contains(swivel)[0]) == feasible, swivel - here
        assert bool(jaxik.solve_ik(arm, target, swivel).ok[0]) == feasible, swivel - here


def test_derivatives_at_alignments_are_finite():
    arm = jaxik.presets.iiwa7().arm
    q = np.concatenate([aligned_postures(arm, *kind, 2) for kind in KINDS])
    target = target_of(arm, q)

    def f(position, now):
        return jaxik.solve_nearest(arm, jaxik.Pose(position, target.rotation), now).q.sum()

    for gradient in jax.grad(f, argnums=(0, 1))(target.position, jnp.asarray(q)):
        assert np.all(np.isfinite(gradient))


@pytest.mark.parametrize("end", ["start", "end"])
def test_plans_begin_and_end_at_a_home_posture(end):
    model = jaxik.presets.iiwa7()
    home = np.radians([45.0, 0, 0, -90, 0, 90, 0])
    away = home + np.linspace(0, 1, 40)[:, None] ** 2 * np.array([0.04, 0.1, 0.2, 0.03, -0.2, 0.1, 0.4])
    target = jaxik.forward_kinematics(model, away if end == "start" else away[::-1])
    plan = jaxik.plan(model, jaxik.Path(target, np.linspace(0, 4, 40)), gap=0.05, **{end: home})
    plan.raise_if_invalid()
    np.testing.assert_allclose(plan.trajectory.q[0 if end == "start" else -1], home, atol=1e-6)
    assert plan.gap <= 0.05
    known = np.sum(np.diff(away, axis=0) ** 2) / (4 / 39)
    assert plan.energy <= known * (1 + 1e-9)


@pytest.mark.parametrize("home", quick((45, 0, 0, -90, 0, 50, 0), slow=HOMES))
def test_plans_pass_a_waypoint_that_is_feasible_by_splits_alone(home):
    """Limits about the known motion leave its middle waypoint no other swivel than that of the alignment."""
    middle, joint = np.radians(home), 1 if home[1] == 0 else 5
    rates = np.array([0.05, 0.1, 0.1, 0.05, -0.05, 0.1, 0.1])
    rates[joint] = 0.2 if joint == 1 else 0.25
    known = middle + np.linspace(-1, 1, 41)[:, None] * rates
    arm = jaxik.presets.iiwa7().arm
    arm = dataclasses.replace(arm, lower=jnp.asarray(known.min(0) - 0.05), upper=jnp.asarray(known.max(0) + 0.05))
    target = jaxik.forward_kinematics(arm, known)
    arcs = jaxik.swivel_arcs(arm, target[20])
    assert np.ptp(np.asarray(arcs.start)[np.asarray(arcs.valid)]) <= 1e-9
    plan = jaxik.plan(arm, jaxik.Path(target, np.linspace(0, 4, 41)), gap=0.05)
    plan.raise_if_invalid()
    assert plan.energy <= np.sum(np.diff(known, axis=0) ** 2) / (4 / 40) * (1 + 1e-9)
    assert plan.gap <= 0.05
    assert np.abs(np.diff(plan.trajectory.q, axis=0)).max() <= 0.05  # no split of another motion


def test_a_plan_leaves_a_start_with_shoulder_and_wrist_aligned():
    arm = jaxik.presets.meccanoid("left").arm
    start = np.radians([30.0, 90, 10, 40, 0, 0])
    known = start + np.linspace(0, 1, 40)[:, None] * np.radians([10, -15, 5, 20, 10, 10.0])
    path = jaxik.Path(target_of(arm, known), np.linspace(0, 4, 40))
    plan = jaxik.plan(arm, path, start=start, gap=0.05)
    plan.raise_if_invalid()
    assert plan.energy <= np.sum(np.diff(known, axis=0) ** 2) / (4 / 39) * (1 + 1e-9)
    assert plan.gap <= 0.05
