"""Arms solved by refinement: postures are found again, residuals, statuses and derivatives are those of the arm."""

import dataclasses
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
from jaxik import Pose, Status, forward_kinematics, solve_ik, swivel_of
from jaxik.arm import SLOTS, deviation_of
from jaxik.arm.refined_class import refined_geometries
from tests.helpers.outer_joint_arms import postures

COUNT = 256
SHARE = {"gen3": 0.99, "g1": 0.97}
ARMS = pytest.mark.parametrize("name", [pytest.param("gen3", marks=pytest.mark.slow), "g1"])


@pytest.fixture(scope="module")
def arms():
    return {"gen3": jaxik.presets.gen3().arm, "g1": jaxik.presets.g1("left").arm}


def apart(a, b):
    """Largest distance of joint angles on their circles."""
    return jnp.max(jnp.abs((a - b + jnp.pi) % (2 * jnp.pi) - jnp.pi), axis=-1)


def off_target(arm, target, q):
    """Distance from the target by matrix products of the chain's own axes and points, in NumPy."""
    worst = []
    for position, rotation, angles in zip(*map(np.asarray, (target.position, target.rotation, q)), strict=True):
        frame = np.eye(4)
        for axis, point, angle in zip(np.asarray(arm.axes), np.asarray(arm.points), angles, strict=True):
            k = np.cross(np.eye(3), axis).T
            turn = np.eye(4)
            turn[:3, :3] = np.eye(3) + np.sin(angle) * k.T + (1 - np.cos(angle)) * k @ k
            turn[:3, 3] = point - turn[:3, :3] @ point
            frame = frame @ turn
        at = frame @ np.append(np.asarray(arm.tool_position), 1.0)
        worst.append(max(np.abs(at[:3] - position).max(), np.abs(frame[:3, :3] @ arm.tool_rotation - rotation).max()))
    return np.array(worst)


@ARMS
def test_postures_are_among_the_solutions_and_all_that_is_ok_is_on_target(arms, name):
    arm = arms[name]
    q = postures(arm, 0, COUNT)
    target = forward_kinematics(arm, q)
    parameter, branch = swivel_of(arm, q)
    np.testing.assert_allclose(parameter, q[:, arm.outer_joint], atol=1e-15)
    solution = solve_ik(arm, target, parameter)
    assert solution.q.shape == (COUNT, SLOTS, 7)
    found = solution.ok & (apart(solution.q, q[:, None]) < 1e-5)
    assert float(jnp.mean(jnp.any(found, axis=-1))) >= SHARE[name]
    # In the slot of the posture's own branch, or in its second; elsewhere where three have the same bits.
    own = (jnp.argmax(found, axis=-1) % 8 == branch)[jnp.any(found, axis=-1)]
    assert float(jnp.mean(own)) > 0.98
    off = jnp.maximum(solution.residual.position / arm.length, solution.residual.rotation)
    assert float(jnp.where(solution.ok, off, 0.0).max()) < 1e-9
    row, first = np.nonzero(np.asarray(solution.ok))
    some = np.arange(0, len(row), 37)
    picked = jax.tree.map(lambda x: x[row[some]], target)
    assert off_target(arm, picked, solution.q[row[some], first[some]]).max() < 1e-9
    inside = jnp.all((solution.q >= arm.lower) & (solution.q <= arm.upper), axis=-1)
    assert bool(jnp.all(inside[solution.ok]))
    assert not bool(jnp.any(inside[solution.status == Status.LIMITS]))
    # What is held is held exactly, and no two solutions are one.
    assert float(apart(solution.q[..., arm.outer_joint, None], parameter[:, None, None]).max()) < 1e-12
    twice = solution.ok[:, :, None] & solution.ok[:, None] & ~jnp.eye(SLOTS, dtype=bool)
    assert float(jnp.where(twice, apart(solution.q[:, :, None], solution.q[:, None]), 1.0).min()) > 1e-6


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "share"), [("jaco2_n7_kinova", 0.985), ("yumi_left", 0.96), ("sawyer_matlab", 0.92), ("gr3_left", 0.98)]
)
def test_recorded_arms_recover_most_postures(data_dir, name, share):
    content = json.loads((data_dir / "arms" / "arms.json").read_text(encoding="utf-8"))[name]
    lower, upper, _ = zip(*content["limits"], strict=True)
    tool = np.array(content["tool"])
    arm = jaxik.arm_from_axes(
        content["axes"],
        content["points"],
        tool[:3, 3],
        tool[:3, :3],
        lower=[-np.inf if x is None else x for x in lower],
        upper=[np.inf if x is None else x for x in upper],
    )
    q = postures(arm, 1, COUNT)
    solution = solve_ik(arm, forward_kinematics(arm, q), swivel_of(arm, q).swivel)
    found = solution.ok & (apart(solution.q, q[:, None]) < 1e-5)
    assert float(jnp.mean(jnp.any(found, axis=-1))) >= share


