"""Free arcs among obstacles against a sweep with independent kinematics, clearance, and what uses both."""

import dataclasses
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
from jaxik import Body, Status, World
from jaxik.obstacles import RigidParts, columns_of, free_swivels
from tests.helpers.arms import ALL_PRESETS, random_arm
from tests.helpers.bodies import carried, distance, random_body, random_world
from tests.helpers.reachable import postures, target_of

TURN = 2 * np.pi
ROWS = 40  # one number of targets and one kind of body, so that one program serves all
IIWA = ALL_PRESETS["iiwa14"]().arm


@pytest.fixture(scope="module")
def bodied():
    return jaxik.with_body(IIWA, random_body(IIWA, 1))


def sweep(arm, target, world, row, samples):
    """Feasible swivels of a target by solve_ik without a body and distances in numpy, ``(samples, 8)``."""
    swivel = np.linspace(-np.pi, np.pi, samples)
    one = jax.tree.map(lambda x: jnp.broadcast_to(x[row], (samples, *x[row].shape)), target)
    bare = jaxik.solve_ik(dataclasses.replace(arm, surroundings=None), one, swivel)
    q, ok = np.asarray(bare.q), np.array(bare.ok)
    body = arm.surroundings.body
    ok[ok] = distance(body, world, carried(arm, body, q[ok])) >= 0
    return swivel, ok


@jax.jit
def arcs_and_rates(arm, target, world, push):
    """Arcs, and their rates where body and world move and grow along ``push``; one program for values and rates."""

    def arcs(step):
        arm_there, world_there = there(arm, world, push, step)
        found = jaxik.swivel_arcs(arm_there, target, world=world_there)
        return (found.start, found.end), found

    _, rates, found = jax.jvp(arcs, (0.0,), (1.0,), has_aux=True)
    return found, rates


def push_of(arm, world, seed=None):
    """A direction in which body and world move and grow; none without a seed."""
    rng = np.random.default_rng(seed)
    around = arm.surroundings.body, world
    return jax.tree.map(lambda x: jnp.asarray((seed is not None) * rng.normal(size=x.shape)), around)


def there(arm, world, push, step):
    """Arm and world moved along a direction."""
    body, world = jax.tree.map(lambda x, d: x + step * d, (arm.surroundings.body, world), push)
    return dataclasses.replace(arm, surroundings=dataclasses.replace(arm.surroundings, body=body)), world


def disagreement(arm, target, world, rows, samples):
    """Largest distance to an arc's end of a sample at which arcs and sweep disagree, and the share of free samples."""
    arcs, _ = arcs_and_rates(arm, target, world, push_of(arm, world))
    arcs = jax.tree.map(np.asarray, arcs)
    worst, share = 0.0, []
    for row in range(rows):
        swivel, ok = sweep(arm, target, world, row, samples)
        start, end, valid = arcs.start[row], arcs.end[row], arcs.valid[row]
        offset = swivel[:, None, None] - start
        held = (valid & (offset - TURN * np.floor(offset / TURN) <= end - start)).any(axis=-1)
        share.append(ok.mean())
        for sample, branch in np.argwhere(held != ok):
            ends = np.concatenate([x[branch][valid[branch]] for x in (start, end)])
            off = np.abs(np.mod(ends - swivel[sample] + np.pi, TURN) - np.pi)
            worst = max(worst, off.min(initial=np.pi))
    return worst, np.mean(share)


CASES = [(IIWA, 1), *((random_arm(seed, reference="stereographic"), seed) for seed in (3, 4))]


@pytest.mark.parametrize("case", range(len(CASES)))
def test_arcs_agree_with_a_sweep_among_obstacles(case):
    arm, seed = CASES[case]
    target = target_of(arm, postures(arm, ROWS, seed=seed))
    arm, world = jaxik.with_body(arm, random_body(arm, seed)), random_world(arm, seed)
    worst, share = disagreement(arm, target, world, 4, 4001)
    assert worst <= 1e-9
    assert 0 < share < 1


@pytest.mark.slow
@pytest.mark.parametrize("name", ["iiwa14", "meccanoid_right", 1, 2])
def test_arcs_agree_with_a_fine_sweep_among_obstacles(name):
    arm = ALL_PRESETS[name]().arm if isinstance(name, str) else random_arm(name, 7 - name % 2, limits=name % 3 > 0)
    target = target_of(arm, postures(arm, ROWS, seed=2))
    world = random_world(arm, 5)
    arm = jaxik.with_body(arm, random_body(arm, 5))
    worst, _ = disagreement(arm, target, world, 3, 40_001)
    assert worst <= 1e-9


def test_clearance_is_the_distance_of_the_closest_two(bodied):
    world, q = random_world(IIWA, 7), postures(IIWA, ROWS, seed=3)
    found = jaxik.clearance(bodied, q, world)
    body = bodied.surroundings.body
    expected = distance(body, world, carried(bodied, body, q))
    np.testing.assert_allclose(found.distance, expected, atol=1e-14)
    assert 0 < np.mean(found.ok) < 1
    worst = int(np.argmin(found.distance))
    assert found.describe(worst).startswith(f"sphere {int(found.sphere[worst])} (")
    with pytest.raises(jaxik.UnreachableError, match=r"collision: row \(\d+,\): sphere .* overlap by [\d.]+ mm"):
        found.raise_if_invalid()


