"""Joint ranges of any place and width: the turn that lies in them, and feasible angles exactly within them."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
from jaxik.arm import fit_to_limits, presets, within_limits
from jaxik.numerics import tolerances, toward
from tests.helpers.arms import ALL_PRESETS
from tests.helpers.postures import quick, target_of

TURN = 2 * np.pi
RANGES = {
    "one turn": (-np.pi, np.pi),
    "more than a turn": (-6.28, 6.28),
    "beyond a turn": (10.0, 12.0),
    "far below": (-12 * np.pi, -8 * np.pi),
    "far above, wide": (41.0, 61.0),
    "one-sided": (7.0, np.inf),
    "one-sided, below": (-np.inf, -30.0),
    "narrow, far": (25.0, 25.1),
    "unlimited": (-np.inf, np.inf),
    "without width": (9.0, 9.0),
}


def of_range(lower, upper):
    """An arm whose joint 1 has this range."""
    arm = presets.iiwa7().arm
    return dataclasses.replace(arm, lower=arm.lower.at[0].set(lower), upper=arm.upper.at[0].set(upper))


def turns_by_hand(angle, lower, upper):
    """The fewest full turns that bring an angle into a range, None where there are none."""
    for k in sorted(range(-40, 41), key=abs):
        if lower <= angle + k * TURN <= upper:
            return k
    return None


@pytest.mark.parametrize(("lower", "upper"), RANGES.values(), ids=RANGES)
def test_the_turn_that_lies_in_a_range_is_found_wherever_it_is(lower, upper):
    rng = np.random.default_rng(0)
    inside = rng.uniform(max(lower, -60.0), min(upper, 60.0), 200)
    angles = np.concatenate([rng.uniform(-np.pi, np.pi, 200), inside - TURN * np.round(inside / TURN)])
    fitted = fit_to_limits(of_range(lower, upper), (0,), jnp.asarray(angles)[None])[0]
    ok = within_limits(of_range(lower, upper), (0,), fitted[None])[0]
    assert ok[200:].all()
    for angle, x, good in zip(angles[:200], fitted, ok, strict=False):
        k = turns_by_hand(angle, lower, upper)
        assert good == (k is not None)
        assert abs(float(x) - (angle + (k or 0) * TURN)) < 1e-13


def wrist_distance(arm, q):
    """Distance of the wrist from the shoulder."""
    points = np.asarray(jaxik.joint_positions(arm, q))
    return np.linalg.norm(points[..., 2, :] - points[..., 0, :], axis=-1)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_angles_on_their_limits_to_rounding_are_put_on_them(dtype):
    slack = 4096 * np.finfo(dtype).eps
    arm = of_range(-1.0, 2.0).astype(dtype)
    angles = jnp.asarray([-1 - 0.9 * slack, -1 - 1.1 * slack, -1, 2, 2 + 0.9 * slack, 2 + 1.1 * slack], dtype)[None]
    fitted, rate = jax.jvp(lambda x: fit_to_limits(arm, (0,), x), (angles,), (jnp.ones_like(angles),))
    assert fitted[0, jnp.array([0, 2, 3, 4])].tolist() == [-1, -1, 2, 2]
    assert fitted[0, jnp.array([1, 5])].tolist() == angles[0, jnp.array([1, 5])].tolist()
    assert within_limits(arm, (0,), fitted)[0].tolist() == [True, False, True, True, True, False]
    assert (rate == 1).all()


@pytest.mark.parametrize(("lower", "upper"), [v for k, v in RANGES.items() if k != "without width"])
def test_the_turn_nearest_to_a_reference_however_far_that_is(lower, upper):
    rng = np.random.default_rng(1)
    angle = rng.uniform(max(lower, -60.0), min(upper, 60.0), 300)
    reference = rng.uniform(-200, 200, 300)
    others = jnp.asarray(angle - TURN * rng.integers(-3, 4, 300)), jnp.asarray(reference)
    found = toward(*others, jnp.asarray(lower), jnp.asarray(upper))
    for x, a, r in zip(found, angle, reference, strict=True):
        turns = [a + k * TURN for k in range(-60, 61)]
        best = min((t for t in turns if lower <= t <= upper), key=lambda t: abs(t - r))
        assert abs(float(x) - best) < 1e-10


def test_an_angle_on_a_limit_to_rounding_stays_there_and_is_not_a_turn_away():
    for lower, upper in ((-np.pi, np.pi), (-10.0, 10.0)):
        angle = jnp.array([lower - 1e-13, upper + 1e-13])
        assert np.array_equal(toward(angle, 0.9 * angle, jnp.asarray(lower), jnp.asarray(upper)), angle)


def shifted(name):
    """A preset, targets of postures within its limits, and the same arm with every range shifted by full turns."""
    arm = ALL_PRESETS[name]().arm
    rng = np.random.default_rng(2)
    q = jnp.asarray(rng.uniform(arm.lower, arm.upper, (40, arm.n_joints)))
    shift = TURN * jnp.asarray(rng.integers(-6, 7, arm.n_joints), float)
    far = dataclasses.replace(arm, lower=arm.lower + shift, upper=arm.upper + shift)
    return arm, far, shift, q, target_of(arm, jaxik.forward_kinematics(arm, q))


PRESETS = quick("iiwa7", slow=["meccanoid_left"])


@pytest.mark.parametrize("name", PRESETS)
def test_ranges_turns_away_shift_the_branches_and_change_nothing_else(name):
    arm, far, shift, q, target = shifted(name)
    swivel = jaxik.swivel_of(arm, q).swivel
    here, there = (jaxik.solve_ik(a, target, swivel) for a in (arm, far))
    assert here.ok.any(axis=-1).mean() > 0.5
    assert np.array_equal(here.ok, there.ok)
    assert np.allclose((there.q - shift)[there.ok], here.q[here.ok], rtol=0, atol=1e-12)
    arcs = [jaxik.swivel_arcs(a, target) for a in (arm, far)]
    assert np.allclose(arcs[0].start, arcs[1].start, rtol=0, atol=1e-9)
    assert np.array_equal(arcs[0].valid, arcs[1].valid)


@pytest.mark.parametrize("name", PRESETS)
def test_ranges_turns_away_shift_the_nearest_posture(name):
    arm, far, shift, q, target = shifted(name)
    here, there = (jaxik.solve_nearest(a, target, now) for a, now in ((arm, q + 0.2), (far, q + 0.2 + shift)))
    assert np.array_equal(here.status, there.status)
    assert np.allclose(here.q, there.q - shift, rtol=0, atol=1e-7)


def at_limits(arm, count, dtype, seed=4):
    """Random postures with up to three joints on their limits."""
    rng = np.random.default_rng(seed)
    lower, upper = np.asarray(arm.lower, dtype), np.asarray(arm.upper, dtype)
    q = rng.uniform(lower, upper, (count, len(lower))).astype(dtype)
    chosen = rng.random(q.shape).argsort(axis=1) < rng.integers(0, 4, (count, 1))
    return jnp.asarray(np.where(chosen, np.where(rng.random(q.shape) < 0.5, lower, upper), q))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("name", quick("iiwa7", slow=["iiwa14", "meccanoid_left", "meccanoid_right", "paper_arm"]))
def test_a_feasible_branch_is_within_its_limits_and_on_its_target(name, dtype):
    arm = ALL_PRESETS[name]().arm.astype(dtype)
    q = at_limits(arm, 20_000, dtype)
    target, found = target_of(arm, jaxik.forward_kinematics(arm, q)), jaxik.swivel_of(arm, q)
    solution, tol = jaxik.solve_ik(arm, target, found.swivel), tolerances(np.dtype(dtype))
    outside = ((solution.q < arm.lower) | (solution.q > arm.upper)).any(-1)
    assert not (outside & solution.ok).any()
    off = jnp.maximum(solution.residual.position / arm.length, solution.residual.rotation)
    assert float(jnp.where(solution.ok, off, 0.0).max()) <= tol.target
    own = np.take_along_axis(np.asarray(solution.status), np.asarray(found.branch)[:, None], 1)[:, 0]
    # With the wrist in the shoulder the elbow may be anywhere on a sphere, of which a swivel knows one circle.
    on_a_circle = wrist_distance(arm, q) > 1e-3 * float(arm.length)
    assert on_a_circle.mean() > 0.8
    assert (own[on_a_circle] == jaxik.Status.LIMITS).mean() < 2e-3  # those close to a singular posture
    wide = dataclasses.replace(arm, lower=arm.lower - 7, upper=arm.upper + 7)
    best = jaxik.solve_ik(wide, target, found.swivel).best(wide.lower - 1, arm=wide)
    assert not (((best.q < wide.lower) | (best.q > wide.upper)).any(-1) & best.ok).any()


def test_a_branch_that_its_limits_take_off_the_target_is_not_feasible():
    """Each joint is outside its limits by what counts as rounding, and all together miss the target."""
    arm = presets.iiwa7().arm.astype(np.float32)
    q = jnp.array([0.3, 0.2, 0.3, -0.2, 0.3, 0.2, 0.3], np.float32)
    target, found = jaxik.forward_kinematics(arm, q), jaxik.swivel_of(arm, q)
    slack = 0.9 * tolerances(np.dtype(np.float32)).limit
    for joints, status in (([0], jaxik.Status.OK), (range(7), jaxik.Status.LIMITS)):
        lower = arm.lower.at[jnp.array(joints)].set(q[jnp.array(joints)] + slack)
        solution = jaxik.solve_ik(dataclasses.replace(arm, lower=lower), target, found.swivel)
        assert solution.status[found.branch] == status
        assert (solution.q[found.branch] >= lower).all()
        assert (solution.residual.rotation[found.branch] > tolerances(np.dtype(np.float32)).target) == (status != 0)


FAR_RANGES = [(10.0, 12.0), (-12 * np.pi, -8 * np.pi), (-200 * np.pi, 7.0)]


def far_away(lower, upper):
    base = presets.iiwa7().arm
    arm = dataclasses.replace(base, lower=jnp.full(7, lower), upper=jnp.full(7, upper))
    q = jnp.asarray(np.random.default_rng(3).uniform(max(lower, -50), upper, (100, 7)))
    return arm, q, jaxik.forward_kinematics(arm, q)


@pytest.mark.parametrize(("lower", "upper"), FAR_RANGES)
def test_feasible_swivels_are_those_of_feasible_branches_in_any_range(lower, upper):
    arm, q, target = far_away(lower, upper)
    found = jaxik.swivel_of(arm, q)
    solution, arcs = jaxik.solve_ik(arm, target, found.swivel), jaxik.swivel_arcs(arm, target)
    assert np.take_along_axis(np.asarray(solution.ok), np.asarray(found.branch)[:, None], 1).all()
    assert np.array_equal(arcs.contains(found.swivel), solution.ok)


@pytest.mark.parametrize(("lower", "upper"), FAR_RANGES)
def test_the_nearest_posture_of_one_in_any_range_is_itself(lower, upper):
    arm, q, target = far_away(lower, upper)
    nearest = jaxik.solve_nearest(arm, target, q)
    assert nearest.ok.all()
    assert np.allclose(nearest.q, q, rtol=0, atol=1e-6)
