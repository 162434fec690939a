"""Jacobian, manipulability and self-motion: against differences, automatic derivatives, pinocchio and MuJoCo."""

import dataclasses

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pinocchio as pin
import pytest

from jaxik import forward_kinematics, presets, swivel_of
from jaxik.kinematics import jacobian, manipulability, self_motion_direction
from tests.helpers.arms import ALL_PRESETS, random_angles, random_arm, reference_fk
from tests.helpers.mujoco_arm import mujoco_model
from tests.helpers.pinocchio_oracle import pinocchio_model

CASES = {
    **{name: lambda build=build: build().arm for name, build in ALL_PRESETS.items()},
    "general_7": lambda: random_arm(21),
    "general_6": lambda: random_arm(22, 6),
    "straight_7_paper": lambda: random_arm(23, offset=False, skew=False, reference="paper"),
    "straight_6_stereographic": lambda: random_arm(24, 6, offset=False, skew=False, reference="stereographic"),
}
IIWA = presets.iiwa7()


def postures(arm, count=30, seed=1):
    return random_angles(arm, np.random.default_rng(seed), count)


def task_rows(arm, q, rows):
    """A Jacobian's rows that a six-joint arm's task has: no rotation about the pointing direction."""
    if arm.n_joints == 7:
        return rows
    z = np.asarray(forward_kinematics(arm, q).rotation)[:, 2]
    across = np.linalg.svd(z[None])[2][1:]
    return np.concatenate([rows[:3], across @ rows[3:]])


@pytest.mark.parametrize("name", CASES)
def test_jacobian_is_that_of_pinocchio(name):
    arm = CASES[name]()
    model = pinocchio_model(arm)
    origin = np.asarray(arm.wrist)
    hand = pin.SE3(np.asarray(arm.tool_rotation), np.asarray(arm.tool_position) - origin)
    frame = model.addFrame(pin.Frame("tool", arm.n_joints, 0, hand, pin.FrameType.OP_FRAME))
    data = model.createData()
    q = postures(arm)
    expected = [pin.computeFrameJacobian(model, data, row, frame, pin.LOCAL_WORLD_ALIGNED).copy() for row in q]
    assert np.allclose(jacobian(arm, q), expected, rtol=0, atol=1e-12 * max(1, float(arm.length)))


