"""Teaching by hand: servos with read-back go limp, someone moves the arm, and the motion becomes a trajectory."""

import math
from collections.abc import Callable

import numpy as np

from hardware.board import Board, Fault
from hardware.errors import BoardError, CalibrationError
from hardware.joint_map import JointMap
from hardware.schedule import FRAME_S
from jaxik.trajectories import Trajectory

_POLL_S = 0.04
_SMOOTHING_S = 0.12  # a smart servo reports its position five times per second, in steps of 0.9 degrees
_REST_S = 0.2  # the motion starts from rest


def record(
    board: Board, joints: JointMap, seconds: float, *, progress: Callable[[float], None] | None = None
) -> Trajectory:
    """Record a motion made by hand.

    Joints with read-back go limp, the others hold. The recording is smoothed with a standard deviation of 0.12 s, and
    slowed down where the hand was faster than the calibration's rates, so that :func:`hardware.play` can replay it.

    Args:
        board: A board from :func:`hardware.connect`.
        joints: Calibration of the robot.
        seconds: Duration of the recording [s].
        progress: Function that is called with the fraction done, 0 to 1.

    Returns:
        Motion of all joints, within the calibration's limits and rates.

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
    board.configure(joints)
    board.enable()
    try:
        board.limp([int(j) for j in taught])
        times, q = _record_postures(board, joints, seconds, progress or (lambda fraction: None))
        board.limp([])
    finally:
        board.stop()
        board.release()
    return _as_trajectory(times, q, joints)


def _record_postures(
    board: Board, joints: JointMap, seconds: float, progress: Callable[[float], None]
) -> tuple[np.ndarray, np.ndarray]:
    """Return times ``(N,)`` [s] and postures ``(N, joint)`` [rad]."""
    began, times, q = board.clock.now(), [], []
    while (elapsed := board.clock.now() - began) < seconds:
        status = board.status()
        if status.fault is not Fault.NONE:
            raise BoardError(f"the board stopped while recording: {status.fault.message}")
        raw = np.where(np.isnan(status.measured), status.commanded, status.measured)
        times.append(elapsed)
        q.append(joints.to_rad(raw))
        progress(elapsed / seconds)
        board.clock.sleep(_POLL_S)
    return np.array(times), np.array(q)


def _as_trajectory(times: np.ndarray, recorded: np.ndarray, joints: JointMap) -> Trajectory:
    """Return the recording as a trajectory: evenly sampled, smoothed, inside limits, and no faster than the rates."""
    even = np.arange(0.0, times[-1] + 2 * _REST_S, FRAME_S)
    q = np.stack([np.interp(even - _REST_S, times, column) for column in recorded.T], -1)
    q = np.clip(_smoothed(q, _SMOOTHING_S / FRAME_S), joints.column("lower"), joints.column("upper"))
    load = np.abs(np.diff(q, axis=0)) / (joints.column("max_rate") * FRAME_S)
    stretch = np.maximum(load.max(1) * (1 + 1e-6), 1.0) if len(load) else np.ones(0)
    slowed = np.append(0.0, np.cumsum(FRAME_S * stretch))
    notes = ("recorded by hand",) + (("slowed down where the hand was too fast",) if (stretch > 1).any() else ())
    return Trajectory(slowed, q, joints.names, arm_name=joints.robot, notes=notes)


def _smoothed(q: np.ndarray, sigma: float) -> np.ndarray:
    """Return the Gaussian mean along the first axis, the ends held; sigma in rows."""
    reach = math.ceil(3 * sigma)
    weight = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    padded = np.pad(q, ((reach, reach), (0, 0)), mode="edge")
    return np.stack([np.convolve(column, weight / weight.sum(), mode="valid") for column in padded.T], -1)
