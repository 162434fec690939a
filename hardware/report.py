"""Results of a playback: how it ended, what was commanded and measured, how well the joints followed."""

import enum
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from hardware.errors import PlaybackError

if TYPE_CHECKING:
    from typing import Self


class PlayResult(enum.IntEnum):
    """Outcome of a playback."""

    SUCCESS = 0
    PATH_TOLERANCE = 1
    GOAL_TOLERANCE = 2
    UNDERRUN = 3
    LINK_LOST = 4
    LIMIT = 5
    ABORTED = 6

    @property
    def message(self) -> str:
        """One sentence: what it means and what to do."""
        return _MESSAGES[self]


_MESSAGES = {
    PlayResult.SUCCESS: "the whole trajectory was played and the goal reached",
    PlayResult.PATH_TOLERANCE: "a joint was too far from its command; free it, check its supply, or play slower",
    PlayResult.GOAL_TOLERANCE: "a joint did not reach the goal in time; check its load and supply, or allow more time",
    PlayResult.UNDERRUN: "waypoints reached the board too late or not at all; use a faster link or an idle computer",
    PlayResult.LINK_LOST: "the board, or a servo on it, stopped answering; check plugs and supply, then connect again",
    PlayResult.LIMIT: "the trajectory leaves the calibration's limits, rates or reach, and nothing was moved beyond "
    "them; change trajectory, speed or calibration",
    PlayResult.ABORTED: "stopped before the end; play again",
}


@dataclass(frozen=True)
class PlayLog:
    """Commanded and measured joint angles over a playback.

    Attributes:
        time: Time since the start of the playback, ``(N,)`` [s].
        phase: ``"ease in"``, ``"play"``, ``"hold"`` or ``"ease out"`` per row.
        commanded: Commanded joint angles, ``(N, joint)`` [rad].
        measured: Measured joint angles, ``(N, joint)`` [rad]; nan for servos without read-back.
        joint_names: Joint names in order.
    """

    time: np.ndarray
    phase: tuple[str, ...]
    commanded: np.ndarray
    measured: np.ndarray
    joint_names: tuple[str, ...]


@dataclass(frozen=True)
class Tracking:
    """Tracking error of the joints while the trajectory played; nan for servos without read-back.

    A measurement may be as old as the board's ``readback_s``; its age counts as error here.

    Attributes:
        rms: Root mean square of measured minus commanded, ``(joint,)`` [rad].
        worst: Greatest absolute value of measured minus commanded, ``(joint,)`` [rad].
    """

    rms: np.ndarray
    worst: np.ndarray


@dataclass(frozen=True)
class PlayReport:
    """Result of :func:`hardware.play`.

    Attributes:
        result: Outcome.
        message: One sentence with numbers: why it ended.
        log: Commanded and measured joint angles.
        tracking: Tracking error of the joints.
        board: Name of the board.
        speed: Time scale it was played with.
        duration: Time from the first command to the release [s], by the board's clock.
        warnings: Things to know, one sentence each.
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
        """True after a success."""
        return self.result is PlayResult.SUCCESS

    @property
    def status(self) -> PlayResult:
        """The outcome, by the name it has in every result."""
        return self.result

    def raise_if_invalid(self) -> "Self":
        """Return the report itself, so that calls chain.

        Raises:
            PlaybackError: The playback did not succeed; with how it ended and what to do.
        """
        if not self.ok:
            raise PlaybackError(
                f"playback on {self.board} ended after {self.duration:.1f} s with {self.result.name}, not SUCCESS: "
                f"{self.message} ({self.result.message})"
            )
        return self

    def summary(self) -> dict[str, Any]:
        """Return the essentials as plain values for JSON."""
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


def tracking_error(log: PlayLog) -> Tracking:
    """Return the tracking error over the rows in which the trajectory itself played."""
    rows = np.array([phase == "play" for phase in log.phase], bool)
    error = np.abs(log.measured - log.commanded)[rows]
    joints = len(log.joint_names)
    if not len(error):
        return Tracking(np.full(joints, np.nan), np.full(joints, np.nan))
    return Tracking(np.sqrt(np.mean(error**2, axis=0)), np.max(error, axis=0))


def _plain(value: float) -> float | None:
    """Return a number as JSON has it: None for nan and infinity."""
    return float(value) if np.isfinite(value) else None
