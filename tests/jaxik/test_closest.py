"""The closest posture: exact where the target can be reached, else the least distance within limits and keep-out.

Compilation is nearly all the time these tests take: those of one kind of arm share a program by their batch of 30 rows.
"""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import jaxik
from jaxik import Pointing, Pose, Status, UnreachableError, presets, solve_closest
from jaxik.redundancy import closest as closest_module
from jaxik.redundancy.closest_search import Goal, move_out, slope, solve_free
from tests.helpers.arms import ALL_PRESETS, random_arm
from tests.helpers.outer_joint_arms import random_outer_joint_arm
from tests.helpers.postures import quick, target_of
from tests.helpers.reachable import outside_keep_out, postures

IIWA = presets.iiwa7().arm
ARMS = {**ALL_PRESETS, "gen3": presets.gen3, "franka_fr3": presets.franka_fr3}
ROWS = 30


def solved(arm, target, q_now=None, weights=None):
    """The closest postures of up to 30 targets, as a batch of 30."""
    count = len(target.position)
    now = 0.5 * (arm.lower + arm.upper) if q_now is None else q_now
    weights = default_weights(arm) if weights is None else weights
    rows = jnp.arange(ROWS) % count
    now = jnp.broadcast_to(now, (count, arm.n_joints))[rows]
    found = solve_closest(arm, jax.tree.map(lambda x: x[rows], target), now, weights=jnp.asarray(weights, now.dtype))
    return jax.tree.map(lambda x: x[:count], found)


def default_weights(arm):
    return 1 / float(arm.length) ** 2, 1.0


def anywhere(arm, count, seed=0):
    """Random targets about the shoulder, most of which no posture reaches."""
    rng = np.random.default_rng(seed)
    position = np.asarray(arm.shoulder) + 0.5 * float(arm.length) * rng.normal(size=(count, 3))
    return target_of(arm, Pose(jnp.asarray(position), jnp.asarray(Rotation.random(count, rng=rng).as_matrix())))


def distances(arm, target, q, weights):
    """The cost by its definition."""
    tool = jaxik.forward_kinematics(arm, q)
    d2 = jnp.sum((tool.position - target.position) ** 2, axis=-1)
    if isinstance(target, Pose):
        turn2 = jnp.sum((tool.rotation - target.rotation) ** 2, axis=(-2, -1)) / 2
    else:
        turn2 = jnp.sum((tool.rotation[..., 2] - target.direction) ** 2, axis=-1)
    return weights[0] * d2 + weights[1] * turn2


@jax.jit
def left(q, arm, target):
    """Distances from one target, and of the elbow from outside its keep-out, for a least-squares solver."""
    tool, elbow = jaxik.forward_kinematics(arm, q), jaxik.joint_positions(arm, q)[1]
    wanted = target.rotation if isinstance(target, Pose) else target.direction
    turn = (tool.rotation - wanted).ravel() / np.sqrt(2) if wanted.ndim == 2 else tool.rotation[:, 2] - wanted
    deep = jnp.maximum(arm.keep_out.normal @ elbow - arm.keep_out.offset, 0.0)
    return jnp.concatenate([(tool.position - target.position) / arm.length, turn, 1e3 * deep / arm.length])


left_rate = jax.jit(jax.jacfwd(left))


def least_by_scipy(arm, target, starts, seed=1):
    """Least cost that a bounded solver finds from random starts, one target."""
    lower, upper = np.asarray(arm.lower), np.asarray(arm.upper)
    rng = np.random.default_rng(seed)
    return min(
        2
        * least_squares(
            lambda q: np.asarray(left(q, arm, target)),
            rng.uniform(lower, upper),
            jac=lambda q: np.asarray(left_rate(q, arm, target)),
            bounds=(lower, upper),
            max_nfev=100,
        ).cost
        for _ in range(starts)
    )


SLOW = "iiwa14", "meccanoid_right", "paper_arm", "gen3", "franka_fr3"


@pytest.mark.parametrize("name", quick("iiwa7", "meccanoid_left", slow=SLOW))
def test_no_bounded_solver_comes_closer(name):
    arm = ARMS[name]().arm
    target = anywhere(arm, 30)
    closest = solved(arm, target)
    assert (~closest.ok).sum() > 10
    assert ((closest.q >= arm.lower) & (closest.q <= arm.upper)).all()
    assert outside_keep_out(arm, np.asarray(closest.q)).all()
    cost = distances(arm, target, closest.q, default_weights(arm))
    assert np.allclose(closest.cost, cost, rtol=0, atol=1e-12)
    for row in np.flatnonzero(~np.asarray(closest.ok))[:3]:
        assert closest.cost[row] <= 1.001 * least_by_scipy(arm, target[int(row)], 12) + 1e-6