@pytest.mark.parametrize("name", ["iiwa14", "general_7", "general_6"])
def test_jacobian_is_that_of_mujoco(name):
    arm = CASES[name]()
    possible = np.broadcast_to(0.01 * np.eye(3), arm.links.inertia.shape)  # MuJoCo refuses some of the random ones
    model = mujoco_model(dataclasses.replace(arm, links=dataclasses.replace(arm.links, inertia=possible)))
    data = mujoco.MjData(model)
    for q in postures(arm, 5):
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        linear, angular = np.zeros((2, 3, arm.n_joints))
        mujoco.mj_jac(model, data, linear, angular, reference_fk(arm, q)[0][0], arm.n_joints)
        assert np.allclose(jacobian(arm, q), np.concatenate([linear, angular]), rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", CASES)
def test_jacobian_is_the_derivative_of_forward_kinematics(name):
    arm = CASES[name]()
    for q in jnp.asarray(postures(arm, 3)):
        found, pose, rate = jacobian(arm, q), forward_kinematics(arm, q), jax.jacfwd(forward_kinematics, 1)(arm, q)
        spin = np.einsum("abj,cb->acj", rate.rotation, pose.rotation)
        assert np.allclose(found[:3], rate.position, rtol=0, atol=1e-12)
        assert np.allclose(found[3:], [spin[2, 1], spin[0, 2], spin[1, 0]], rtol=0, atol=1e-12)
        step = 1e-5 * np.eye(arm.n_joints)
        ahead, behind = (reference_fk(arm, np.asarray(q) + sign * step)[0] for sign in (1, -1))
        assert np.allclose(found[:3], (ahead - behind).T / 2e-5, rtol=0, atol=1e-8)


@pytest.mark.parametrize("name", CASES)
def test_manipulability_is_yoshikawas(name):
    arm = CASES[name]()
    q = postures(arm)
    found = manipulability(arm, q)
    assert np.all(found > 0)
    for row, value in zip(q, found, strict=True):
        rows = task_rows(arm, row, np.asarray(jacobian(arm, row)))
        assert np.isclose(value, np.sqrt(np.linalg.det(rows @ rows.T)), rtol=1e-7, atol=0)


def test_manipulability_keeps_its_digits_near_singular_postures():
    # In proportion to the angle that vanishes: the elbow's, or those of shoulder and wrist together.
    small = np.array([1e-6, 1e-9, 1e-12, 1e-15])
    for joints in ([3], [1, 5]):
        q = np.tile([0.2, 0.9, -0.4, 0.7, 0.3, 1.1, 0.0], (4, 1))
        q[:, joints] = small[:, None]
        slope = np.asarray(manipulability(IIWA, q)) / small
        assert np.allclose(slope, slope[-1], rtol=1e-5, atol=0)
        assert np.allclose(slope[1:], slope[-1], rtol=1e-8, atol=0)


@pytest.mark.parametrize("name", CASES)
def test_self_motion_is_the_null_space_and_the_swivel_grows(name):
    arm = CASES[name]()
    q = postures(arm, 60)
    direction = np.asarray(self_motion_direction(arm, q))
    assert np.allclose(np.linalg.norm(direction, axis=-1), 1, rtol=0, atol=1e-14)
    assert np.all(direction[:, 3] == 0)
    for row, d in zip(q, direction, strict=True):
        rows = task_rows(arm, row, np.asarray(jacobian(arm, row)))
        assert np.abs(rows @ d).max() < 1e-12
    ahead, behind = (np.asarray(swivel_of(arm, q + sign * 1e-6 * direction)[0]) for sign in (1, -1))
    growth = np.angle(np.exp(1j * (ahead - behind))) / 2e-6
    assert np.all(growth > 1e-6)


def test_self_motion_direction_is_continuous_between_singular_postures():
    arm = CASES["general_7"]()
    q = np.linspace(*postures(arm, 2, seed=8), 2000)
    direction = np.asarray(self_motion_direction(arm, q))
    same = np.sum(direction[1:] * direction[:-1], axis=-1)
    jumps = np.flatnonzero(same < 0.5)
    assert np.all(np.abs(same[jumps] + 1) < 0.1)  # sides change, nothing else
    assert np.all(np.delete(same, jumps) > 0.99)
    aligned = [np.sin(q[:, 1] + shoulder_delta(arm)), np.sin(q[:, 5] + wrist_delta(arm))]
    crossings = sum(np.diff(np.sign(a)) != 0 for a in aligned)
    assert np.array_equal(np.flatnonzero(crossings % 2), jumps)


def shoulder_delta(arm):
    return delta(*arm.axes[:3])


def wrist_delta(arm):
    return delta(*arm.axes[4:7])


def delta(a, b, c):
    return float(np.arctan2(np.dot(np.cross(b, a), c), np.dot(a, c)))


SINGULAR = {
    "upright": [0.0] * 7,
    "straight elbow": [0.2, 0.9, -0.4, 0.0, 0.3, 1.1, 0.5],
    "aligned shoulder": [0.2, 0.0, -0.4, 0.9, 0.3, 1.1, 0.5],
    "aligned shoulder, wrist above it": [0.2, 0.0, -0.4, 0.0, 0.3, 1.1, 0.5],
    "aligned wrist": [0.2, 0.9, -0.4, 0.9, 0.3, 0.0, 0.5],
    "aligned wrist and straight elbow": [0.2, 0.9, -0.4, 0.0, 0.3, 0.0, 0.5],
    "aligned both": [0.2, 0.0, -0.4, 0.9, 0.3, 0.0, 0.5],
    "folded": [0.2, 0.9, -0.4, np.pi, 0.3, 1.1, 0.5],
}


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("name", SINGULAR)
def test_singular_postures_have_a_direction_and_finite_derivatives(name, dtype):
    arm = IIWA.arm.astype(dtype)
    q = jnp.asarray(SINGULAR[name], dtype)
    tiny = 50 * float(jnp.finfo(dtype).eps)
    direction = self_motion_direction(arm, q)
    assert direction.dtype == manipulability(arm, q).dtype == jacobian(arm, q).dtype == dtype
    assert abs(float(jnp.linalg.norm(direction)) - 1) < tiny
    assert float(jnp.abs(jacobian(arm, q) @ direction).max()) < tiny
    # One aligned joint alone leaves the tool every freedom.
    assert (float(manipulability(arm, q)) < tiny) == (name not in ("aligned shoulder", "aligned wrist"))
    for function in (jacobian, manipulability, self_motion_direction):
        for derivative in (jax.jacfwd, jax.jacrev):
            changes = derivative(function, (0, 1))(arm, q)
            assert all(bool(jnp.all(jnp.isfinite(x))) for x in jax.tree.leaves(changes))


def test_six_joints_with_an_aligned_wrist_roll_the_forearm():
    arm = presets.paper_arm().arm
    q = jnp.array([0.3, 0.9, 0.2, 0.7, 0.4, 0.0])
    assert np.allclose(np.abs(self_motion_direction(arm, q)), np.eye(6)[4], atol=1e-15)
    q = q.at[3].set(0.0)  # the arm's line along the hand: anything but the forearm's roll turns it away
    assert np.allclose(self_motion_direction(arm, q), np.eye(6)[4], atol=1e-15)


@pytest.mark.parametrize("function", [jacobian, manipulability, self_motion_direction])
def test_a_batch_is_its_rows_and_maps_over_arms(function):
    q = postures(IIWA.arm, 6).reshape(3, 2, 7)
    found = jax.jit(function)(IIWA.arm, q)
    assert found.shape[:2] == (3, 2)
    for index in np.ndindex(3, 2):
        assert np.allclose(found[index], function(IIWA, q[index]), rtol=0, atol=1e-13)
    assert function(IIWA, q[:0]).shape == (0, *found.shape[1:])
    arms = jax.tree.map(lambda x: jnp.stack([x, x]), IIWA.arm)
    mapped = jax.vmap(function, in_axes=(0, None))(arms, q)
    assert np.allclose(mapped, np.stack([found, found]), rtol=0, atol=1e-13)
