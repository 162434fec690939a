"""Signals that ask the program to stop: Ctrl-C, SIGTERM, and SIGHUP of a terminal that closes.

The first one ends the motion with an exception. The way out of it is never interrupted: further signals are counted,
and whoever lowers or holds the arm asks for them.
"""

import os
import signal
import stat
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")  # a system has some of them


class StopSignal(KeyboardInterrupt):
    """Request to stop, by a signal.

    Args:
        number: Number of the signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__(f"stopped by {signal.Signals(number).name}")
        self.number = number

    @property
    def exit_code(self) -> int:
        """Exit code of a program that ends because of it, as a shell expects it."""
        return 128 + self.number


class StopSignals:
    """Requests to stop that have come.

    Attributes:
        first: The first one; None if there was none.
        count: Number of all.
    """

    def __init__(self) -> None:
        self.first: StopSignal | None = None
        self.count = 0
        self._raises = False

    @contextmanager
    def raising(self) -> Iterator[None]:
        """Let the first request end the block with its :class:`StopSignal`; elsewhere it is only noted."""
        before, self._raises = self._raises, True
        try:
            if self.first is not None:
                raise self.first
            yield
        finally:
            self._raises = before and self.first is None

    def take(self, number: int, frame: FrameType | None = None) -> None:
        """Note a signal, as its handler.

        Args:
            number: Number of the signal.
            frame: Not used.
        """
        self.count += 1
        if self.first is None:
            self.first = StopSignal(number)
        _leave_closed_terminal()
        if self._raises:
            self._raises = False
            raise self.first


_active: StopSignals | None = None


@contextmanager
def stop_signals() -> Iterator[StopSignals]:
    """Note signals while the block runs, and then restore their handlers.

    Blocks inside one another share the outermost one's. Signals that the program ignores, as under nohup, stay ignored.
    Outside the main thread, where Python allows no handlers, nothing is ever noted.
    """
    global _active
    if threading.current_thread() is not threading.main_thread():
        yield StopSignals()
        return
    if _active is not None:
        yield _active
        return
    _active = signals = StopSignals()
    numbers = [getattr(signal, name) for name in _NAMES if hasattr(signal, name)]
    before = {number: signal.getsignal(number) for number in numbers}
    try:
        for number, handler in before.items():
            if handler is not None and handler is not signal.SIG_IGN:
                signal.signal(number, signals.take)
        yield signals
    finally:
        for number, handler in before.items():
            if handler is not None and handler is not signal.SIG_IGN:
                signal.signal(number, handler)
        _active = None


def _leave_closed_terminal() -> None:
    """Send what is printed from now on nowhere if the terminal has been closed: writing to it would be an error."""
    for descriptor in (0, 1, 2):
        try:
            if stat.S_ISCHR(os.fstat(descriptor).st_mode) and not os.isatty(descriptor):
                nowhere = os.open(os.devnull, os.O_RDWR)
                os.dup2(nowhere, descriptor)
                os.close(nowhere)
        except OSError:
            pass