def test_a_target_in_reach_is_reached_with_little_motion():
    q = jnp.asarray(postures(IIWA, 20, seed=2))
    closest = solved(IIWA, jaxik.forward_kinematics(IIWA, q), q + 0.05)
    assert closest.ok.all()
    assert (closest.cost < 1e-20).all()
    assert (jnp.sum((closest.q - q - 0.05) ** 2, axis=1) <= 7 * 0.05**2 + 1e-12).all()
    assert not closest.held.any()


@pytest.mark.slow
def test_a_target_in_reach_is_reached_with_the_least_motion():
    q = jnp.asarray(postures(IIWA, ROWS, seed=2))
    target = jaxik.forward_kinematics(IIWA, q)
    assert np.array_equal(solved(IIWA, target, q + 0.05).q, jaxik.solve_nearest(IIWA, target, q + 0.05).q)


def test_what_is_in_the_way_is_said():
    """Joint 4 may not bend back far enough, and the wrist is off; then a target beyond reach; then one within."""
    upper = IIWA.upper.at[3].set(-1.0)  # the elbow stays bent
    arm = dataclasses.replace(IIWA, upper=upper)
    q = jnp.array([0.3, 0.6, 0.2, -0.4, 0.3, 0.7, 0.1])
    limits = solved(arm, jaxik.forward_kinematics(arm, q[None]))
    assert limits.status == Status.LIMITS
    assert limits.q[0, 3] == -1.0
    assert limits.held[0, 3]
    far = solved(IIWA, Pose(jnp.array([[0.0, 3.0, 0.4]]), jnp.eye(3)[None]), weights=[1.0, 0.0])
    assert far.status == Status.OUT_OF_REACH
    reach = float(jnp.linalg.norm(IIWA.tool_position - IIWA.shoulder))  # the arm stands upright and straight
    gap = float(jnp.linalg.norm(jnp.array([0.0, 3.0, 0.4]) - IIWA.shoulder)) - reach
    assert np.isclose(far.residual.position, gap, rtol=0, atol=1e-6)
    assert not far.elbow_held
    with pytest.raises(UnreachableError, match="OUT_OF_REACH"):
        far.raise_if_invalid()


@pytest.mark.parametrize("joints", quick(6, slow=[7]))
def test_the_elbow_stays_out_and_the_result_says_so(joints):
    forbidden = 0
    for seed in (31, 34, 39):
        arm = random_arm(seed, joints, keep_out=1, reference="stereographic" if joints == 6 else "paper")
        q = np.random.default_rng(0).uniform(-2, 2, (500, joints))
        q = jnp.asarray(q[~outside_keep_out(arm, q)][:ROWS])
        closest = solved(arm, target_of(arm, jaxik.forward_kinematics(arm, q)))
        assert outside_keep_out(arm, np.asarray(closest.q)).all()
        in_the_way = closest.status == Status.KEEP_OUT
        assert closest.elbow_held[in_the_way].all()
        assert not closest.elbow_held[~in_the_way].any()
        forbidden += in_the_way.sum()
    assert forbidden > 10


def test_the_elbow_is_moved_out_by_little():
    arm = random_arm(31, keep_out=2)
    rng = np.random.default_rng(0)
    room = lambda q: arm.keep_out.offset - jaxik.joint_positions(arm, q)[..., 1, :] @ arm.keep_out.normal.T  # noqa: E731
    q = jnp.asarray(rng.uniform(-2, 2, (40, 7)))
    # The elbow is 1e-9 arm lengths inside one half-space and far outside the other, or a tenth inside both.
    small = jnp.where(jnp.arange(2) == jnp.arange(40)[:, None] % 2, 1e-9, -0.1)
    deep = jnp.where(jnp.arange(40)[:, None] < 30, small, 0.1) * arm.length
    out = jax.jit(move_out)
    for row in range(40):
        offset = arm.keep_out.offset - room(q[row]) - deep[row]
        tight = dataclasses.replace(arm, keep_out=dataclasses.replace(arm.keep_out, offset=offset))
        moved = out(tight, q[row][:, None], jnp.full(1, 1e-7))[:, 0]
        if row < 30:
            assert (jaxik.joint_positions(arm, moved)[1] @ arm.keep_out.normal.T <= offset + 1e-14).all()
            assert jnp.max(jnp.abs(moved - q[row])) < 1e-6
        else:
            assert np.array_equal(moved, q[row])


