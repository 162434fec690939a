"""Choosing one branch of a solution, and what results say of themselves."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxik import Status, UnreachableError, presets, solve_ik
from jaxik.arm import make_arm
from tests.helpers.postures import SAMPLE_ARMS, posed

IIWA = presets.iiwa7()


def solved(name="iiwa14", rows=12, seed=0):
    arm = SAMPLE_ARMS[name]()
    q = jnp.asarray(np.random.default_rng(seed).uniform(-1.5, 1.5, (rows, arm.n_joints)))
    target, swivel = posed(arm, q)
    return arm, q, target, swivel, solve_ik(arm, target, swivel)


def nearest_by_hand(solution, q_now, weights=1.0):
    """Branch numbers by the definition, one row at a time."""
    found = []
    for q, ok, status, now in zip(solution.q, solution.ok, solution.status, q_now, strict=True):
        motion = (np.asarray(weights) * np.square(np.asarray(q) - np.asarray(now))).sum(-1)
        allowed = np.asarray(ok) if np.any(ok) else np.asarray(status) == np.min(status)
        found.append(int(np.argmin(np.where(allowed, motion, np.inf))))
    return found


@pytest.mark.parametrize("name", ["iiwa14", "paper_arm", "general_7"])
def test_a_posture_comes_back_as_the_best_branch(name):
    _, q, _, _, solution = solved(name)
    best = solution.best(q)
    assert np.allclose(np.asarray(best.q)[best.ok], np.asarray(q)[best.ok], rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", ["iiwa14", "paper_arm", "general_7"])
def test_the_best_branch_is_feasible_and_nearest(name):
    arm, _, _, _, solution = solved(name, 60, seed=1)
    rng = np.random.default_rng(2)
    q_now, weights = rng.uniform(-2, 2, (60, arm.n_joints)), rng.uniform(0, 3, arm.n_joints)
    for given in (None, weights):
        best = solution.best(q_now, weights=given)
        assert best.branch.tolist() == nearest_by_hand(solution, q_now, 1.0 if given is None else given)
        rows = np.arange(60), best.branch
        assert np.array_equal(best.q, solution.q[rows])
        assert np.array_equal(best.status, solution.status[rows])
        assert np.array_equal(best.residual.position, solution.residual.position[rows])
        assert np.array_equal(best.residual.rotation, solution.residual.rotation[rows])
        assert np.array_equal(best.ok, np.any(solution.ok, axis=-1))


def test_without_a_posture_the_least_status_then_the_lowest_number():
    _, _, _, _, solution = solved(rows=2)
    status = jnp.array([[2, 1, 0, 0, 3, 5, 6, 0], [4, 4, 3, 3, 4, 4, 4, 4]], jnp.int32)
    best = dataclasses.replace(solution, status=status).best()
    assert best.branch.tolist() == [2, 2]
    assert best.status.tolist() == [0, 3]
    assert best.ok.tolist() == [True, False]


def test_a_row_without_a_feasible_branch_says_why():
    _, q, _, _, solution = solved(rows=2)
    status = jnp.array([[2, 2, 2, 2, 3, 5, 6, 4], [1, 4, 3, 3, 4, 4, 4, 4]], jnp.int32)
    solution = dataclasses.replace(solution, status=status)
    best = solution.best(solution.q[:, 3] + 0.01)
    assert best.branch.tolist() == [3, 0]  # of those with the least status the nearest
    assert best.status.tolist() == [Status.LIMITS, Status.NEAR_SINGULAR]
    with pytest.raises(UnreachableError, match=r"1 of 2 targets have no feasible branch; row \(0,\): LIMITS: the post"):
        best.raise_if_invalid()
    with pytest.raises(UnreachableError, match=r"1 of 2 targets have no feasible branch; row \(0,\): LIMITS"):
        solution.raise_if_invalid()
    one = jax.tree.map(lambda x: x[0], solution)
    with pytest.raises(UnreachableError, match="1 of 1 targets have no feasible branch; the target: LIMITS"):
        one.best(q[0]).raise_if_invalid()


def test_results_return_themselves_when_valid():
    _, q, _, _, solution = solved(rows=3)
    assert solution.raise_if_invalid() is solution
    best = solution.best(q)
    assert best.raise_if_invalid() is best


def test_a_present_posture_that_is_no_number_is_marked_and_harms_no_other_row():
    _, q, _, _, solution = solved(rows=4)
    expected = solution.best(q)
    for bad in (jnp.nan, jnp.inf):
        best = solution.best(q.at[1, 2].set(bad))
        assert best.status[1] == Status.NONFINITE_INPUT
        assert solution.ok[1, best.branch[1]]
        others = np.array([0, 2, 3])
        assert all(bool(jnp.all(jnp.isfinite(x))) for x in jax.tree.leaves(best))
        for a, b in zip(jax.tree.leaves(best), jax.tree.leaves(expected), strict=True):
            assert np.array_equal(a[others], b[others])
    far = solution.best(q.at[1].set(1e300))  # its square overflows
    assert solution.ok[1, far.branch[1]]
    assert far.ok.all()


def turning_arm(*limits):
    axes = [(0, 0, 1.0), (0, 1.0, 0)] * 3 + [(0, 0, 1.0)]
    lower, upper = (np.array([-3.0, 3.0])[i] * np.ones(7) for i in (0, 1))
    lower[[0, 6]], upper[[0, 6]] = limits
    return make_arm(axes, (0, 0, 0), (0, 0, 0.4), (0, 0, 0.8), (0, 0, 0.9), lower=lower, upper=upper)


def test_joints_that_turn_come_at_the_nearest_turn_within_their_limits():
    arm = turning_arm(-10.0, 10.0)
    q = jnp.array([0.4, 0.8, -0.3, 1.1, 0.2, 0.7, -0.5])
    target, swivel = posed(arm, q)
    solution = solve_ik(arm, target, swivel)
    wound = q.at[0].add(2 * np.pi).at[6].add(-2 * np.pi)
    best = solution.best(wound + 0.01, arm=arm)
    assert np.allclose(best.q, wound, rtol=0, atol=1e-9)
    # Four turns away the limits admit one; the other joints decide the branch.
    weights = jnp.ones(7).at[0].set(1e-6)
    best = solution.best(q.at[0].add(8 * np.pi), arm=arm, weights=weights)
    assert np.allclose(best.q, q.at[0].add(2 * np.pi), rtol=0, atol=1e-9)
    # Without the arm an angle is what it is.
    assert np.all(np.abs(solution.best(wound).q) <= np.pi)


def test_a_range_of_one_turn_is_no_way_round():
    arm = turning_arm(-np.pi, np.pi)
    q = jnp.array([3.1, 0.8, -0.3, 1.1, 0.2, 0.7, -0.5])
    target, swivel = posed(arm, q)
    solution = solve_ik(arm, target, swivel)
    now = q.at[0].set(-3.1)
    assert np.array_equal(solution.best(now, arm=arm).branch, solution.best(now).branch)
    assert np.array_equal(solution.best(now, arm=arm).q, solution.best(now).q)


def test_joints_that_do_not_turn_keep_their_angles_within_limits_or_not():
    arm, q, target, swivel, _ = solved(rows=20)
    tight = dataclasses.replace(arm, lower=jnp.full(7, 2.0), upper=jnp.full(7, 2.5))
    solution = solve_ik(tight, target, swivel)
    assert not np.any(solution.ok)
    assert np.array_equal(solution.best(q, arm=tight).q, solution.best(q).q)


def test_a_batch_is_its_rows_compiled_and_mapped():
    arm, q, target, swivel, _ = solved(rows=6)
    q, swivel = q.reshape(3, 2, 7), swivel.reshape(3, 2)
    target = jax.tree.map(lambda x: x.reshape(3, 2, *x.shape[1:]), target)
    solution, weights = solve_ik(arm, target, swivel), jnp.arange(7.0)
    together = solution.best(q + 0.1, arm=arm, weights=weights)
    assert together.q.shape == (3, 2, 7)
    assert together.branch.shape == together.status.shape == (3, 2)
    mapped = jax.jit(jax.vmap(lambda s, q: s.best(q, arm=arm, weights=weights)))(solution, q + 0.1)
    for a, b in zip(jax.tree.leaves(together), jax.tree.leaves(mapped), strict=True):
        assert np.array_equal(a, b)
    one = jax.tree.map(lambda x: x[1, 0], solution).best(q[1, 0] + 0.1, arm=arm, weights=weights)
    for a, b in zip(jax.tree.leaves(together), jax.tree.leaves(one), strict=True):
        assert np.array_equal(a[1, 0], b)


def test_one_posture_serves_all_rows_and_one_solution_many_postures():
    arm, q, _, _, solution = solved(rows=5)
    assert np.array_equal(solution.best(q[0], arm=arm).q, solution.best(jnp.broadcast_to(q[0], q.shape), arm=arm).q)
    one = jax.tree.map(lambda x: x[0], solution)
    assert one.best(q).q.shape == (5, 7)


def test_the_dtype_is_that_of_the_solution():
    arm, q, target, swivel, _ = solved(rows=2)
    single = jax.tree.map(lambda x: x.astype(jnp.float32), (target, swivel))
    best = solve_ik(arm, *single).best(q, arm=arm, weights=np.ones(7))
    assert best.q.dtype == best.residual.position.dtype == jnp.float32
    assert np.allclose(best.q, q, rtol=0, atol=1e-3)


def test_derivatives_are_those_of_the_branch():
    arm, q, target, swivel, solution = solved(rows=1)
    branch = int(solution.best(q).branch[0])
    found = jax.jacrev(lambda s: solve_ik(arm, target, s).best(q, arm=arm).q)(swivel)
    expected = jax.jacrev(lambda s: solve_ik(arm, target, s).q[:, branch])(swivel)
    assert np.allclose(found, expected, rtol=0, atol=1e-12)
    assert np.array_equal(jax.grad(lambda now: solution.best(now, arm=arm).q.sum())(q), np.zeros_like(q))


@pytest.mark.usefixtures("without_type_checks")
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"q_now": np.zeros(6)}, r"expected q_now of shape \(\*batch, 7\), got \(6,\)"),
        ({"q_now": "home"}, r"expected q_now of shape \(\*batch, 7\), got str"),
        ({"q_now": np.zeros(7), "weights": np.ones((2, 7))}, r"expected weights of shape \(7,\), got \(2, 7\)"),
        ({"q_now": np.zeros(7), "weights": np.float64(1)}, r"expected weights of shape \(7,\), got \(\)"),
        ({"arm": presets.paper_arm()}, "the arm of this solution with 7 joints, got one of 6"),
        ({"arm": presets.iiwa7}, r"the function iiwa7: call it, iiwa7\(\)"),
    ],
)
def test_wrong_arguments_are_refused_in_our_words(arguments, words):
    solution = solve_ik(IIWA, np.eye(4), 0.0)
    with pytest.raises(ValueError, match=words):
        solution.best(**arguments)


@pytest.mark.usefixtures("without_type_checks")
def test_lists_and_models_are_taken():
    solution = solve_ik(IIWA, np.eye(4), 0.0)
    lists = solution.best([0.0] * 7, arm=IIWA, weights=[1] * 7)
    assert np.array_equal(lists.q, solution.best(np.zeros(7), arm=IIWA.arm, weights=np.ones(7)).q)


def test_every_status_has_a_message():
    assert all(status.message[0].isalpha() and status.message[-1] != "." for status in Status)
    assert len({status.message for status in Status}) == len(Status)
