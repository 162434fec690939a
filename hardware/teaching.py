"""Teaching by hand: servos with read-back go limp, someone moves the arm, and the motion becomes a trajectory."""

import math
from collections.abc import Callable

import numpy as np

from hardware.device import Device, Fault
from hardware.errors import BoardError, CalibrationError
from hardware.joint_map import JointMap
from jaxik.trajectories import Trajectory

_POLL_S = 0.04
_STEP_S = 0.02  # of the trajectory: a servo frame
_SMOOTHING_S = 0.12  # a smart servo says where it is five times a second, in steps of 0.9 degrees
_REST_S = 0.2  # the arm starts at rest


def record(
    robot: Device, joints: JointMap, seconds: float, *, progress: Callable[[float], None] | None = None
) -> Trajectory:
    """Records a motion of the joints that have read-back; the others hold, and stay as they are.

    The recording is smoothed with a standard deviation of 0.12 s, and slowed down where a hand was faster than the
    calibration lets the servos be, so that :func:`hardware.play` can replay it.

    Args:
        robot: A board from :func:`hardware.connect`.
        joints: The robot's calibration.
        seconds: How long [s].
        progress: Called with the share done, 0 to 1.

    Returns:
        The motion of all joints, as a trajectory within the calibration's limits and rates.

    Raises:
        CalibrationError: No joint has read-back.
        BoardError: The board refuses, or stopped while recording.
        ValueError: The duration is not positive.
    """
    if not (seconds > 0 and math.isfinite(seconds)):
        raise ValueError(f"a recording needs a duration above 0 s; got {seconds!r}")
    taught = np.flatnonzero(joints.column("readback"))
    if not len(taught):
        raise CalibrationError(f"no joint of {joints.robot!r} has read-back, so none can be taught by hand")
    robot.configure(joints)
    robot.enable()
    try:
        robot.limp([int(j) for j in taught])
        times, rows = _watch(robot, joints, seconds, progress or (lambda share: None))
        robot.limp([])
    finally:
        robot.stop()
        robot.release()
    return _as_trajectory(times, rows, joints)


def _watch(
    robot: Device, joints: JointMap, seconds: float, progress: Callable[[float], None]
) -> tuple[np.ndarray, np.ndarray]:
    """Where the joints were at which times."""
    began, times, rows = robot.clock.now(), [], []
    while (since := robot.clock.now() - began) < seconds:
        status = robot.status()
        if status.fault is not Fault.NONE:
            raise BoardError(f"the board stopped while recording: {status.fault.value}")
        raw = np.where(np.isnan(status.measured), status.commanded, status.measured)
        times.append(since)
        rows.append(joints.to_rad(raw))
        progress(since / seconds)
        robot.clock.sleep(_POLL_S)
    return np.array(times), np.array(rows)


def _as_trajectory(times: np.ndarray, rows: np.ndarray, joints: JointMap) -> Trajectory:
    """Evenly sampled, smooth, inside limits, and as fast as the rates allow."""
    even = np.arange(0.0, times[-1] + 2 * _REST_S, _STEP_S)
    q = np.stack([np.interp(even - _REST_S, times, column) for column in rows.T], -1)
    q = np.clip(_smooth(q, _SMOOTHING_S / _STEP_S), joints.column("lower"), joints.column("upper"))
    share = np.abs(np.diff(q, axis=0)) / (joints.column("max_rate") * _STEP_S)
    stretch = np.maximum(share.max(1) * (1 + 1e-6), 1.0) if len(share) else np.ones(0)
    slowed = np.append(0.0, np.cumsum(_STEP_S * stretch))
    notes = ("recorded by hand",) + (("slowed down where the hand was too fast",) if (stretch > 1).any() else ())
    return Trajectory(slowed, q, joints.names, arm_name=joints.robot, notes=notes)


def _smooth(q: np.ndarray, sigma: float) -> np.ndarray:
    """A Gaussian mean along time, the ends held."""
    reach = math.ceil(3 * sigma)
    weight = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    padded = np.pad(q, ((reach, reach), (0, 0)), mode="edge")
    return np.stack([np.convolve(column, weight / weight.sum(), mode="valid") for column in padded.T], -1)
