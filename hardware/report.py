"""What a playback returns: how it ended, what was commanded and measured, how well the joints followed."""

import enum
from dataclasses import dataclass, field
from typing import Any

import numpy as np


class PlayResult(enum.Enum):
    """How a playback ended."""

    SUCCESS = "the whole trajectory was played and the goal reached"
    PATH_TOLERANCE = "a joint strayed too far from its command"
    GOAL_TOLERANCE = "a joint did not settle at the goal in time"
    UNDERRUN = "waypoints reached the board too late or not at all"
    LINK_LOST = "the board, or a servo on it, stopped answering"
    LIMIT = "the trajectory leaves the calibration's limits, rates or reach; nothing was moved beyond them"
    ABORTED = "stopped before the end"


@dataclass(frozen=True)
class PlayLog:
    """Commanded and measured joint angles over the playback.

    Attributes:
        time: Since the start of the playback, ``(N,)`` [s].
        phase: ``"ease in"``, ``"play"`` or ``"hold"`` per row.
        commanded: ``(N, joint)`` [rad].
        measured: ``(N, joint)`` [rad]; nan where a servo reports nothing.
        joint_names: Names.
    """

    time: np.ndarray
    phase: tuple[str, ...]
    commanded: np.ndarray
    measured: np.ndarray
    joint_names: tuple[str, ...]


@dataclass(frozen=True)
class Tracking:
    """How well the joints followed while the trajectory played; nan where a servo reports nothing.

    A measurement may be as old as the board's ``readback_s``; the age counts as error here.

    Attributes:
        rms: Root mean square of measured minus commanded, ``(joint,)`` [rad].
        worst: Greatest absolute value, ``(joint,)`` [rad].
    """

    rms: np.ndarray
    worst: np.ndarray


@dataclass(frozen=True)
class PlayReport:
    """The outcome of :func:`hardware.play`.

    Attributes:
        result: How it ended.
        message: One sentence with numbers and the next step to take.
        log: What was commanded and measured.
        tracking: How well the joints followed.
        board: Which board.
        speed: Speed scale.
        duration: Time from the first command to the release [s], by the board's clock.
        warnings: What to know, one sentence each.
    """

    result: PlayResult
    message: str
    log: PlayLog
    tracking: Tracking
    board: str
    speed: float
    duration: float
    warnings: tuple[str, ...] = field(default=())

    @property
    def ok(self) -> bool:
        """Whether it succeeded."""
        return self.result is PlayResult.SUCCESS

    def summary(self) -> dict[str, Any]:
        """The essentials as plain values, for a program to read."""
        worst = dict(zip(self.log.joint_names, map(_plain, self.tracking.worst), strict=True))
        return {
            "result": self.result.name,
            "message": self.message,
            "board": self.board,
            "speed": self.speed,
            "duration": self.duration,
            "log_rows": len(self.log.time),
            "worst_tracking_rad": worst,
            "warnings": list(self.warnings),
        }


def tracking(log: PlayLog) -> Tracking:
    """Tracking error of the rows in which the trajectory itself played."""
    rows = np.array([phase == "play" for phase in log.phase], bool)
    error = np.abs(log.measured - log.commanded)[rows]
    joints = len(log.joint_names)
    if not len(error):
        return Tracking(np.full(joints, np.nan), np.full(joints, np.nan))
    return Tracking(np.sqrt(np.mean(error**2, axis=0)), np.max(error, axis=0))


def _plain(value: float) -> float | None:
    """Numbers as JSON has them."""
    return float(value) if np.isfinite(value) else None
