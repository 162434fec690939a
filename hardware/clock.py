"""Time, so that playback can run against the wall or, in tests and dry runs, as fast as it computes."""

import time
from typing import Protocol, runtime_checkable


@runtime_checkable
class Clock(Protocol):
    """What a player and a simulated board need of time."""

    def now(self) -> float:
        """Seconds since some fixed moment; never goes back."""
        ...

    def sleep(self, seconds: float) -> None:
        """Lets time pass."""
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
    """Time that passes only while someone sleeps: the same run gives the same log, in no time."""

    def __init__(self) -> None:
        self._now = 0.0

    def now(self) -> float:
        """See :class:`Clock`."""
        return self._now

    def sleep(self, seconds: float) -> None:
        """See :class:`Clock`."""
        self._now += max(0.0, seconds)
