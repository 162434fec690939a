"""Results of a playback: how it ended, what was commanded and measured, how well the joints followed."""

import enum
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

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
    SERVO_FAULT = 7

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
    PlayResult.SERVO_FAULT: "a servo reports a fault of its own; remove its cause, switch its supply off and on, and "
    "play again",
}


_LOG_ROWS = 20_000


class LogRow(NamedTuple):
    """One status of a playback.

    Attributes:
        time: Time since the start of the playback [s].
        phase: ``"ease in"``, ``"play"``, ``"hold"``, ``"ease out"`` or ``"lower"``.
        commanded: Commanded joint angles, ``(joint,)`` [rad].
        measured: Measured joint angles, ``(joint,)`` [rad]; nan for servos without read-back.
    """

    time: float
    phase: str
    commanded: np.ndarray
    measured: np.ndarray


@dataclass(frozen=True)
class PlayLog:
    """Commanded and measured joint angles over a playback.

    It has the latest 20 000 rows, of a quarter of an hour; ``log_file=`` of :func:`hardware.play` writes all of them.

    Attributes:
        time: Time since the start of the playback, ``(N,)`` [s].
        phase: ``"ease in"``, ``"play"``, ``"hold"``, ``"ease out"`` or ``"lower"`` per row.
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
        held: True if the servos are still driven, as ``on_stop="hold"`` asks for.
        signal: Number of the signal that ended the playback; None for none.
    """

    result: PlayResult
    message: str
    log: PlayLog
    tracking: Tracking
    board: str
    speed: float
    duration: float
    warnings: tuple[str, ...] = field(default=())
    held: bool = False
    signal: int | None = None

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
            "held": self.held,
            "worst_tracking_rad": worst,
            "warnings": list(self.warnings),
        }


class Recorder:
    """Log and tracking error of a playback, as its rows come, in constant memory.

    Args:
        joint_names: Joint names in order.
    """

    def __init__(self, joint_names: tuple[str, ...]) -> None:
        self._names = joint_names
        self._rows: deque[LogRow] = deque(maxlen=_LOG_ROWS)
        self._count, self._squares, self._worst = 0, np.zeros(len(joint_names)), np.zeros(len(joint_names))

    def add(self, row: LogRow) -> None:
        """Add a row; its tracking error counts while the trajectory itself plays."""
        self._rows.append(row)
        if row.phase == "play":
            error = np.abs(row.measured - row.commanded)
            self._count += 1
            self._squares += error**2
            self._worst = np.maximum(self._worst, error)

    def log(self) -> PlayLog:
        """Return the latest rows."""
        joints = len(self._names)
        times, phases, commanded, measured = zip(*self._rows, strict=True) if self._rows else ((), (), (), ())
        return PlayLog(
            np.array(times, float),
            tuple(phases),
            np.array(commanded, float).reshape(-1, joints),
            np.array(measured, float).reshape(-1, joints),
            self._names,
        )

    def tracking(self) -> Tracking:
        """Return the tracking error of all rows."""
        if not self._count:
            return Tracking(np.full(len(self._names), np.nan), np.full(len(self._names), np.nan))
        return Tracking(np.sqrt(self._squares / self._count), self._worst.copy())


def _plain(value: float) -> float | None:
    """Return a number as JSON has it: None for nan and infinity."""
    return float(value) if np.isfinite(value) else None
