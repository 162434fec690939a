"""Clocks: playback runs in wall time or, in tests and dry runs, as fast as it computes."""

import time
from typing import Protocol, runtime_checkable


@runtime_checkable
class Clock(Protocol):
    """The time that a player, a board and its transport share."""

    def now(self) -> float:
        """Return the time since a fixed moment [s]; it never goes back."""
        ...

    def sleep(self, seconds: float) -> None:
        """Let time pass.

        Args:
            seconds: Duration [s]; zero or below returns at once.
        """
        ...


class WallClock:
    """The computer's own monotonic clock."""

    def now(self) -> float:
        """See :class:`Clock`."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """See :class:`Clock`."""
        time.sleep(max(0.0, seconds))


class VirtualClock:
    """A clock that advances only in :meth:`sleep`: a minute takes milliseconds, and every run gives the same log."""

    def __init__(self) -> None:
        self._now = 0.0

    def now(self) -> float:
        """See :class:`Clock`."""
        return self._now

    def sleep(self, seconds: float) -> None:
        """See :class:`Clock`."""
        self._now += max(0.0, seconds)