def test_solve_ik_says_what_collides(bodied):
    world, q = random_world(IIWA, 7), postures(IIWA, ROWS, seed=3)
    target, swivel = target_of(IIWA, q), jaxik.swivel_of(IIWA, q).swivel
    found, alone = jaxik.solve_ik(bodied, target, swivel, world=world), jaxik.solve_ik(IIWA, target, swivel)
    np.testing.assert_array_equal(found.q, alone.q)
    body = bodied.surroundings.body
    meets = distance(body, world, carried(bodied, body, np.asarray(found.q))) < 0
    expected = np.where(meets & (np.asarray(alone.status) <= Status.KEEP_OUT), Status.COLLISION, alone.status)
    np.testing.assert_array_equal(found.status, expected)
    assert {Status.OK, Status.COLLISION} <= set(np.unique(expected))
    itself = jaxik.solve_ik(bodied, target, swivel)  # without a world
    apart = distance(body, World(), carried(bodied, body, np.asarray(found.q))) >= 0
    np.testing.assert_array_equal((itself.status == Status.COLLISION) & alone.ok, ~apart & alone.ok)


@pytest.mark.slow
def test_nearest_is_the_least_motion_among_obstacles(bodied):
    world, q = random_world(IIWA, 7), postures(IIWA, ROWS, seed=3)
    target = target_of(IIWA, q)
    now = np.clip(q + np.random.default_rng(0).normal(0, 0.3, q.shape), IIWA.lower, IIWA.upper)
    push = push_of(bodied, world, seed=1)

    @jax.jit
    def nearest_and_rates(step):
        def nearest(step):
            arm, world_there = there(bodied, world, push, step)
            found = jaxik.solve_nearest(arm, target, now, world=world_there)
            return found.q, found

        return jax.jvp(nearest, (step,), (1.0,), has_aux=True)[1:]

    rates, found = nearest_and_rates(0.0)
    sides = [nearest_and_rates(step)[1] for step in (1e-6, -1e-6)]
    numeric = np.asarray(sides[0].q - sides[1].q) / 2e-6
    same = np.asarray(found.ok & sides[0].ok & sides[1].ok) & (np.abs(numeric) < 1e3).all(axis=-1)
    np.testing.assert_allclose(rates[same], numeric[same], rtol=1e-5, atol=1e-6)
    assert (np.abs(rates[same]).max(axis=-1) > 0.1).sum() > 1  # some are held by an obstacle
    ok = np.asarray(found.ok)
    assert 0.3 < ok.mean() < 1
    np.testing.assert_array_equal(ok, arcs_and_rates(bodied, target, world, push_of(bodied, world))[0].ok)
    assert np.isin(found.status, [Status.OK, Status.NEAR_SINGULAR, Status.COLLISION]).all()
    assert np.asarray(jaxik.clearance(bodied, found.q, world).distance)[ok].min() > -1e-12
    for row in np.flatnonzero(ok)[:6]:
        swivel, free = sweep(bodied, target, world, row, 4001)
        one = jax.tree.map(lambda x, row=row: jnp.broadcast_to(x[row], (4001, *x[row].shape)), target)
        motion = np.sum((np.asarray(jaxik.solve_ik(IIWA, one, swivel).q) - now[row]) ** 2, axis=-1)
        assert found.motion[row] <= motion[free].min() + 1e-9
        assert found.motion[row] >= motion[free].min() - 0.05


def test_ends_of_arcs_have_the_derivatives_of_obstacles_and_body(bodied):
    world, target = random_world(IIWA, 7), target_of(IIWA, postures(IIWA, ROWS, seed=3))
    push, none = push_of(bodied, world, seed=1), push_of(bodied, world)
    found, rates = arcs_and_rates(bodied, target, world, push)
    sides = [arcs_and_rates(*put(bodied, world, target, push, step), none)[0] for step in (1e-6, -1e-6)]
    same = np.asarray(found.valid & (sides[0].valid == sides[1].valid)) & (np.asarray(found.valid) == sides[0].valid)
    for side, rate in zip(("start", "end"), rates, strict=True):
        numeric = (getattr(sides[0], side) - getattr(sides[1], side))[same] / 2e-6
        rate = np.asarray(rate)[same]
        close = np.abs(rate - numeric) <= 1e-4 * (1 + np.abs(rate) ** 3)
        assert close.mean() > 0.99  # but where an arc has just begun, and its ends move without bound
        assert np.median(np.abs(rate)[np.abs(rate) > 0]) > 0.1


def put(arm, world, target, push, step):
    arm, world = there(arm, world, push, step)
    return arm, target, world


