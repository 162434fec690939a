"""Teaching by hand: servos with read-back go limp, someone moves the arm, and the motion becomes a trajectory."""

import math
import warnings
from collections.abc import Callable, Iterator

import numpy as np

from hardware.board import Board, Fault
from hardware.errors import BoardError, CalibrationError, HardwareError, LinkError
from hardware.joint_map import JointMap
from hardware.priority import sending_first
from hardware.schedule import FRAME_S
from hardware.stop_signals import stop_signals
from jaxik.errors import JaxikWarning
from jaxik.trajectories import Trajectory

ENDED_EARLY = "ended early: "  # begins the note in a recording that a signal or a fault ended
_POLL_S = 0.04
_SMOOTHING_S = 0.12  # a smart servo reports its position five times per second, in steps of 0.9 degrees
_REST_S = 0.2  # the motion starts from rest


class RecordingWarning(JaxikWarning):
    """Recording that ended before its time; what was recorded until then is kept."""


def record(
    board: Board,
    joints: JointMap,
    seconds: float,
    *,
    progress: Callable[[float], None] | None = None,
    keep: Callable[[float, np.ndarray], None] | None = None,
    until: Callable[[], bool] | None = None,
) -> Trajectory:
    """Record a motion made by hand.

    Joints with read-back go limp, the others hold. The recording is smoothed with a standard deviation of 0.12 s, and
    slowed down where the hand was faster than the calibration's rates, so that :func:`hardware.play` can replay it.

    A recording that Ctrl-C, SIGTERM, SIGHUP or a fault of the board ends is returned as far as it came, with a
    :class:`RecordingWarning` that says why. In the main thread the signals' handlers are replaced meanwhile.

    Args:
        board: A board from :func:`hardware.connect`.
        joints: Calibration of the robot.
        seconds: Longest duration of the recording [s].
        progress: Function that is called with the fraction done, 0 to 1.
        keep: Function that is called at once with each time [s] and posture, ``(joint,)`` [rad], as against a crash.
        until: Function that is asked all the time, and returns True to end the recording before.

    Returns:
        Motion of all joints, within the calibration's limits and rates.

    Raises:
        CalibrationError: No joint has read-back.
        BoardError: The board refuses, or stopped before anything was recorded.
        LinkError: The board stopped answering before anything was recorded.
        ValueError: The duration is not positive.
    """
    if not (seconds > 0 and math.isfinite(seconds)):
        raise ValueError(f"a recording needs a duration above 0 s; got {seconds!r}")
    taught = np.flatnonzero(joints.column("readback"))
    if not len(taught):
        raise CalibrationError(f"no joint of {joints.robot!r} has read-back, so none can be taught by hand")
    rows: list[tuple[float, np.ndarray]] = []
    ended: str | None = None
    with stop_signals() as signals, sending_first(board.clock):
        try:
            with signals.raising():
                board.configure(joints)
                board.enable()
                board.limp([int(j) for j in taught])
                for row in _postures(board, joints, seconds, progress or (lambda fraction: None)):
                    rows.append(row)
                    if keep is not None:
                        keep(*row)
                    if until is not None and until():
                        break
                board.limp([])
        except (KeyboardInterrupt, HardwareError) as error:
            if not rows:
                raise
            ended = str(error) or "stopped by Ctrl-C"
        finally:
            _release(board)
    if ended is not None:
        warnings.warn(f"the recording ended after {rows[-1][0]:.1f} s: {ended}", RecordingWarning, stacklevel=2)
    return _as_trajectory(rows, joints, ended)


def _release(board: Board) -> None:
    """Release the servos; a dead link is no reason to lose a recording."""
    try:
        board.stop()
        board.release()
    except LinkError:
        pass  # the board releases by itself


def _postures(
    board: Board, joints: JointMap, seconds: float, progress: Callable[[float], None]
) -> Iterator[tuple[float, np.ndarray]]:
    """Yield time [s] and posture ``(joint,)`` [rad] of every status."""
    began = board.clock.now()
    while (elapsed := board.clock.now() - began) < seconds:
        status = board.status()
        if status.fault is not Fault.NONE:
            reason = status.fault.describe(status.joint, joints.names)
            raise BoardError(f"the board stopped while recording: {reason}")
        yield elapsed, joints.to_rad(np.where(np.isnan(status.measured), status.commanded, status.measured))
        progress(elapsed / seconds)
        board.clock.sleep(_POLL_S)


def _as_trajectory(rows: list[tuple[float, np.ndarray]], joints: JointMap, ended: str | None) -> Trajectory:
    """Return the recording as a trajectory: evenly sampled, smoothed, inside limits, and no faster than the rates."""
    times, recorded = np.array([time for time, _ in rows]), np.array([posture for _, posture in rows])
    even = np.arange(0.0, times[-1] + 2 * _REST_S, FRAME_S)
    q = np.stack([np.interp(even - _REST_S, times, column) for column in recorded.T], -1)
    q = np.clip(_smoothed(q, _SMOOTHING_S / FRAME_S), joints.column("lower"), joints.column("upper"))
    load = np.abs(np.diff(q, axis=0)) / (joints.column("max_rate") * FRAME_S)
    stretch = np.maximum(load.max(1) * (1 + 1e-6), 1.0) if len(load) else np.ones(0)
    slowed = np.append(0.0, np.cumsum(FRAME_S * stretch))
    notes = ["recorded by hand"]
    notes += ["slowed down where the hand was too fast"] if (stretch > 1).any() else []
    notes += [] if ended is None else [ENDED_EARLY + ended]
    return Trajectory(slowed, q, joints.names, arm_name=joints.robot, notes=tuple(notes))


def _smoothed(q: np.ndarray, sigma: float) -> np.ndarray:
    """Return the Gaussian mean along the first axis, the ends held; sigma in rows."""
    reach = math.ceil(3 * sigma)
    weight = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    padded = np.pad(q, ((reach, reach), (0, 0)), mode="edge")
    return np.stack([np.convolve(column, weight / weight.sum(), mode="valid") for column in padded.T], -1)