@pytest.mark.slow
def test_reverse_is_forward_is_central_differences(arms):
    arm, rng = arms["g1"], np.random.default_rng(0)
    q = postures(arm, 4, COUNT)
    parameter = swivel_of(arm, q).swivel
    target = forward_kinematics(arm, q)
    solution = solve_ik(arm, target, parameter)
    found = (solution.status == 0) & (apart(solution.q, q[:, None]) < 1e-6)
    slot = jnp.argmax(found, axis=-1)[:, None, None]
    inputs = (arm, target.position, target.rotation, parameter)
    change = jax.tree.map(lambda x: jnp.asarray(0.3 * rng.normal(size=x.shape)), inputs)
    # Axes and rotations change as such; the limits stay.
    spin = jnp.cross(change[1][:, None], jnp.eye(3)).swapaxes(1, 2)
    own = dataclasses.replace(jax.tree.map(jnp.zeros_like, arm), points=change[0].points, tool_position=change[0].outer)
    own = dataclasses.replace(own, axes=jnp.cross(change[0].axes, arm.axes))
    change = (own, change[1], spin @ target.rotation, change[3])

    @jax.jit
    def solved(arm, position, rotation, parameter):
        solution = solve_ik(arm, Pose(position, rotation), parameter)
        return jnp.take_along_axis(solution.q, slot, 1)[:, 0]

    value, rate = jax.jvp(solved, inputs, change)
    weights = jnp.asarray(rng.normal(size=value.shape))
    pairs = [
        (g, c)
        for g, c in zip(*map(jax.tree.leaves, (jax.vjp(solved, *inputs)[1](weights), change)), strict=True)
        if g.size
    ]
    assert all(bool(jnp.all(jnp.isfinite(g))) for g, _ in pairs)
    scale = sum(float(jnp.abs(g * c).sum()) for g, c in pairs)
    assert abs(sum(float(jnp.vdot(g, c)) for g, c in pairs) - float(jnp.vdot(rate, weights))) < 1e-9 * scale
    bad = target.position.at[1, 0].set(jnp.nan).at[2].multiply(100.0).at[3].set(jnp.inf).at[4].set(1e300)
    gradient = jax.vjp(solved, arm, bad, *inputs[2:])[1](weights)[1]
    assert bool(jnp.all(jnp.isfinite(gradient)))
    assert not bool(jnp.any(gradient[1:5]))
    h = 1e-6
    ahead, behind = (solved(*jax.tree.map(lambda x, c, s=s: x + s * h * c, inputs, change)) for s in (1, -1))
    d = ((ahead - behind + jnp.pi) % (2 * jnp.pi) - jnp.pi) / (2 * h)
    size = jnp.max(jnp.abs(rate), axis=-1)
    calm = jnp.any(found, axis=-1) & (size < 30)  # differences lose their digits near folds
    assert int(calm.sum()) > COUNT // 3
    assert float(jnp.quantile((jnp.max(jnp.abs(d - rate), axis=-1) / size)[calm], 0.98)) < 1e-5


def test_bad_rows_and_targets_out_of_reach_say_so_and_stay_finite(arms):
    arm = arms["g1"]
    q = postures(arm, 6, COUNT)
    target, parameter = forward_kinematics(arm, q), q[:, arm.outer_joint]
    position = target.position.at[1, 0].set(jnp.nan).at[2].multiply(100.0).at[3].set(jnp.inf).at[6].set(1e300)
    rotation = target.rotation.at[4].multiply(2.0)
    solution = solve_ik(arm, Pose(position, rotation), parameter.at[5].set(1e9))
    worst = np.asarray(solution.status.min(axis=-1))
    assert worst[[1, 3]].tolist() == [Status.NONFINITE_INPUT] * 2
    assert worst[[4, 5]].tolist() == [Status.INVALID_TARGET] * 2
    assert worst[[2, 6]].tolist() == [Status.UNSOLVED] * 2
    assert bool(jnp.all(jnp.isfinite(solution.q)))
    good = np.r_[0, 7:COUNT]
    np.testing.assert_array_equal(solution.q[good], solve_ik(arm, target, parameter).q[good])
    with pytest.raises(jaxik.UnreachableError, match="refinement found no solution"):
        jax.tree.map(lambda x: x[2:3], solution).raise_if_invalid()


