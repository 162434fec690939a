"""The closest posture: exact where the target can be reached, else the least distance within limits and keep-out."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import jaxik
from jaxik import Pointing, Pose, Status, UnreachableError, presets, solve_closest
from jaxik.redundancy.closest_search import Goal, slope, solve_free
from tests.helpers.arms import ALL_PRESETS, random_arm
from tests.helpers.postures import quick, target_of
from tests.helpers.reachable import outside_keep_out, postures

IIWA = presets.iiwa7().arm


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


def least_by_scipy(arm, target, starts, seed=1):
    """Least cost that a bounded solver finds from random starts, one target."""
    lower, upper = np.asarray(arm.lower), np.asarray(arm.upper)
    length = float(arm.length)

    def left(q):
        tool, elbow = jaxik.forward_kinematics(arm, q), jaxik.joint_positions(arm, q)[1]
        wanted = target.rotation if isinstance(target, Pose) else target.direction
        turn = (tool.rotation - wanted).ravel() / np.sqrt(2) if wanted.ndim == 2 else tool.rotation[:, 2] - wanted
        deep = jnp.maximum(arm.keep_out.normal @ elbow - arm.keep_out.offset, 0.0)
        return jnp.concatenate([(tool.position - target.position) / length, turn, 1e3 * deep / length])

    value, rate = jax.jit(left), jax.jit(jax.jacfwd(left))
    rng = np.random.default_rng(seed)
    return min(
        2
        * least_squares(
            lambda q: np.asarray(value(q)),
            rng.uniform(lower, upper),
            jac=lambda q: np.asarray(rate(q)),
            bounds=(lower, upper),
            max_nfev=100,
        ).cost
        for _ in range(starts)
    )


@pytest.mark.parametrize("name", quick("iiwa7", "meccanoid_left", slow=["iiwa14", "meccanoid_right", "paper_arm"]))
def test_no_bounded_solver_comes_closer(name):
    arm = ALL_PRESETS[name]().arm
    target = anywhere(arm, 30)
    closest = solve_closest(arm, target)
    assert (~closest.ok).sum() > 10
    assert ((closest.q >= arm.lower) & (closest.q <= arm.upper)).all()
    assert outside_keep_out(arm, np.asarray(closest.q)).all()
    weights = 1 / float(arm.length) ** 2, 1.0
    assert np.allclose(closest.cost, distances(arm, target, closest.q, weights), rtol=0, atol=1e-12)
    for row in np.flatnonzero(~np.asarray(closest.ok))[:3]:
        assert closest.cost[row] <= 1.001 * least_by_scipy(arm, target[int(row)], 12) + 1e-6


def test_a_target_in_reach_is_reached_with_the_least_motion():
    q = jnp.asarray(postures(IIWA, 20, seed=2))
    target = jaxik.forward_kinematics(IIWA, q)
    closest, nearest = solve_closest(IIWA, target, q + 0.05), jaxik.solve_nearest(IIWA, target, q + 0.05)
    assert closest.ok.all()
    assert np.array_equal(closest.q, nearest.q)
    assert (closest.cost < 1e-20).all()
    assert not closest.held.any()


def test_what_is_in_the_way_is_said():
    """Joint 4 may not bend back far enough, and the wrist is off; then a target beyond reach; then one within."""
    upper = IIWA.upper.at[3].set(-1.0)  # the elbow stays bent
    arm = dataclasses.replace(IIWA, upper=upper)
    q = jnp.array([0.3, 0.6, 0.2, -0.4, 0.3, 0.7, 0.1])
    limits = solve_closest(arm, jaxik.forward_kinematics(arm, q))
    assert limits.status == Status.LIMITS
    assert limits.q[3] == -1.0
    assert limits.held[3]
    far = solve_closest(IIWA, Pose(jnp.array([0.0, 3.0, 0.4]), jnp.eye(3)), weights=[1.0, 0.0])
    assert far.status == Status.OUT_OF_REACH
    reach = float(jnp.linalg.norm(IIWA.tool_position - IIWA.shoulder))  # the arm stands upright and straight
    gap = float(jnp.linalg.norm(jnp.array([0.0, 3.0, 0.4]) - IIWA.shoulder)) - reach
    assert np.isclose(far.residual.position, gap, rtol=0, atol=1e-6)
    assert not far.elbow_held
    with pytest.raises(UnreachableError, match="OUT_OF_REACH"):
        far.raise_if_invalid()


def test_the_elbow_stays_out_and_the_result_says_so():
    arm = random_arm(31, keep_out=1)
    q = np.random.default_rng(0).uniform(-2, 2, (200, 7))
    q = jnp.asarray(q[~outside_keep_out(arm, q)][:10])
    target = jaxik.forward_kinematics(arm, q)
    closest = solve_closest(arm, target)
    forbidden = np.asarray(closest.status == Status.KEEP_OUT)
    assert outside_keep_out(arm, np.asarray(closest.q)).all()
    assert closest.elbow_held[forbidden].all()


def test_weights_decide_what_is_given_up():
    target = anywhere(IIWA, 10, seed=3)
    place, turn = solve_closest(IIWA, target, weights=[100.0, 1e-4]), solve_closest(IIWA, target, weights=[1e-4, 1.0])
    off = ~place.ok
    assert (place.residual.position[off] <= turn.residual.position[off] + 1e-9).all()
    assert (turn.residual.rotation[off] <= place.residual.rotation[off] + 1e-9).all()
    assert (turn.residual.rotation[off] < 0.1).mean() > 0.8


def test_bad_rows_keep_the_present_posture_and_harm_no_other():
    target = anywhere(IIWA, 4, seed=4)
    now = jnp.broadcast_to(jnp.array([0.3, 0.8, -0.2, -1.2, 0.5, 0.9, 0.1]), (4, 7))
    good = solve_closest(IIWA, target, now)
    bad = Pose(target.position.at[1].set(jnp.nan), target.rotation.at[2].multiply(2.0))
    closest = solve_closest(IIWA, bad, now)
    assert closest.status[1:3].tolist() == [Status.NONFINITE_INPUT, Status.INVALID_TARGET]
    assert np.array_equal(closest.q[1:3], now[1:3])
    assert np.allclose(closest.q[jnp.array([0, 3])], good.q[jnp.array([0, 3])], rtol=0, atol=1e-9)
    lost = solve_closest(IIWA, target, now.at[0].set(jnp.nan))
    assert lost.status[0] == Status.NONFINITE_INPUT
    assert np.isfinite(lost.q).all()


def test_derivatives_are_those_of_differences():
    """Of the distance and of the tool's pose, which a self-motion of the elbow leaves as it is."""
    target = Pose(jnp.array([0.9, 0.3, 0.5]), jnp.asarray(Rotation.from_rotvec([0.5, 1.0, 0.2]).as_matrix()))

    def closest(x):
        found = solve_closest(IIWA, Pose(x, target.rotation))
        return jaxik.forward_kinematics(IIWA, found.q), found.cost

    mapped = jax.jit(jax.vmap(closest))
    rates = jax.jit(jax.jacfwd(closest))(target.position)
    h = 1e-4
    ahead, behind = mapped(target.position + h * jnp.eye(3)), mapped(target.position - h * jnp.eye(3))
    for rate, a, b in zip(*map(jax.tree.leaves, (rates, ahead, behind)), strict=True):
        assert np.allclose(jnp.moveaxis(rate, -1, 0), (a - b) / (2 * h), rtol=0, atol=1e-5)


