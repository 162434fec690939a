"""Arms with an outer joint: every posture is among the solutions, at singular postures too; derivatives are true."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
from jaxik import Pose, Status, forward_kinematics, solve_ik, swivel_of
from jaxik.arm import reversed_arm
from tests.helpers.arms import reference_fk
from tests.helpers.outer_joint_arms import RECORDED, postures, random_outer_joint_arm, recorded_arm

COUNT = 300
CLASSES = pytest.mark.parametrize("mirrored", [False, True])


def apart(a, b):
    """Largest distance of joint angles on their circles."""
    d = jnp.abs(a - b) % (2 * jnp.pi)
    return jnp.max(jnp.minimum(d, 2 * jnp.pi - d), axis=-1)


def own(solution, branch):
    """The solution in the branches of the postures it was made from."""
    at = branch[:, None]
    return jax.tree.map(lambda x: jnp.take_along_axis(x, at.reshape(-1, 1, *[1] * (x.ndim - 2)), 1)[:, 0], solution)


def check(arm, q, tolerance=1e-7):
    parameter, branch = swivel_of(arm, q)
    solution = solve_ik(arm, forward_kinematics(arm, q), parameter)
    found = own(solution, branch)
    assert bool(jnp.all(found.ok))
    assert float(apart(found.q, q).max()) <= tolerance
    off = jnp.maximum(solution.residual.position / arm.length, solution.residual.rotation)
    assert float(jnp.where(solution.status <= Status.LIMITS, off, 0).max()) <= 1e-12
    assert bool(jnp.all(off[solution.status == Status.ORIENTATION] > 1e-12))
    return solution


@pytest.mark.parametrize("name", RECORDED)
def test_postures_of_real_arms_are_among_the_solutions(data_dir, name):
    arm = recorded_arm(data_dir, name)
    assert arm.kinematic_class == ("U-R wrist" if name[0] in "fx" else "R-U shoulder")
    q = postures(arm, 0, COUNT)
    solution = check(arm, q)
    position, rotation = reference_fk(arm, np.asarray(q[:20]))
    pose = forward_kinematics(arm, q[:20])
    np.testing.assert_allclose(pose.position, position, atol=1e-14)
    np.testing.assert_allclose(pose.rotation, rotation, atol=1e-14)
    # In limits exactly where a branch says so.
    inside = jnp.all((solution.q >= arm.lower) & (solution.q <= arm.upper), axis=-1)
    assert bool(jnp.all(inside[solution.ok]))
    assert not bool(jnp.any(inside[solution.status == Status.LIMITS]))


@CLASSES
def test_postures_of_random_arms_are_among_the_solutions(mirrored):
    for seed in range(12):
        arm = random_outer_joint_arm(seed, mirrored=mirrored, right_angles=seed % 3 == 0)
        check(arm, postures(arm, seed, COUNT), 1e-5)


def test_branches_differ_by_what_their_bits_say():
    arm = random_outer_joint_arm(1)
    q = postures(arm, 1, COUNT)
    solution = solve_ik(arm, forward_kinematics(arm, q), swivel_of(arm, q).swivel)
    again = swivel_of(arm, solution.q)
    there = solution.status == Status.OK
    assert bool(jnp.all((again.branch == jnp.arange(8))[there]))
    assert float(there.mean()) > 0.5


def test_a_missing_root_is_one_that_geometry_denies(data_dir):
    """Axis 5 makes known angles with the line to the wrist and with axis 6: without a root these do not fit."""
    arm = recorded_arm(data_dir, "franka_fr3")
    q = postures(arm, 3, COUNT)
    target = forward_kinematics(arm, q)
    solution = solve_ik(arm, target, q[:, 6])
    statuses = np.asarray(solution.status)
    assert {Status.OK, Status.LIMITS, Status.ORIENTATION} == set(np.unique(statuses))
    # Both roots of an elbow are missing, or none; the mirrored hand does not fit the closest posture either.
    missing = (statuses == Status.ORIENTATION).reshape(-1, 2, 2, 2)
    assert np.all(missing == missing[:, :1, :, :1])
    row = np.nonzero(statuses == Status.ORIENTATION)[0]
    wrist_axis = jaxik.jacobian(arm, q)[row, 3:, 5]
    line = jnp.diff(jaxik.joint_positions(arm, q)[row][:, [0, 2]], axis=1)[:, 0]
    forearm = jaxik.jacobian(arm, solution.q[statuses == Status.ORIENTATION])[:, 3:, 4]
    along, height = (jnp.sum(line * v, axis=-1) / jnp.linalg.norm(line, axis=-1) for v in (forearm, wrist_axis))
    room = jnp.sqrt((1 - along**2) * (1 - height**2)) - jnp.abs(arm.axes[4] @ arm.axes[5] - along * height)
    assert float(room.max()) < 0.0


def test_a_mirrored_arm_is_the_reversed_one():
    arm = random_outer_joint_arm(2, mirrored=True)
    q = postures(arm, 2, 20)
    other = reversed_arm(arm)
    target = forward_kinematics(arm, q)
    back = forward_kinematics(other, q[:, ::-1])
    np.testing.assert_allclose(back.matrix() @ target.matrix(), np.broadcast_to(np.eye(4), (20, 4, 4)), atol=1e-13)
    mine, its = solve_ik(arm, target, q[:, 0]), solve_ik(other, back, q[:, 0])
    order = np.array([0, 4, 2, 6, 1, 5, 3, 7])  # shoulder and wrist bits exchanged
    assert float(apart(mine.q, its.q[:, order, ::-1]).max()) < 1e-9
    np.testing.assert_array_equal(mine.status, its.status[:, order])


@CLASSES
def test_reverse_is_forward_is_central_differences(mirrored):
    arm, rng = random_outer_joint_arm(4, mirrored=mirrored), np.random.default_rng(0)
    q = postures(arm, 4, 200)
    parameter, branch = swivel_of(arm, q)
    target = forward_kinematics(arm, q)
    regular = jnp.all(solve_ik(arm, target, parameter).status == 0, axis=-1) & (jaxik.manipulability(arm, q) > 2e-3)
    q, parameter, branch, target = jax.tree.map(lambda x: x[regular][:16], (q, parameter, branch, target))
    inputs = (arm, target.position, target.rotation, parameter)
    change = jax.tree.map(lambda x: jnp.asarray(rng.normal(size=x.shape)), inputs)
    hat = jnp.cross(change[1][:, None], jnp.eye(3)).swapaxes(1, 2)
    change = (change[0], change[1], hat @ target.rotation, change[3])

    @jax.jit
    def solved(arm, position, rotation, parameter):
        return own(solve_ik(arm, Pose(position, rotation), parameter), branch).q

    value, rate = jax.jvp(solved, inputs, change)
    weights = jnp.asarray(rng.normal(size=value.shape))
    gradients = jax.vjp(solved, *inputs)[1](weights)
    pairs = list(zip(jax.tree.leaves(gradients), jax.tree.leaves(change), strict=True))
    scale = sum(float(jnp.abs(g * c).sum()) for g, c in pairs)
    assert abs(sum(float(jnp.vdot(g, c)) for g, c in pairs) - float(jnp.vdot(rate, weights))) < 1e-11 * scale
    h = 1e-6
    ahead, behind = (solved(*jax.tree.map(lambda x, c, s=s: x + s * h * c, inputs, change)) for s in (1, -1))
    d = ahead - behind
    d = (d - 2 * jnp.pi * jnp.round(d / (2 * jnp.pi))) / (2 * h)
    size = jnp.max(jnp.abs(rate), axis=-1)
    calm = size < 100  # differences lose their digits near singular postures
    assert int(calm.sum()) >= 8
    assert float((jnp.max(jnp.abs(d - rate), axis=-1) / size)[calm].max()) < 1e-5


def singular_posture(kind, arm, q):
    """The posture made singular, and what of a motion has to rest so that the arm can follow it."""
    if kind == "shoulder":  # aligned: joint 1 held
        a1, a2, a3 = (np.asarray(a) for a in arm.axes[:3])
        return q.at[:, 1].set(-np.arctan2(a3 @ np.cross(a2, a1), a3 @ a1)), [0]
    if kind == "straight":
        u, v, a4 = (np.asarray(x) for x in (arm.elbow - arm.shoulder, arm.wrist - arm.elbow, arm.axes[3]))
        u, v = u - a4 * (a4 @ u), v - a4 * (a4 @ v)
        return q.at[:, 3].set(-np.arctan2(a4 @ np.cross(u, v), u @ v)), [3]
    # Two roots meet where axes 5 and 6 and the line are in a plane: a cos q5 + b sin q5 = 0.
    values = []
    for angle in (0.0, np.pi / 2):
        at = q.at[:, 4].set(angle)
        axes = jaxik.jacobian(arm, at)[:, 3:, 4:6]
        line = jnp.diff(jaxik.joint_positions(arm, at)[:, [0, 2]], axis=1)[:, 0]
        values.append(jnp.sum(line * jnp.cross(axes[..., 1], axes[..., 0]), axis=-1))
    return q.at[:, 4].set(jnp.arctan2(-values[0], values[1])), [3, 4]


@pytest.mark.parametrize("kind", ["shoulder", "straight", "root"])
def test_singular_postures_are_solved_and_have_the_derivative_that_is_promised(kind):
    arm, rng = random_outer_joint_arm(5), np.random.default_rng(5)
    q, held = singular_posture(kind, arm, postures(arm, 5, COUNT)[:32])
    if kind == "shoulder":
        q = q.at[:, 0].set(0.0)
    rate = jnp.asarray(rng.normal(size=q.shape)).at[:, held].set(0.0)

    def solved(q):
        return solve_ik(arm, forward_kinematics(arm, q), q[:, 6])

    solution, change = jax.jvp(lambda q: solved(q).q, (q,), (rate,))
    found = solved(q)
    reached = found.status <= Status.LIMITS
    assert float(jnp.where(reached, found.residual.position, 0).max()) < 1e-9 * float(arm.length)
    # 1e-6: at a singular posture half of the digits are lost.
    distance = apart(solution, q[:, None])
    at = jnp.argmin(distance, axis=-1)
    assert float(distance.min(axis=-1).max()) < 1e-6
    status = jnp.take_along_axis(found.status, at[:, None], 1)
    assert bool(jnp.all(status == Status.NEAR_SINGULAR))
    mine = jnp.take_along_axis(change, at[:, None, None], 1)[:, 0]
    assert bool(jnp.all(jnp.isfinite(change)))
    assert float(jnp.abs(mine - rate).max()) < 1e-5
    gradient = jax.grad(lambda q: jnp.sum(solved(q).q ** 2))(q)
    assert bool(jnp.all(jnp.isfinite(gradient)))


@CLASSES
def test_bad_rows_and_targets_out_of_reach_stay_finite_and_to_themselves(mirrored):
    arm = random_outer_joint_arm(6, mirrored=mirrored)
    q = postures(arm, 6, COUNT)[:8]
    target = forward_kinematics(arm, q)
    parameter = swivel_of(arm, q).swivel
    position = target.position.at[1, 0].set(jnp.nan).at[2].multiply(100.0).at[3].set(jnp.inf).at[6].set(1e300)
    rotation = target.rotation.at[4].multiply(2.0)
    bad = parameter.at[5].set(1e9)

    def solved(position, rotation, parameter):
        return solve_ik(arm, Pose(position, rotation), parameter)

    solution = solved(position, rotation, bad)
    worst = np.asarray(solution.status.min(axis=-1))
    assert worst[[1, 3]].tolist() == [Status.NONFINITE_INPUT] * 2
    assert worst[[4, 5]].tolist() == [Status.INVALID_TARGET] * 2
    assert worst[[2, 6]].tolist() == [Status.OUT_OF_REACH] * 2
    assert (worst[[0, 7]] <= Status.NEAR_SINGULAR).all()
    assert bool(jnp.all(jnp.isfinite(solution.q)))
    good = np.array([0, 7])
    np.testing.assert_array_equal(solution.q[good], solved(target.position, target.rotation, parameter).q[good])
    gradients = jax.grad(lambda *x: jnp.sum(solved(*x).q ** 2), argnums=(0, 1, 2))(position, rotation, bad)
    assert all(bool(jnp.all(jnp.isfinite(g))) for g in gradients)
    assert not any(bool(jnp.any(g[np.array([1, 3, 4, 5])])) for g in gradients)
    whole = jax.grad(lambda a: jnp.sum(solve_ik(a, Pose(position, rotation), bad).q ** 2), allow_int=True)(arm)
    assert all(bool(jnp.all(jnp.isfinite(g))) for g in jax.tree.leaves(whole))


def test_hand_along_the_line_to_the_wrist_is_solved():
    """Axis 6 along the line from shoulder to wrist, where the line is across axis 5: every root serves."""
    arm = random_outer_joint_arm(7, right_angles=True)
    q = postures(arm, 7, COUNT)[:1]

    def along(angle):
        at = q[0].at[3].set(angle)
        line = np.diff(np.asarray(jaxik.joint_positions(arm, at))[[0, 2]], axis=0)[0]
        return float(line @ np.asarray(jaxik.jacobian(arm, at)[3:, 4]))

    grid = np.linspace(-np.pi, np.pi, 60)
    values = [along(x) for x in grid]
    change = next(i for i in range(59) if values[i] * values[i + 1] < 0)
    low, high = grid[change], grid[change + 1]
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if along(middle) * values[change] > 0 else (low, middle)
    q = q.at[:, 3].set(low)
    line = np.diff(np.asarray(jaxik.joint_positions(arm, q[0]))[[0, 2]], axis=0)[0]
    z0, z90 = (np.asarray(jaxik.jacobian(arm, q[0].at[4].set(a))[3:, 5]) for a in (0.0, np.pi / 2))
    q = q.at[:, 4].set(np.arctan2(line @ z90, line @ z0))
    solution = solve_ik(arm, forward_kinematics(arm, q), q[:, 6])
    off = jnp.maximum(solution.residual.position / arm.length, solution.residual.rotation)
    reached = solution.status <= Status.NEAR_SINGULAR
    assert int(reached.sum()) >= 4
    assert float(jnp.where(reached, off, 0).max()) < 1e-9
    gradient = jax.grad(lambda p: jnp.sum(solve_ik(arm, forward_kinematics(arm, q), p).q))(q[:, 6])
    assert bool(jnp.all(jnp.isfinite(gradient)))


@CLASSES
def test_single_precision(mirrored):
    arm = random_outer_joint_arm(8, mirrored=mirrored)
    q = postures(arm, 8, COUNT).astype(jnp.float32)
    single = arm.astype(jnp.float32)
    solution = solve_ik(single, forward_kinematics(single, q), swivel_of(single, q).swivel)
    assert solution.q.dtype == jnp.float32
    off = jnp.maximum(solution.residual.position / single.length, solution.residual.rotation)
    assert float(jnp.where(solution.status == Status.OK, off, 0).max()) <= 5e-6


@CLASSES
def test_keep_out_is_that_of_the_elbow_in_the_base_frame(mirrored):
    arm = random_outer_joint_arm(9, mirrored=mirrored)
    q = postures(arm, 9, COUNT)
    elbows = jaxik.joint_positions(arm, q)[:, 1]
    normal = jnp.asarray([[0.6, 0.0, 0.8]])
    arm = dataclasses.replace(arm, keep_out=jaxik.HalfSpaces(normal, jnp.median(elbows @ normal[0])[None]))
    solution = solve_ik(arm, forward_kinematics(arm, q), swivel_of(arm, q).swivel)
    past = jaxik.joint_positions(arm, solution.q)[:, :, 1] @ normal[0] > arm.keep_out.offset
    there = solution.status <= Status.KEEP_OUT
    assert 0.2 < float(past[there].mean()) < 0.8
    np.testing.assert_array_equal(past[there], (solution.status == Status.KEEP_OUT)[there])


def test_functions_without_the_class_say_what_works():
    arm = random_outer_joint_arm(10)
    q = jnp.zeros(7)
    with pytest.raises(jaxik.ArmClassError, match=r"S-R-S arms only.* U-R wrist arm, for which .*solve_ik"):
        jaxik.swivel_toward(arm, forward_kinematics(arm, q), jnp.ones(3))
    pose = forward_kinematics(arm, q)
    with pytest.raises(ValueError, match=r"U-R wrist arm has no closed form for pointing"):
        solve_ik(arm, pose.pointing(), 0.0)


@CLASSES
def test_velocities(mirrored):
    arm = random_outer_joint_arm(11, mirrored=mirrored)
    q = postures(arm, 11, 50)
    jacobian = jaxik.jacobian(arm, q)
    rates = jax.jacfwd(lambda q: forward_kinematics(arm, q))(q[0])
    position, rotation = rates.position, rates.rotation
    np.testing.assert_allclose(jacobian[0, :3], position, atol=1e-13)
    spin = jnp.einsum("ijk,lj->ilk", rotation, forward_kinematics(arm, q[0]).rotation)
    np.testing.assert_allclose(jacobian[0, 3:], jnp.stack([spin[2, 1], spin[0, 2], spin[1, 0]]), atol=1e-13)
    direction = jaxik.self_motion_direction(arm, q)
    np.testing.assert_allclose(jnp.linalg.norm(direction, axis=-1), 1.0)
    assert float(jnp.abs(jnp.einsum("nij,nj->ni", jacobian, direction)).max()) < 1e-10
    assert bool(jnp.all(direction[:, arm.outer_joint] >= 0.0))
    gram = jnp.linalg.det(jacobian @ jacobian.swapaxes(1, 2))
    np.testing.assert_allclose(jaxik.manipulability(arm, q), jnp.sqrt(gram), rtol=1e-8)


@pytest.mark.parametrize(
    ("preset", "name"), [("franka_fr3", "franka_fr3"), ("franka_panda", "franka_fer"), ("xarm7", "xarm7_erd")]
)
def test_presets_are_the_recorded_arms(data_dir, preset, name):
    model, recorded = getattr(jaxik.presets, preset)(), recorded_arm(data_dir, name)
    q = postures(model.arm, 0, COUNT)
    mine, its = forward_kinematics(model, q), forward_kinematics(recorded, q)
    # The recorded tool of the Frankas is link 7, not the flange; the xArm's file prints right angles with five digits.
    offset = jnp.einsum("nij,ni->nj", mine.rotation, mine.position - its.position)
    assert float(jnp.abs(offset - offset[0]).max()) < 2e-5
    np.testing.assert_allclose(mine.rotation, its.rotation, atol=2e-5)
    np.testing.assert_allclose(model.arm.lower, recorded.lower, atol=1e-6)
    np.testing.assert_allclose(model.arm.upper, recorded.upper, atol=1e-6)
    assert model.source
    assert model.notes
    assert len(set(model.joint_names)) == 7


def test_model_files_keep_the_outer_joint(tmp_path):
    for mirrored in (False, True):
        arm = random_outer_joint_arm(12, mirrored=mirrored)
        model = jaxik.ArmModel(arm, tuple("abcdefg"), "n", "s")
        jaxik.save_model(model, tmp_path / "arm.json")
        again = jaxik.load_model(tmp_path / "arm.json")
        assert again.kinematic_class == arm.kinematic_class
        assert all(bool(jnp.all(a == b)) for a, b in zip(*map(jax.tree.leaves, (again.arm, arm)), strict=True))
    text = (tmp_path / "arm.json").read_text()
    (tmp_path / "arm.json").write_text(text.replace('"joint": 1', '"joint": 2'))
    with pytest.raises(jaxik.FileFormatError, match=r"arm.outer.joint should be 1 or 7"):
        jaxik.load_model(tmp_path / "arm.json")
    (tmp_path / "arm.json").write_text(text.replace('"joint": 1', '"joint": 7'))
    with pytest.raises(jaxik.ArmClassError, match=r"not a U-R wrist arm: axes"):
        jaxik.load_model(tmp_path / "arm.json")


@pytest.mark.slow
def test_feasible_intervals_agree_with_a_sweep(data_dir):
    arm, rows = recorded_arm(data_dir, "franka_fr3"), 6
    q = postures(arm, 5, rows)
    target = forward_kinematics(arm, q)
    arcs = jaxik.swivel_arcs(arm, target)
    assert bool(jnp.all(arcs.ok))
    parameter, branch = swivel_of(arm, q)
    assert bool(jnp.all(jnp.take_along_axis(arcs.contains(parameter), branch[:, None], -1)))
    sweep = jnp.linspace(-jnp.pi, jnp.pi, 2001)
    for row in range(rows):
        feasible = solve_ik(arm, Pose(target.position[row], target.rotation[row]), sweep).ok
        arc = jax.tree.map(lambda x, row=row: x[row], arcs)
        np.testing.assert_array_equal(arc.contains(sweep), feasible)


@CLASSES
def test_columns_are_the_same_solutions(mirrored):
    arm = random_outer_joint_arm(6, mirrored=mirrored)
    q = postures(arm, 6, COUNT)[:8]
    target, parameter = forward_kinematics(arm, q), swivel_of(arm, q).swivel
    columns = jnp.moveaxis(target.position, 0, -1), jnp.moveaxis(target.rotation, 0, -1), parameter
    branches, solution = jaxik.solve_ik_columns(arm, *columns), solve_ik(arm, target, parameter)
    np.testing.assert_array_equal(branches.status.T, solution.status)
    for branch in range(8):
        mine = jnp.stack(branches.joints(branch), axis=-1)
        np.testing.assert_allclose(mine, solution.q[:, branch], atol=1e-9)
        np.testing.assert_array_equal(branches.branch_status(branch), solution.status[:, branch])
