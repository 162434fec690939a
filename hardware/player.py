"""Playing a trajectory on a board.

1. Check the whole trajectory: joints, limits, rates. Nothing moves if anything is wrong.
2. Read the present posture; refuse if it is too far away, else ease in on a minimum-jerk curve.
3. Play: keep the board's queue filled, log, check tolerances.
4. Hold until the goal is reached, ease out to the safe pose, and release, however the playback went.
"""

import math
import os
from collections.abc import Callable

from hardware.board import Board
from hardware.errors import LinkError
from hardware.joint_map import JointMap, ideal_joint_map
from hardware.joint_map_file import load_joint_map
from hardware.playback import DEFAULT_TOLERANCES, EndedEarly, Playback, Tolerances
from hardware.report import PlayReport, PlayResult, tracking_error
from jaxik.trajectories import Trajectory


def play(
    trajectory: Trajectory,
    board: Board,
    calibration: JointMap | str | os.PathLike[str] | None = None,
    *,
    speed: float = 1.0,
    tolerances: Tolerances = DEFAULT_TOLERANCES,
    park: bool = True,
    progress: Callable[[float], None] | None = None,
) -> PlayReport:
    """Play a trajectory and report how it went.

    Ctrl-C stops the arm within a servo frame and ends the playback with ABORTED.

    Args:
        trajectory: Motion to play; its joints are matched to the calibration by name.
        board: A board from :func:`hardware.connect`.
        calibration: A :class:`hardware.JointMap`, its TOML file, or None for ideal servos.
        speed: Time scale: 0.5 plays at half speed.
        tolerances: Deviations that end the playback.
        park: True to ease out to the calibration's safe pose after a success.
        progress: Function that is called with the fraction done, 0 to 1.

    Returns:
        The report, whose result says how the playback ended. A trajectory that the calibration forbids moves nothing
        and gives LIMIT.

    Raises:
        CalibrationError: The calibration is invalid or lacks a joint.
        BoardError: The board refuses.
        ValueError: The speed is not a positive number.
    """
    if not (speed > 0 and math.isfinite(speed)):
        raise ValueError(f"speed needs to be a number above 0; got {speed!r}")
    joints = _joint_map(calibration, trajectory)
    playback = Playback(board, joints, tolerances, progress or (lambda fraction: None))
    try:
        playback.run(trajectory, speed, park)
        result, message = PlayResult.SUCCESS, PlayResult.SUCCESS.message
    except EndedEarly as end:
        result, message = end.result, str(end)
    except LinkError as error:
        result, message = PlayResult.LINK_LOST, str(error)
    except KeyboardInterrupt:
        result, message = PlayResult.ABORTED, "stopped on request"
    finally:
        playback.release()
    log = playback.log()
    return PlayReport(
        result=result,
        message=message,
        log=log,
        tracking=tracking_error(log),
        board=board.name,
        speed=speed,
        duration=board.clock.now() - playback.began_s,
        warnings=tuple(playback.warnings),
    )


def _joint_map(calibration: JointMap | str | os.PathLike[str] | None, trajectory: Trajectory) -> JointMap:
    """Return the calibration of the trajectory's joints."""
    if calibration is None:
        return ideal_joint_map(trajectory.joint_names)
    whole = calibration if isinstance(calibration, JointMap) else load_joint_map(calibration)
    return whole.select(trajectory.joint_names)