def test_a_batch_is_its_rows():
    target = anywhere(IIWA, 4, seed=6)
    together = solve_closest(IIWA, target)
    mapped = jax.vmap(lambda t: solve_closest(IIWA, t))(target)
    assert np.allclose(together.cost, mapped.cost, rtol=1e-6, atol=1e-9)
    grid = jax.tree.map(lambda x: x.reshape(2, 2, *x.shape[1:]), target)
    assert solve_closest(IIWA, grid).held.shape == (2, 2, 7)


@pytest.mark.slow
def test_single_precision_stays_within_the_limits():
    target = jax.tree.map(lambda x: x.astype(jnp.float32), anywhere(IIWA, 30, seed=7))
    closest, exact = solve_closest(IIWA, target), solve_closest(IIWA, anywhere(IIWA, 30, seed=7))
    arm = IIWA.astype(np.float32)
    assert closest.q.dtype == jnp.float32
    assert ((closest.q >= arm.lower) & (closest.q <= arm.upper)).all()
    assert (closest.cost <= 1.01 * exact.cost + 1e-4).all()


@pytest.mark.parametrize("name", ["general_6", "general_7"])
def test_slopes_are_the_derivatives(name):
    arm = random_arm(41, int(name[-1]), keep_out=2)
    rng = np.random.default_rng(0)
    columns = 3 if arm.n_joints == 7 else 1
    goal = Goal(*(jnp.asarray(rng.normal(size=s)) for s in ((3, 1), (3, columns, 1), (columns + 1,))))
    q = jnp.asarray(rng.uniform(-2, 2, arm.n_joints))
    at = jax.tree.map(lambda x: x[..., 0], slope(arm, goal, q[:, None]))
    cost, depth = (lambda q, k=k: slope(arm, goal, q[:, None])[k][..., 0] for k in (0, 3))
    for found, exact in (
        (at.gradient, jax.grad(cost)(q)),
        (at.hessian, jax.hessian(cost)(q)),
        (at.depth_gradient, jax.jacobian(depth)(q)),
        (at.depth_hessian, jax.hessian(depth)(q)),
    ):
        assert np.allclose(found, exact, rtol=0, atol=1e-12)


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


def test_seven_joints_point_too():
    target = Pointing(jnp.array([[0.9, 0.3, 0.5], [0.4, 0.1, 0.5]]), jnp.array([[1.0, 0, 0], [0, 0, -1.0]]))
    closest = solve_closest(IIWA, target)
    assert closest.status[1] == Status.OK
    assert np.isfinite(closest.q).all()
