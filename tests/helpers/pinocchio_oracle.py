"""An arm model against pinocchio reading the same URDF file."""

from pathlib import Path

import numpy as np
import pinocchio as pin

from tests.helpers.arms import random_angles, reference_fk


def pinocchio_fk(path: Path, base: str, tip: str, names: tuple[str, ...], q: np.ndarray):
    """Pose of the tip in the base link for every row of q."""
    model = pin.buildModelFromUrdf(str(path))
    data = model.createData()
    positions, rotations = [], []
    for angles in q:
        full = pin.neutral(model)
        for name, angle in zip(names, angles, strict=True):
            j = model.joints[model.getJointId(name)]
            full[j.idx_q : j.idx_q + j.nq] = angle if j.nq == 1 else (np.cos(angle), np.sin(angle))
        pin.framesForwardKinematics(model, data, full)
        pose = data.oMf[model.getFrameId(base)].actInv(data.oMf[model.getFrameId(tip)])
        positions.append(pose.translation)
        rotations.append(pose.rotation)
    return np.stack(positions), np.stack(rotations)


def fk_errors(path: Path, base: str, tip: str, model, count: int = 200):
    """Largest position [m] and rotation [rad] difference to pinocchio."""
    q = random_angles(model.arm, np.random.default_rng(7), count)
    p, r = reference_fk(model.arm, q)
    p_pin, r_pin = pinocchio_fk(path, base, tip, model.joint_names, q)
    turn = np.linalg.norm(r @ r_pin.transpose(0, 2, 1) - np.eye(3), axis=(1, 2)) / np.sqrt(2)
    return np.linalg.norm(p - p_pin, axis=1).max(), turn.max()


def assert_masses_match(path: Path, model) -> None:
    """Masses and centers by the gravity torque at random postures, inertias by the mass matrix at zero angles."""
    robot_model = pin.buildModelFromUrdf(str(path))
    data = robot_model.createData()
    arm = model.arm
    rng = np.random.default_rng(3)
    for q in random_angles(arm, rng, 5):
        assert np.allclose(gravity_torque(arm, q), pin.computeGeneralizedGravity(robot_model, data, q), atol=1e-10)
    zero = np.zeros(arm.n_joints)
    assert np.allclose(mass_matrix_at_zero(arm), _symmetric(pin.crba(robot_model, data, zero)), atol=1e-10)


def gravity_torque(arm, q: np.ndarray) -> np.ndarray:
    """Central differences of the potential energy."""

    def energy(angles):
        return -sum(
            float(m) * np.asarray(arm.gravity) @ carried(arm, angles, i, np.asarray(c))
            for i, (m, c) in enumerate(zip(arm.links.mass, arm.links.center_of_mass, strict=True))
        )

    step = 1e-3  # fourth-order differences below: error about step^4
    torque = []
    for i in range(len(q)):
        e = np.eye(len(q))[i] * step
        torque.append((8 * (energy(q + e) - energy(q - e)) - (energy(q + 2 * e) - energy(q - 2 * e))) / (12 * step))
    return np.array(torque)


def carried(arm, q: np.ndarray, i: int, point: np.ndarray) -> np.ndarray:
    """A point of link i after turning joints 1..i."""
    moved = type(arm)(**{**vars(arm), "tool_position": point})
    return reference_fk(moved, np.where(np.arange(len(q)) <= i, q, 0.0))[0][0]


def mass_matrix_at_zero(arm) -> np.ndarray:
    axes = np.asarray(arm.axes)
    points = np.asarray([arm.shoulder] * 3 + [arm.elbow] + [arm.wrist] * (arm.n_joints - 4))
    total = np.zeros((arm.n_joints, arm.n_joints))
    for i in range(arm.n_joints):
        linear = np.cross(axes, np.asarray(arm.links.center_of_mass[i]) - points)[: i + 1]
        turn = axes[: i + 1]
        total[: i + 1, : i + 1] += (
            float(arm.links.mass[i]) * linear @ linear.T + turn @ np.asarray(arm.links.inertia[i]) @ turn.T
        )
    return total


def _symmetric(upper: np.ndarray) -> np.ndarray:
    return np.triu(upper) + np.triu(upper, 1).T


def pinocchio_model(arm) -> pin.Model:
    """An arm handed over joint by joint, every joint's frame parallel to the base at zero angles."""
    model = pin.Model()
    model.gravity.linear = np.asarray(arm.gravity, np.float64)
    origins = np.asarray([arm.shoulder] * 3 + [arm.elbow] + [arm.wrist] * (arm.n_joints - 4), np.float64)
    parent, before = 0, np.zeros(3)
    for i, origin in enumerate(origins):
        turning = pin.JointModelRevoluteUnaligned(np.asarray(arm.axes[i], np.float64))
        parent = model.addJoint(parent, turning, pin.SE3(np.eye(3), origin - before), f"joint_{i + 1}")
        center = np.asarray(arm.links.center_of_mass[i], np.float64) - origin
        body = pin.Inertia(float(arm.links.mass[i]), center, np.asarray(arm.links.inertia[i], np.float64))
        model.appendBodyToJoint(parent, body, pin.SE3.Identity())
        before = origin
    return model
