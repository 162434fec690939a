"""Playing a trajectory on a board.

1. Check the whole trajectory: joints, limits, rates. Nothing moves if anything is wrong.
2. Read the present posture; refuse if it is too far away, else ease in on a minimum-jerk curve.
3. Play: keep the board's queue filled, log, check tolerances.
4. Hold until the goal is reached, ease out to the safe pose, and release.

However the playback ends, the arm is released, held or lowered as asked for.
"""

import math
import os
from collections.abc import Callable
from contextlib import ExitStack

import numpy as np

from hardware.board import Board
from hardware.errors import LinkError, ServoError
from hardware.joint_map import JointMap, ideal_joint_map
from hardware.joint_map_file import load_joint_map
from hardware.play_log_file import PlayLogFile
from hardware.playback import DEFAULT_TOLERANCES, EndedEarly, Playback, Tolerances
from hardware.priority import sending_first
from hardware.report import LogRow, PlayReport, PlayResult
from hardware.reporter import Reporter
from hardware.stop_signals import StopSignal, stop_signals
from hardware.stopping import OnStop
from jaxik.trajectories import Trajectory


def play(
    trajectory: Trajectory,
    board: Board,
    calibration: JointMap | str | os.PathLike[str] | None = None,
    *,
    speed: float = 1.0,
    tolerances: Tolerances = DEFAULT_TOLERANCES,
    park: bool = True,
    loops: int | None = 1,
    on_stop: OnStop | str = OnStop.RELEASE,
    log_file: str | os.PathLike[str] | None = None,
    progress: Callable[[float], None] | None = None,
    watch: Callable[[LogRow], None] | None = None,
) -> PlayReport:
    """Play a trajectory and report how it went.

    Ctrl-C, SIGTERM and SIGHUP stop the arm within a servo frame and end the playback with ABORTED; the report's
    ``signal`` tells which. In the main thread their handlers are replaced meanwhile.

    Args:
        trajectory: Motion to play; its joints are matched to the calibration by name.
        board: A board from :func:`hardware.connect`.
        calibration: A :class:`hardware.JointMap`, its TOML file, or None for ideal servos.
        speed: Time scale: 0.5 plays at half speed.
        tolerances: Deviations that end the playback.
        park: True to ease out to the calibration's safe pose after a success.
        loops: Number of times to play, from the last posture back to the first in between; None to play until stopped.
        on_stop: Fate of the arm when the playback ends early, see :class:`hardware.OnStop`. After ``"hold"`` it
            is driven until the board is closed, as long as its status is read: see :func:`hardware.keep_holding`.
        log_file: File for a log of every status, ending in ``.csv`` or ``.npz``; None for none.
        progress: Function that is called with the fraction done, 0 to 1.
        watch: Function that is called with every row of the log, such as a display. Like ``progress`` it runs in
            a thread of its own, so that it may be slow.

    Returns:
        The report, whose result says how the playback ended. A trajectory that the calibration forbids moves nothing
        and gives LIMIT.

    Raises:
        CalibrationError: The calibration is invalid or lacks a joint.
        BoardError: The board refuses.
        FileFormatError: The log's name has another ending.
        OSError: The log cannot be written there.
        ValueError: The speed is not a positive number, or loops is not 1 or more.
    """
    if not (speed > 0 and math.isfinite(speed)):
        raise ValueError(f"speed needs to be a number above 0; got {speed!r}")
    if loops is not None and loops < 1:
        raise ValueError(f"loops needs to be 1 or more, or None to play until stopped; got {loops!r}")
    joints, on_stop = _joint_map(calibration, trajectory), OnStop(on_stop)
    watchers = [] if watch is None else [watch]
    with stop_signals() as signals, ExitStack() as stack:
        log = None if log_file is None else stack.enter_context(PlayLogFile(log_file, trajectory.joint_names))
        watchers += [] if log is None else [log.add]
        reporter = stack.enter_context(Reporter(progress or _ignore, lambda row: _tell(watchers, row), board.clock))
        stack.enter_context(sending_first(board.clock))
        playback = Playback(board, joints, tolerances, reporter.progress, reporter.watch)
        result, message, number = PlayResult.ABORTED, "", None
        try:
            with signals.raising():
                playback.run(trajectory, speed, park, loops)
            result, message = PlayResult.SUCCESS, PlayResult.SUCCESS.message
        except EndedEarly as end:
            result, message = end.result, str(end)
        except LinkError as error:
            result, message = PlayResult.LINK_LOST, str(error)
        except ServoError as error:
            result, message = PlayResult.SERVO_FAULT, str(error)
        except StopSignal as stop:
            result, message, number = PlayResult.ABORTED, str(stop), stop.number
        except KeyboardInterrupt:
            result, message = PlayResult.ABORTED, "stopped on request"
        finally:
            known = 0 if signals.first is None else 1
            end_with = OnStop.RELEASE if result is PlayResult.SUCCESS else on_stop
            playback.finish(end_with, lambda: signals.count > known)
    if log is not None and log.trouble is not None:
        playback.warnings.append(log.trouble)
    return PlayReport(
        result=result,
        message=message,
        log=playback.recorder.log(),
        tracking=playback.recorder.tracking(),
        board=board.name,
        speed=speed,
        duration=board.clock.now() - playback.began_s,
        warnings=tuple(playback.warnings),
        held=playback.held,
        signal=number,
    )


def go_to_safe_pose(
    board: Board,
    calibration: JointMap | str | os.PathLike[str],
    *,
    on_stop: OnStop | str = OnStop.RELEASE,
    progress: Callable[[float], None] | None = None,
) -> PlayReport:
    """Ease from wherever the arm stands to the calibration's safe pose, and release it there.

    Args:
        board: A board from :func:`hardware.connect`.
        calibration: A :class:`hardware.JointMap` or its TOML file.
        on_stop: Fate of the arm if it does not get there, as in :func:`play`.
        progress: Function that is called with the fraction done, 0 to 1.

    Returns:
        The report, as of :func:`play`.
    """
    joints = calibration if isinstance(calibration, JointMap) else load_joint_map(calibration)
    there = Trajectory(np.zeros(1), joints.column("safe")[None], joints.names, arm_name=joints.robot)
    return play(there, board, joints, park=False, on_stop=on_stop, progress=progress)


def _ignore(fraction: float) -> None:
    """Report progress to nobody."""


def _tell(watchers: list[Callable[[LogRow], None]], row: LogRow) -> None:
    for watcher in watchers:
        watcher(row)


def _joint_map(calibration: JointMap | str | os.PathLike[str] | None, trajectory: Trajectory) -> JointMap:
    """Return the calibration of the trajectory's joints."""
    if calibration is None:
        return ideal_joint_map(trajectory.joint_names)
    whole = calibration if isinstance(calibration, JointMap) else load_joint_map(calibration)
    return whole.select(trajectory.joint_names)
