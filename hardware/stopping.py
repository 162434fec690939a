"""Fate of the arm when a motion ends before its end."""

import enum
from collections.abc import Callable
from contextlib import suppress

from hardware.board import Board
from hardware.errors import ServoError

LOWER_SPEED = 0.2  # greatest speed while lowering, as a fraction of each joint's own


class OnStop(enum.Enum):
    """Fate of the arm at Ctrl-C, SIGTERM, SIGHUP or a fault, while the link still works.

    It is at rest within a servo frame in any case. If the link is dead, or the program has been killed, only the
    board's own watchdog acts, if it has one.
    """

    RELEASE = "release"
    HOLD = "hold"
    LOWER = "lower"

    @property
    def message(self) -> str:
        """One clause: what becomes of a raised arm."""
        return _MESSAGES[self]


_MESSAGES = {
    OnStop.RELEASE: "the servos are released at once, and a raised arm falls",
    OnStop.HOLD: "the arm stays where it is, driven, until it is told to stop once more",
    OnStop.LOWER: "the arm goes slowly to its safe pose and is then released; a second Ctrl-C releases it at once",
}


def keep_holding(board: Board, until: Callable[[], bool]) -> None:
    """Keep a board that holds from releasing the arm, which it does after a silence of two seconds.

    A servo with a fault of its own is no reason to let the others fall.

    Args:
        board: Board that holds, as after a playback with ``on_stop="hold"``.
        until: Function that is asked all the time, and returns True to end.

    Raises:
        LinkError: The board stopped answering.
    """
    while not until():
        with suppress(ServoError):
            board.status()
        board.clock.sleep(board.poll_s)
