"""The queue of an executor: waypoints ahead, and straight lines between them."""

from collections.abc import Sequence
from typing import NamedTuple

TIMES = 2**32  # times wrap, as on a board
_AHEAD = TIMES // 2  # differences below are positive


def signed_us(difference: int) -> int:
    """Return a difference of times [µs] as the board computes it, in 32 bits with a sign."""
    return (difference + TIMES // 2) % TIMES - TIMES // 2


class Entry(NamedTuple):
    """Waypoint in the queue.

    Attributes:
        time: Motion time, 32 bits [µs].
        values: Raw value per joint.
    """

    time: int
    values: tuple[int, ...]


class WaypointQueue:
    """Waypoints ahead and the one passed last; its length is the number of those ahead."""

    def __init__(self) -> None:
        self._ahead: list[Entry] = []
        self._passed = Entry(0, ())

    def __len__(self) -> int:
        return len(self._ahead)

    @property
    def passed(self) -> Entry:
        """The waypoint passed last."""
        return self._passed

    @property
    def newest(self) -> Entry:
        """The waypoint queued last, or passed last if none is ahead."""
        return self._ahead[-1] if self._ahead else self._passed

    def begin(self, values: Sequence[int]) -> None:
        """Let a motion begin at a posture, in raw values, at time zero."""
        self._passed = Entry(0, tuple(values))

    def append(self, entry: Entry) -> None:
        """Queue a waypoint."""
        self._ahead.append(entry)

    def clear(self) -> None:
        """Drop the waypoints ahead."""
        self._ahead.clear()

    def advance(self, time: int) -> None:
        """Pass the waypoints up to a motion time [µs]."""
        while self._ahead and signed_us(self._ahead[0].time - time) <= 0:
            self._passed = self._ahead.pop(0)

    def at_time(self, joint: int, time: int) -> int:
        """Return a joint's value at a motion time [µs], in sixteenths; behind the newest waypoint it stays there.

        Args:
            joint: Place of the joint.
            time: Motion time [µs], counted in steps of 16 µs as the firmware does.
        """
        before = self._passed
        for entry in self._ahead:
            if 0 < (entry.time - time) % TIMES < _AHEAD:
                part, whole = (time - before.time) % TIMES >> 4, (entry.time - before.time) % TIMES >> 4
                if part == whole:
                    return entry.values[joint] * 16
                fraction = (part << 16) // whole
                start = before.values[joint]
                return start * 16 + ((entry.values[joint] - start) * fraction >> 12)
            before = entry
        return before.values[joint] * 16
