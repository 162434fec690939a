"""The Enter key, noticed without waiting for it."""

import contextlib
import sys
import threading


class EnterKey:
    """Enter in the terminal; without one it is never pressed.

    Attributes:
        available: True if there is a terminal.
    """

    def __init__(self) -> None:
        self.available = sys.stdin is not None and sys.stdin.isatty()
        self._lines = 0
        if self.available:
            threading.Thread(target=self._read, name="jaxik-enter", daemon=True).start()

    def pressed(self) -> bool:
        """Return True once for each time that it was pressed."""
        if not self._lines:
            return False
        self._lines -= 1
        return True

    def _read(self) -> None:
        with contextlib.suppress(OSError, ValueError):  # of a terminal that is closed
            while sys.stdin.readline():
                self._lines += 1