def test_weights_decide_what_is_given_up():
    target = anywhere(IIWA, 10, seed=3)
    place, turn = solved(IIWA, target, weights=[100.0, 1e-4]), solved(IIWA, target, weights=[1e-4, 1.0])
    off = ~place.ok
    assert (place.residual.position[off] <= turn.residual.position[off] + 1e-9).all()
    assert (turn.residual.rotation[off] <= place.residual.rotation[off] + 1e-9).all()
    assert (turn.residual.rotation[off] < 0.1).mean() > 0.8


def test_bad_rows_keep_the_present_posture_and_harm_no_other():
    target = anywhere(IIWA, 4, seed=4)
    now = jnp.broadcast_to(jnp.array([0.3, 0.8, -0.2, -1.2, 0.5, 0.9, 0.1]), (4, 7))
    good = solved(IIWA, target, now)
    bad = Pose(target.position.at[1].set(jnp.nan), target.rotation.at[2].multiply(2.0))
    closest = solved(IIWA, bad, now)
    assert closest.status[1:3].tolist() == [Status.NONFINITE_INPUT, Status.INVALID_TARGET]
    assert np.array_equal(closest.q[1:3], now[1:3])
    assert np.allclose(closest.q[jnp.array([0, 3])], good.q[jnp.array([0, 3])], rtol=0, atol=1e-9)
    lost = solved(IIWA, target, now.at[0].set(jnp.nan))
    assert lost.status[0] == Status.NONFINITE_INPUT
    assert np.isfinite(lost.q).all()


def near_by():
    """Five targets beyond reach."""
    position = jnp.array([0.9, 0.3, 0.5]) + jnp.asarray(np.random.default_rng(5).uniform(-0.02, 0.02, (5, 3)))
    rotation = jnp.asarray(Rotation.from_rotvec([0.5, 1.0, 0.2]).as_matrix())
    return Pose(position, jnp.broadcast_to(rotation, (5, 3, 3)))


@functools.cache
def one_by_one():
    """Derivatives of the pose and cost of each of these targets by itself in its position; joint angles and cost."""

    def pose_and_cost(position, rotation, q_now, weights):
        found = solve_closest(IIWA, Pose(position, rotation), q_now, weights=weights)
        return (jaxik.forward_kinematics(IIWA, found.q), found.cost), (found.q, found.cost)

    rates = jax.jit(jax.vmap(jax.jacfwd(pose_and_cost, has_aux=True), in_axes=(0, 0, None, None)))
    middle, weights = 0.5 * (IIWA.lower + IIWA.upper), jnp.array(default_weights(IIWA))
    return rates(near_by().position, near_by().rotation, middle, weights)


def test_derivatives_are_those_of_differences():
    """Of the distance and of the tool's pose, which a self-motion of the elbow leaves as it is."""
    target, h = near_by(), 1e-5
    moved = target.position[:, None] + h * jnp.concatenate([jnp.eye(3), -jnp.eye(3)])
    rotation = jnp.broadcast_to(target.rotation[:, None], (5, 6, 3, 3))
    found = solved(IIWA, Pose(moved.reshape(30, 3), rotation.reshape(30, 3, 3)))
    assert not found.ok.any()
    there = jaxik.forward_kinematics(IIWA, found.q), found.cost
    for rate, x in zip(*map(jax.tree.leaves, (one_by_one()[0], there)), strict=True):
        x = x.reshape(5, 2, 3, *x.shape[1:])
        assert np.allclose(jnp.moveaxis(rate, -1, 1), (x[:, 0] - x[:, 1]) / (2 * h), rtol=0, atol=1e-6)


def test_a_batch_is_its_rows():
    together, (q, cost) = solved(IIWA, near_by()), one_by_one()[1]
    assert np.allclose(together.cost, cost, rtol=1e-6, atol=1e-9)
    assert np.allclose(together.q, q, rtol=0, atol=1e-6)
    grid = jax.tree.map(lambda x: x[:4].reshape(2, 2, *x.shape[1:]), near_by())
    assert jax.eval_shape(lambda t: solve_closest(IIWA, t).held, grid).shape == (2, 2, 7)


def test_chunks_of_wanted_rows_are_searched_and_no_others(monkeypatch):
    target, wanted = anywhere(IIWA, 11, seed=8), jnp.arange(11) % 3 != 1
    goal = Goal(target.position.T, jnp.moveaxis(target.rotation, 0, -1), jnp.array([0.3, 0.2, 0.2, 0.2]))
    whole = jax.jit(closest_module._search_rows)(IIWA, goal, wanted)
    monkeypatch.setattr(closest_module, "CHUNK", 3)
    chunks = jax.jit(lambda *x: closest_module._search_rows(*x))(IIWA, goal, wanted)
    assert np.allclose(whole.q[:, wanted], chunks.q[:, wanted], rtol=0, atol=1e-9)
    assert np.allclose(whole.cost[wanted], chunks.cost[wanted], rtol=0, atol=1e-12)
    assert jnp.all(chunks.q == 0.0, axis=0).sum() == 2  # seven rows are wanted, and three chunks of three searched