def test_clearance_has_the_derivatives_of_the_closest_two(bodied):
    world, q = random_world(IIWA, 7), jnp.asarray(postures(IIWA, ROWS, seed=3))
    push = push_of(bodied, world, seed=2)

    def distance_at(step):
        return jaxik.clearance(
            *there(bodied, world, push, step)[:1], q + 0.3 * step, there(bodied, world, push, step)[1]
        )

    _, rate = jax.jvp(lambda step: distance_at(step).distance, (0.0,), (1.0,))
    numeric = (distance_at(1e-6).distance - distance_at(-1e-6).distance) / 2e-6
    np.testing.assert_allclose(rate, numeric, atol=1e-7)
    assert np.abs(rate).min() > 1e-3


def test_a_world_for_each_target(bodied):
    """Rows of one call with a hundred worlds, in several chunks, are those of calls with one world for all."""
    target = target_of(IIWA, postures(IIWA, ROWS, seed=3))
    worlds = [random_world(IIWA, seed) for seed in range(100)]
    rows = np.arange(100) % ROWS
    each = jax.tree.map(lambda *x: jnp.stack(x), *worlds)
    found = jaxik.swivel_arcs(bodied, jax.tree.map(lambda x: x[rows], target), world=each)
    widths = []
    for number in range(0, 100, 7):
        alone, _ = arcs_and_rates(bodied, target, worlds[number], push_of(bodied, worlds[number]))
        row = rows[number]
        np.testing.assert_array_equal(found.valid[number], alone.valid[row])
        np.testing.assert_allclose(found.start[number], alone.start[row], atol=1e-12)
        np.testing.assert_allclose(found.end[number], alone.end[row], atol=1e-12)
        widths.append(float(found.width[number].sum()))
    assert len(set(widths)) > 8


def test_many_items_are_taken_in_chunks_of_rows(bodied, monkeypatch):
    rng, n = np.random.default_rng(0), 12
    body = Body([3, 4, 7], np.zeros((3, 3)), 0.1, [(0, 2)])
    frame = np.linalg.qr(rng.normal(size=(n, 3, 3)))[0]
    axis, zero = frame[..., 0].T, frame[..., 1].T
    around = rng.normal(0, 0.3, (3, 2, 2, n)), np.full(2, 0.05), rng.normal(0, 0.4, (3, 1, n)), np.full(1, 0.05)
    parts = RigidParts(*map(jnp.asarray, (axis, zero, np.cross(axis.T, zero.T).T)), 1.0, *map(jnp.asarray, around))
    world = World(rng.normal(0, 0.4, (n, 5, 3)), np.full((n, 5), 0.1))
    world = columns_of(world, (n,))
    whole = free_swivels(body, parts, world)
    monkeypatch.setattr(sys.modules["jaxik.obstacles.free_swivels"], "_NUMBERS", 40)
    parted = free_swivels(body, parts, world)
    for one, other in zip(whole, parted, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-14)
    assert len(np.unique(whole.start)) > 5


def test_proximity_is_the_sum_over_all_that_must_not_meet(bodied):
    world, q = random_world(IIWA, 7), postures(IIWA, 12, seed=3)
    energy, time = jaxik.energy.proximity(bodied, world, distance=0.15), np.linspace(0.0, 2.0, 12)
    body, around = bodied.surroundings.body, random_world(IIWA, 7)
    places = carried(bodied, body, q)
    ones = [
        distance(Body([body.link[i]], np.zeros((1, 3)), body.radii[i], ()), World(c[None], r), places[:, i : i + 1])
        for i in range(len(body.link))
        for c, r in zip(np.asarray(around.centers), np.asarray(around.radii), strict=True)
        if body.link[i] > 0
    ]
    floor = np.asarray(around.offsets) - places[:, np.array(body.link) > 0] @ np.asarray(around.normals)[0]
    ones += list((floor - np.asarray(body.radii)[np.array(body.link) > 0]).T)
    ones += [
        np.linalg.norm(places[:, i] - places[:, j], axis=-1) - float(body.radii[i] + body.radii[j])
        for i, j in body.pairs
    ]
    rate = np.sum(np.maximum(1 - np.array(ones) / 0.15, 0.0) ** 3, axis=0)
    np.testing.assert_allclose(energy.rest_rate(bodied, jnp.asarray(q)), rate, atol=1e-12)
    np.testing.assert_allclose(energy(bodied, q, time), np.trapezoid(rate, time), atol=1e-12)
    push = push_of(bodied, world, seed=2)[1]

    def value(step):
        moved = jax.tree.map(lambda x, d: x + step * d, world, push)
        return jaxik.energy.proximity(bodied, moved, distance=0.15)(bodied, q + 0.3 * step, time)

    _, slope = jax.jvp(value, (0.0,), (1.0,))
    np.testing.assert_allclose(slope, (value(1e-6) - value(-1e-6)) / 2e-6, rtol=1e-6)
    assert abs(slope) > 0.1
    with pytest.raises(ValueError, match=r"distance is a length above 0 m; got 0\.0"):
        jaxik.energy.proximity(bodied, world, distance=0.0)
    with pytest.raises(ValueError, match=r"is of a world at rest; got one with batch axes \(2,\)"):
        jaxik.energy.proximity(bodied, World(np.zeros((2, 1, 3)), 0.1))