def test_functions_that_need_a_closed_form_say_so(arms):
    arm = arms["g1"]
    path = jaxik.example_path("reach")
    with pytest.raises(jaxik.ArmClassError, match=r"near U-R wrist arm.*solve_nearest from waypoint to waypoint"):
        jaxik.planning.baselines(arm, path)
    with pytest.raises(jaxik.ArmClassError, match="solve_ik at many parameters"):
        jaxik.planning.energy_map(arm, path, 0)
    with pytest.raises(jaxik.ArmClassError, match=r"near U-R wrist arm.* plan work"):
        jaxik.plan_batch(arm, path.target, path.time)
    with pytest.raises(ValueError, match="is not solved for pointing"):
        solve_ik(arm, forward_kinematics(arm, jnp.zeros(7)).pointing(), 0.0)


@pytest.mark.slow
def test_feasible_parameters_are_those_of_a_sweep(arms):
    arm = arms["g1"]
    q = postures(arm, 12, 3)
    target = forward_kinematics(arm, q)
    arcs = jaxik.swivel_arcs(arm, target)
    assert arcs.start.shape[:-1] == (3, SLOTS)
    assert bool(arcs.ok.all())
    swept = jnp.linspace(-jnp.pi, jnp.pi, 1024, endpoint=False)
    ok = solve_ik(arm, target[None], swept[:, None]).ok
    inside = jax.vmap(arcs.contains)(jnp.broadcast_to(swept[:, None], (1024, 3)))
    assert int(jnp.sum(ok != inside)) <= 0.02 * int(jnp.sum(ok))  # what is missed is narrower than the grid
    one, slot, place = np.argwhere(np.asarray(arcs.valid & (arcs.end - arcs.start < 2 * np.pi)))[0]
    start, end = (float(x[one, slot, place]) for x in (arcs.start, arcs.end))
    near = jnp.asarray([start - 1e-6, start, end, end + 1e-6])
    assert solve_ik(arm, target[int(one)], near).ok[:, slot].tolist() == [False, True, True, False]
    assert bool(jnp.all(jnp.any(arcs.contains(q[:, arm.outer_joint]), axis=-1)))


@pytest.mark.slow
def test_the_nearest_posture_is_no_farther_than_the_one_the_target_came_from(arms, rng):
    arm, n = arms["g1"], 64
    q = postures(arm, 9, n)
    step = rng.normal(size=q.shape)
    came_from = jnp.clip(q + 0.05 * step / np.linalg.norm(step, axis=1)[:, None], arm.lower, arm.upper)
    target = forward_kinematics(arm, came_from)
    solution = jaxik.solve_nearest(arm, target, q)
    assert bool(jnp.all(solution.ok))
    assert float(jnp.mean(solution.motion <= jnp.sum((came_from - q) ** 2, axis=-1) + 1e-9)) > 0.98
    np.testing.assert_allclose(forward_kinematics(arm, solution.q).matrix(), target.matrix(), atol=1e-9)


def test_the_self_motion_is_the_null_space_in_the_direction_of_the_parameter(arms):
    arm = arms["g1"]
    q = postures(arm, 8, COUNT)
    jacobian = jaxik.jacobian(arm, q)
    direction = jaxik.self_motion_direction(arm, q)
    assert float(jnp.abs(jnp.einsum("nij,nj->ni", jacobian, direction)).max()) < 1e-9
    assert bool(jnp.all(direction[:, 6] >= 0.0))


