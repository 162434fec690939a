"""Every in-limit turn of an answer."""

import dataclasses
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
from jaxik import UnreachableError, presets, solve_ik, swivel_of
from tests.helpers.postures import target_of

IIWA = presets.iiwa7().arm
TURN = 2 * np.pi
LIMITS = {
    "±2π": (-TURN, TURN),
    "±π": (-np.pi, np.pi),
    "far": (-12 * np.pi, -9 * np.pi),
    "mixed": ([-10, -2, -3, -2, 4, -2, -TURN], [10, 2, 3, 2, 9, 2, TURN]),
}


def of_limits(lower, upper):
    return dataclasses.replace(
        IIWA, lower=jnp.broadcast_to(jnp.asarray(lower, float), 7), upper=jnp.broadcast_to(jnp.asarray(upper, float), 7)
    )


def solved(arm, rows=3, seed=0):
    low, high = np.asarray(arm.lower), np.asarray(arm.upper)
    q = jnp.asarray(np.random.default_rng(seed).uniform(np.maximum(low, -40), np.minimum(high, 40), (rows, 7)))
    return q, solve_ik(arm, target_of(arm, jaxik.forward_kinematics(arm, q)), swivel_of(arm, q).swivel)


def by_hand(arm, q):
    """All in-limit turns of one posture."""
    lists = []
    for angle, low, high in zip(np.asarray(q), np.asarray(arm.lower), np.asarray(arm.upper), strict=True):
        turns = [angle + k * TURN for k in range(-12, 13)]
        lists.append([t for t in turns if low - 1e-12 <= t <= high + 1e-12])
    return np.array(list(itertools.product(*lists)))


def same_set(a, b):
    order = (np.lexsort(np.round(x, 6).T) for x in (a, b))
    return a.shape == b.shape and np.allclose(*(x[o] for x, o in zip((a, b), order, strict=True)), rtol=0, atol=1e-9)


@pytest.mark.parametrize("limits", LIMITS.values(), ids=LIMITS)
def test_all_in_limit_turns_are_listed_nearest_first(limits):
    arm = of_limits(*limits)
    q, solution = solved(arm)
    turns = solution.turns(arm, q)
    assert turns.q.shape[:2] == (3, 8)
    for row in range(3):
        for branch in range(8):
            listed = np.asarray(turns.q[row, branch])
            valid = np.asarray(turns.valid[row, branch])
            if not solution.ok[row, branch]:
                assert not valid.any()
                assert (listed == np.asarray(solution.q[row, branch])).all()
                continue
            assert valid[: int(turns.count[row, branch])].all()
            assert same_set(listed[valid], by_hand(arm, solution.q[row, branch]))
            assert ((listed >= arm.lower) & (listed <= arm.upper)).all()
            motion = ((listed[valid] - np.asarray(q[row])) ** 2).sum(-1)
            assert (np.diff(motion) >= -1e-9).all()
            assert any((x == np.asarray(solution.q[row, branch])).all() for x in listed)
    own = turns.q[np.arange(3), swivel_of(arm, q).branch, 0]
    assert np.allclose(own, q, rtol=0, atol=1e-9)


def test_an_angle_of_zero_has_three_turns_in_two_either_way():
    arm = of_limits(-TURN, TURN)
    q = jnp.array([0.0, 0.8, -0.3, -1.1, 0.2, 0.7, -0.5])
    solution = solve_ik(arm, jaxik.forward_kinematics(arm, q), swivel_of(arm, q).swivel)
    turns = solution.turns(arm)
    assert turns.q.shape == (8, 3**7, 7)
    branch = int(swivel_of(arm, q).branch)
    assert int(turns.count[branch]) == 3 * 2**6
    first = turns.q[branch, :, 0][turns.valid[branch]]
    assert np.unique(np.round(first, 9)).size == 3


def test_joints_without_limits_come_at_the_turn_nearest_to_the_present_one_or_within_a_window():
    arm = of_limits(-np.inf, np.inf)
    arm = dataclasses.replace(arm, lower=jnp.full(7, -200 * np.pi), upper=jnp.full(7, 200 * np.pi))
    q, solution = solved(arm)
    turns = solution.turns(arm, q + 0.1)
    assert turns.q.shape == (3, 8, 1, 7)
    assert turns.valid.all()
    own = turns.q[np.arange(3), swivel_of(arm, q).branch, 0]
    assert np.allclose(own, q, rtol=0, atol=1e-9)
    window = solution.turns(arm, q, window=4.0)
    assert window.q.shape == (3, 8, 2**7, 7)
    assert (jnp.abs(window.q - q[:, None, None])[window.valid] <= 4.0 + 1e-9).all()
    with pytest.raises(ValueError, match=r"at most 100000 postures per branch, got .* from ranges of 7, 7, .*window="):
        solution.turns(arm, q, window=20.0)


def test_fewer_places_hold_the_nearest():
    arm = of_limits(*LIMITS["mixed"])
    q, solution = solved(arm)
    turns, few = solution.turns(arm, q), solution.turns(arm, q, places=2)
    assert np.array_equal(few.q, turns.q[..., :2, :])
    assert np.array_equal(few.valid, turns.valid[..., :2])


def test_maps_compiles_and_differentiates():
    arm = of_limits(*LIMITS["mixed"])
    q, solution = solved(arm)
    together = solution.turns(arm, q)
    mapped = jax.jit(jax.vmap(lambda s, q: s.turns(arm, q)))(solution, q)
    assert np.array_equal(together.valid, mapped.valid)
    assert np.array_equal(together.count, mapped.count)
    for row, branch in np.ndindex(3, 8):  # as sets: rounding orders turns that are equally near
        assert same_set(np.asarray(together.q[row, branch]), np.asarray(mapped.q[row, branch]))
    target, swivel = jaxik.forward_kinematics(arm, q[0]), swivel_of(arm, q[0]).swivel
    rate = jax.jacfwd(lambda s: solve_ik(arm, target, s).turns(arm).q)(swivel)
    expected = jax.jacfwd(lambda s: solve_ik(arm, target, s).q)(swivel)
    assert np.allclose(rate, expected[:, None], rtol=0, atol=1e-9)


def test_what_it_needs_is_said():
    arm = of_limits(*LIMITS["mixed"])
    _, solution = solved(arm)
    with pytest.raises(ValueError, match="inside jit, close over the arm"):
        jax.jit(lambda arm: solution.turns(arm).q)(arm)
    with pytest.raises(ValueError, match="7 joints, got one of 6"):
        solution.turns(presets.paper_arm())
    with pytest.raises(ValueError, match="positive window"):
        solution.turns(arm, window=0.0)
    with pytest.raises(ValueError, match="positive number of places"):
        solution.turns(arm, places=0)
    far = solve_ik(arm, jaxik.Pose(jnp.full(3, 9.0), jnp.eye(3)), 0.0).turns(arm)
    assert not far.ok.any()
    with pytest.raises(UnreachableError, match="OUT_OF_REACH"):
        far.raise_if_invalid()
