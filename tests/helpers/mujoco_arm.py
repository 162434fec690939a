"""An arm in MuJoCo: the same masses, played by a controller that knows nothing of this project's dynamics."""

from typing import NamedTuple

import mujoco
import numpy as np

from jaxik.arm.arm import Arm

TIMESTEP_S = 1e-3
BANDWIDTH = 60.0  # of the position loop [rad/s], critically damped: a good servo; straight pieces of 40 ms are smoothed


class Played(NamedTuple):
    """What the simulated motors did, one row per simulation step.

    Attributes:
        time: ``(step,)``.
        q: ``(step, joint)`` [rad].
        qd: ``(step, joint)`` [rad/s].
        torque: ``(step, joint)`` [N m].
    """

    time: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    torque: np.ndarray


def mujoco_model(arm: Arm) -> mujoco.MjModel:
    """The arm as a chain of hinges, every body's frame parallel to the base at zero angles."""
    origins = np.asarray([arm.shoulder] * 3 + [arm.elbow] + [arm.wrist] * (arm.n_joints - 4), np.float64)
    bodies, before = "", np.zeros(3)
    for i, origin in enumerate(origins):
        full = np.asarray(arm.links.inertia[i], np.float64)
        bodies += (
            f'<body pos="{_text(origin - before)}"><joint name="joint_{i + 1}" type="hinge" '
            f'axis="{_text(arm.axes[i])}"/><inertial mass="{float(arm.links.mass[i])!r}" '
            f'pos="{_text(arm.links.center_of_mass[i] - origin)}" '
            f'fullinertia="{_text(full[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])}"/>'
        )
        before = origin
    motors = "".join(f'<motor joint="joint_{i + 1}"/>' for i in range(arm.n_joints))
    # The bounds: bodies without mass, which MuJoCo does not take, weigh next to nothing.
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler angle="radian" boundmass="1e-9" boundinertia="1e-9"/>'
        f'<option timestep="{TIMESTEP_S}" integrator="implicitfast" gravity="{_text(arm.gravity)}"/>'
        f"<worldbody>{bodies}{'</body>' * len(origins)}</worldbody><actuator>{motors}</actuator></mujoco>"
    )


def play(arm: Arm, time: np.ndarray, q: np.ndarray) -> Played:
    """Plays waypoints as they are sent to servos, straight lines in between, against the simulated arm's inertia.

    The controller asks for the acceleration that brings position and speed back, and takes masses and bias forces from
    the simulator. It begins in the first posture at the speed of the first step.
    """
    model = mujoco_model(arm)
    data, torque = mujoco.MjData(model), np.zeros(arm.n_joints)
    slope = np.diff(q, axis=0) / np.diff(time)[:, None]
    data.qpos, data.qvel = q[0], slope[0]
    count = int(np.ceil((time[-1] - time[0]) / TIMESTEP_S))
    rows = np.zeros((3, count, arm.n_joints))
    times = time[0] + TIMESTEP_S * np.arange(count)
    wanted = np.stack([np.interp(times, time, column) for column in q.T], axis=-1)
    piece = np.clip(np.searchsorted(time, times, side="right") - 1, 0, len(slope) - 1)
    for k in range(count):
        mujoco.mj_step1(model, data)
        push = BANDWIDTH**2 * (wanted[k] - data.qpos) + 2 * BANDWIDTH * (slope[piece[k]] - data.qvel)
        mujoco.mj_mulM(model, data, torque, push)
        data.ctrl = torque + data.qfrc_bias
        rows[:, k] = data.qpos, data.qvel, data.ctrl
        mujoco.mj_step2(model, data)
    return Played(times, *rows)


def drawn_energy(arm: Arm, played: Played) -> float:
    """∫ R/k_t² τ² + max(τ q̇, 0) dt of what the motors did [J]."""
    heat = np.asarray(arm.motors.resistance / arm.motors.torque_constant**2)
    power = heat * played.torque**2 + np.maximum(played.torque * played.qd, 0)
    return float(power.sum() * TIMESTEP_S)


def _text(numbers: object) -> str:
    return " ".join(repr(float(x)) for x in np.asarray(numbers, np.float64))