@pytest.mark.slow
def test_single_precision_stays_within_the_limits():
    target = jax.tree.map(lambda x: x.astype(jnp.float32), anywhere(IIWA, 30, seed=7))
    arm = IIWA.astype(np.float32)
    closest, exact = solved(arm, target), solved(IIWA, anywhere(IIWA, 30, seed=7))
    assert closest.q.dtype == jnp.float32
    assert ((closest.q >= arm.lower) & (closest.q <= arm.upper)).all()
    assert (np.asarray(closest.cost) <= 1.01 * np.asarray(exact.cost) + 1e-4).all()


@pytest.mark.parametrize("name", ["general_6", "general_7", "gen3", "franka_fr3", "mirrored"])
def test_slopes_are_the_derivatives(name):
    if name.startswith("general"):
        arm = random_arm(41, int(name[-1]), keep_out=2)
    else:
        arm = random_outer_joint_arm(3, mirrored=True) if name == "mirrored" else ARMS[name]().arm
        arm = dataclasses.replace(arm, keep_out=random_arm(41, 7, keep_out=2).keep_out)
    rng = np.random.default_rng(0)
    columns = 3 if arm.n_joints == 7 else 1
    goal = Goal(*(jnp.asarray(rng.normal(size=s)) for s in ((3, 1), (3, columns, 1), (columns + 1,))))
    q = jnp.asarray(rng.uniform(-2, 2, arm.n_joints))

    def at(q):
        return jax.tree.map(lambda x: x[..., 0], slope(arm, goal, q[:, None]))

    found, exact = jax.jit(lambda q: (at(q), jax.jacfwd(at)(q)))(q)
    assert np.allclose(found.gradient, exact.cost, rtol=0, atol=1e-12)
    assert np.allclose(found.hessian, exact.gradient, rtol=0, atol=1e-12)
    assert np.allclose(found.depth_gradient, exact.depth, rtol=0, atol=1e-12)
    assert np.allclose(found.depth_hessian, exact.depth_gradient, rtol=0, atol=1e-12)


def test_newton_steps_solve_for_the_free_joints():
    rng = np.random.default_rng(0)
    root, gradient, held = rng.normal(size=(6, 6, 4)), rng.normal(size=(6, 4)), rng.random((6, 4)) < 0.3
    hessian = np.einsum("ikn,jkn->ijn", root, root)
    step, convex = solve_free(*map(jnp.asarray, (hessian, gradient, held)), jnp.full(4, 0.1))
    assert convex.all()
    assert not solve_free(*map(jnp.asarray, (-hessian, gradient, held)), jnp.full(4, 0.1))[1].any()
    for i in range(4):
        free = ~held[:, i]
        exact = np.linalg.solve(hessian[np.ix_(free, free)][..., i] + 0.1 * np.eye(free.sum()), gradient[free, i])
        assert np.allclose(step[free, i], exact, rtol=0, atol=1e-10)
        assert (step[~free, i] == 0).all()


@pytest.mark.usefixtures("without_type_checks")
@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: solve_closest(IIWA, anywhere(IIWA, 1), weights=[1.0]), r"weights of shape \(2,\), .*got \(1,\)"),
        (lambda: solve_closest(IIWA, anywhere(IIWA, 1), np.zeros(6)), r"\(\*batch, 7\), got \(6,\)"),
        (lambda: solve_closest(IIWA, anywhere(IIWA, 1), "home"), r"q_now of shape \(\*batch, 7\), got str"),
        (lambda: solve_closest(presets.paper_arm(), Pose(jnp.zeros(3), jnp.eye(3))), r"pose.pointing\(\)"),
    ],
)
def test_wrong_arguments_are_refused_in_our_words(call, words):
    with pytest.raises(ValueError, match=words):
        call()


@pytest.mark.slow
def test_seven_joints_point_too_and_weights_have_defaults():
    target = Pointing(jnp.array([[0.9, 0.3, 0.5], [0.4, 0.1, 0.5]]), jnp.array([[1.0, 0, 0], [0, 0, -1.0]]))
    closest = solve_closest(IIWA, target)
    assert closest.status[1] == Status.OK
    assert np.isfinite(closest.q).all()
    assert np.allclose(closest.cost, distances(IIWA, target, closest.q, default_weights(IIWA)), rtol=0, atol=1e-12)
