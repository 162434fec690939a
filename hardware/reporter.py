"""Calls of a playback's functions, away from the thread that sends.

A progress bar on a stalled terminal, a plot or a full disk may take longer than the board tolerates silence.
"""

import threading
from collections import deque
from collections.abc import Callable
from types import TracebackType

from hardware.clock import Clock, VirtualClock
from hardware.report import LogRow

_PATIENCE_S = 5.0  # for the functions to take the last rows


class Reporter:
    """Calls of functions in a thread of their own; in virtual time, where nothing can be late, at once.

    An exception of a function is raised by the next call. To be used in a ``with`` statement.

    Args:
        progress: Function of the fraction done; called with the latest one, others may be left out.
        watch: Function of a row of the log; called with every one.
        clock: Clock of the playback.
    """

    def __init__(self, progress: Callable[[float], None], watch: Callable[[LogRow], None], clock: Clock) -> None:
        self._call_progress, self._call_watch = progress, watch
        self._at_once = isinstance(clock, VirtualClock)
        self._rows: deque[LogRow] = deque()
        self._fraction: float | None = None
        self._error: BaseException | None = None
        self._ended = False
        self._change = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="jaxik-report", daemon=True)

    def progress(self, fraction: float) -> None:
        """Report the fraction done."""
        if self._at_once:
            self._call_progress(fraction)
            return
        with self._change:
            self._fraction = fraction
            self._change.notify()
        self._complain()

    def watch(self, row: LogRow) -> None:
        """Report a row of the log."""
        if self._at_once:
            self._call_watch(row)
            return
        with self._change:
            self._rows.append(row)
            self._change.notify()
        self._complain()

    def __enter__(self) -> "Reporter":
        """Start the thread."""
        if not self._at_once:
            self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Wait until everything is reported, but not for ever."""
        if self._at_once:
            return
        with self._change:
            self._ended = True
            self._change.notify()
        self._thread.join(_PATIENCE_S)

    def _complain(self) -> None:
        error, self._error = self._error, None
        if error is not None:
            raise error

    def _run(self) -> None:
        while True:
            with self._change:
                self._change.wait_for(lambda: self._rows or self._fraction is not None or self._ended)
                rows, fraction = list(self._rows), self._fraction
                self._rows.clear()
                self._fraction = None
            if not rows and fraction is None:
                return
            try:
                for row in rows:
                    self._call_watch(row)
                if fraction is not None:
                    self._call_progress(fraction)
            except BaseException as error:
                self._error = error