def test_presets_are_the_recorded_arms(data_dir):
    recorded = json.loads((data_dir / "arms" / "arms.json").read_text(encoding="utf-8"))
    for model, name, tolerance in (
        (jaxik.presets.g1("left"), "g1_29dof_left", 1e-9),
        (jaxik.presets.openarm("left"), "openarm_v10_left", 1e-9),
        (jaxik.presets.gen3(), "gen3_ssik", 3e-5),
    ):
        content = recorded[name]
        np.testing.assert_allclose(model.arm.axes, content["axes"], atol=tolerance)
        points = np.stack([np.asarray(model.arm.stations[i]) for i in model.arm.station_of_joint])
        gap = np.cross(points - np.array(content["points"]), content["axes"])
        assert float(np.abs(gap).max()) < tolerance
        low, high, speed = zip(*content["limits"], strict=True)
        for mine, its in ((model.arm.lower, low), (model.arm.upper, high), (model.arm.velocity_limit, speed)):
            given = np.array([x is not None for x in its])
            np.testing.assert_allclose(np.asarray(mine)[given], [x for x in its if x is not None], atol=1e-5)


def test_left_and_right_are_mirror_images(without_type_checks):
    left, right = (jaxik.presets.g1(side).arm for side in ("left", "right"))
    q = postures(left, 0, 8)
    mirrored = q * jnp.array([1.0, -1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    a, b = forward_kinematics(left, q), forward_kinematics(right, mirrored)
    np.testing.assert_allclose(a.position * jnp.array([1.0, -1.0, 1.0]), b.position, atol=1e-12)
    assert bool(jnp.all((mirrored >= right.lower) & (mirrored <= right.upper)))
    np.testing.assert_allclose(
        jaxik.gravity_torque(left, q) * jnp.array([1.0, -1.0, -1.0, 1.0, -1.0, 1.0, -1.0]),
        jaxik.gravity_torque(right, mirrored),
        atol=1e-10,
    )
    with pytest.raises(ValueError, match='"left" or "right"'):
        jaxik.presets.openarm("up")


def test_model_files_keep_the_chain(tmp_path):
    model = jaxik.presets.g1("right")
    jaxik.save_model(model, tmp_path / "arm.json")
    again = jaxik.load_model(tmp_path / "arm.json")
    assert again.kinematic_class == "near U-R wrist"
    assert all(bool(jnp.all(a == b)) for a, b in zip(*map(jax.tree.leaves, (again.arm, model.arm)), strict=True))


def test_the_nearer_member_is_taken_and_far_chains_are_refused():
    z, y = [0.0, 0, 1], [0.0, 1, 0]
    axes = np.array([z, y, z, y, z, y, z])
    points = np.array([[0.02, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0.3], [0, 0.005, 0.6], [0, 0, 0.6], [0.1, 0, 0.6]])
    arm = jaxik.arm_from_axes(axes, points, [0.1, 0, 0.7])
    assert arm.kinematic_class == "near U-R wrist"
    away = deviation_of(arm)
    assert 0.01 < away.position < 0.1
    assert away.rotation < 1e-12
    turned = axes.copy()
    turned[5] = z
    assert not refined_geometries(turned, points, np.eye(4))[0]
    with pytest.raises(jaxik.ArmClassError, match=r"too far from both for refinement: axes .* are parallel"):
        jaxik.arm_from_axes(turned, points, [0.1, 0, 0.7])
    with pytest.raises(jaxik.ArmClassError, match=r"5 joint axes.*EAIK"):
        jaxik.arm_from_axes(axes[:5], points[:5], [0.1, 0, 0.7])


def test_denavit_hartenberg_rows(without_type_checks):
    half = np.pi / 2
    lengths, turns = (0.34, 0, 0.4, 0, 0.4, 0, 0.126), (-half, half, half, -half, -half, half, 0)
    iiwa = jaxik.arm_from_dh([(0, t, d, 0) for d, t in zip(lengths, turns, strict=True)], convention="standard")
    given = jaxik.presets.iiwa7().arm
    q = postures(given, 0, 8)
    np.testing.assert_allclose(forward_kinematics(iiwa, q).position, forward_kinematics(given, q).position, atol=1e-12)
    modified = [(0, t, d, 0) for d, t in zip(lengths, (0, *turns[:-1]), strict=True)]
    other = jaxik.arm_from_dh(modified, convention="modified")
    np.testing.assert_allclose(forward_kinematics(other, q).matrix(), forward_kinematics(iiwa, q).matrix(), atol=1e-12)
    moved = jaxik.arm_from_dh(modified, convention="modified", tool=np.diag([1.0, -1, -1, 1]), lower=-1, upper=1)
    assert float(moved.upper[0]) == 1.0
    with pytest.raises(ValueError, match='"standard" or "modified"'):
        jaxik.arm_from_dh(modified, convention="craig")
