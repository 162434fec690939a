"""Joint ranges of about a turn: a joint never passes its range's ends, and no motion that does not is better."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
from jaxik.planning import swivel_grid
from jaxik.planning.ranges import into_ranges, outside

ARM = jaxik.presets.iiwa14().arm
TIME = np.linspace(0, 5, 21)


def within(limit):
    """The arm with all joints between -limit and limit, and fast."""
    return replace(ARM, lower=jnp.full(7, -limit), upper=jnp.full(7, limit), velocity_limit=jnp.full(7, 50.0))


def motion_within(limit, seed):
    """A smooth joint motion within a limit, which most joints nearly reach, and within one turn."""
    rng = np.random.default_rng(seed)
    while True:
        size = rng.uniform(-1, 1, (3, 7)) * [1.5, 0.8, 1.5, 0.8, 1.5, 0.8, 1.5]
        waves = np.sin(np.outer(TIME, np.pi / 10 * np.arange(1, 4)))
        q = rng.uniform(-limit, limit, 7) + waves @ size
        inside = (np.abs(q) <= limit).all() and (np.abs(q[:, 3]) > 0.2).all()
        if inside and (np.abs(q).max(axis=0) > 0.9 * limit).sum() > 1:
            return q


def lattice_energy(arm, path):
    """Least energy on 90 swivels in all branches and all turns within the limits, from any state to any other."""
    grid = swivel_grid(arm, path.target, 90)
    value, before = 0.0, None
    for k in range(len(path)):
        states = grid.q[k][grid.ok[k]]
        for joint in range(7):
            moved = np.concatenate([states + turn * np.eye(7)[joint] for turn in (0, 2 * np.pi, -2 * np.pi)])
            states = moved[((moved >= arm.lower) & (moved <= arm.upper)).all(axis=-1)]
        if before is not None:
            cost = (states**2).sum(-1)[:, None] + (before**2).sum(-1) - 2 * states @ before.T
            value = (cost / (TIME[k] - TIME[k - 1]) + value).min(axis=1)
        before = states
    return np.min(value)


@pytest.mark.parametrize("limit", [np.pi, 3.141592, 3.14, 3.2])
@pytest.mark.parametrize("seed", range(4))
def test_plans_keep_within_ranges_of_about_a_turn(limit, seed):
    arm, q = within(limit), motion_within(limit, seed)
    path = jaxik.Path(jaxik.forward_kinematics(arm, jnp.asarray(q)), jnp.asarray(TIME))
    plan = jaxik.plan(arm, path, gap=None).raise_if_invalid()
    assert np.abs(plan.trajectory.q).max() <= limit + 1e-6
    assert np.abs(np.diff(plan.trajectory.q, axis=0)).max() < np.pi
    by_hand = (np.diff(q, axis=0) ** 2 / np.diff(TIME)[:, None]).sum()
    assert plan.energy <= 1.02 * min(by_hand, lattice_energy(arm, path))


def turned_about_one_joint(limit, number):
    """Each of the joints 1, 3, 5 and 7 in turn through nearly all of its range, or from its very end."""
    rng = np.random.default_rng(5)
    for i in range(number + 1):
        q = rng.uniform(-2, 2, 7) * np.ones((len(TIME), 1))
        ends = -limit + 1e-3 * (i % 3), limit - 1e-3 * (i % 2)
        q[:, 2 * (i % 4)] = np.linspace(*ends, len(TIME)) * (1 if i % 5 < 3 else -1)
        if i % 7 == 0:
            q[:, 0] += np.linspace(-1, 1, len(TIME))
    return np.clip(q, -limit, limit)


@pytest.mark.parametrize("number", [3, 55])
def test_a_range_of_exactly_a_turn_is_as_good_as_a_little_less(number):
    """Arcs that went on across the ends made the refinement stop there, 2 % above."""
    energies = []
    for limit in (3.14, np.pi, 3.1415926):
        q = turned_about_one_joint(limit, number)
        arm = replace(within(limit), velocity_limit=ARM.velocity_limit)
        path = jaxik.Path(jaxik.forward_kinematics(arm, jnp.asarray(q)), jnp.asarray(4 * TIME))
        energies.append(jaxik.plan(arm, path, gap=None).raise_if_invalid().energy)
    np.testing.assert_allclose(energies, energies[0], rtol=5e-3)


def test_turns_are_chosen_for_the_whole_motion():
    arm = replace(ARM, lower=jnp.full(7, -4.0).at[2].set(9.0), upper=jnp.full(7, 4.0).at[2].set(21.0))
    q = jnp.linspace(0, 5.0, 9)[:, None] * jnp.ones(7)
    moved = into_ranges(arm, q)
    np.testing.assert_allclose(moved[:, 2], q[:, 2] + 4 * np.pi)  # 12.57 to 17.57 of [9, 21]
    np.testing.assert_array_equal(outside(arm, moved), np.arange(7) != 2)  # -6.3 to -1.3 or 0 to 5 of [-4, 4]
    np.testing.assert_allclose(into_ranges(arm, q - 3.0)[:, 2], q[:, 2] - 3.0 + 4 * np.pi)
    near = jnp.zeros(7).at[2].set(20.0)
    np.testing.assert_allclose(into_ranges(arm, q - 3.0, near)[:, 2], q[:, 2] - 3.0 + 6 * np.pi)


@pytest.mark.parametrize("first", [3.1, -3.17])
def test_a_start_keeps_its_own_turn(first):
    """Joint 7 begins at 3.1 of [-3.2, 3.2] and turns on; or begins at -3.17, the other end, and has all its range."""
    arm = replace(within(3.2), lower=jnp.full(7, -2.9).at[6].set(-3.2), upper=jnp.full(7, 2.9).at[6].set(3.2))
    q = jnp.asarray([0.3, 0.6, 0.1, -1.2, 0.2, 0.8, 0.0]) + jnp.eye(7)[6] * (first + jnp.linspace(0, 1, 21))[:, None]
    path = jaxik.Path(jaxik.forward_kinematics(arm, q), jnp.asarray(TIME))
    plan = jaxik.plan(arm, path, start=q[0], gap=None)
    if first < 0:
        np.testing.assert_allclose(plan.raise_if_invalid().trajectory.q[0], q[0], atol=1e-9)
        assert np.abs(np.diff(plan.trajectory.q, axis=0)).max() < 0.5
    assert plan.trajectory is None or np.abs(plan.trajectory.q[:, 6]).max() <= 3.2
    if plan.ok:
        assert np.abs(plan.trajectory.q[0] - np.asarray(q[0])).max() < 1e-9
