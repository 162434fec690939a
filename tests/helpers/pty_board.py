"""The firmware's binary behind a pseudo-terminal, in the time of the wall, for the few tests that need a real port."""

import contextlib
import os
import threading
import time
import tty

from tests.helpers.firmware import Bench


class PtyBoard(threading.Thread):
    """Runs a bench and carries bytes until closed. A host that opens :attr:`port` finds an Arduino there."""

    def __init__(self, board: Bench) -> None:
        super().__init__(daemon=True)
        self.board = board
        self._master, self._slave = os.openpty()  # the slave stays open, so that nobody hangs up when the host does
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)
        self._going, self._lock = True, threading.Lock()
        self.start()

    def run(self) -> None:
        """Keeps the board's time to the wall's."""
        began = time.monotonic() - self.board.now_us * 1e-6
        while self._going:
            with self._lock, contextlib.suppress(OSError):
                self.board.run(int((time.monotonic() - began) * 1e6))
                with contextlib.suppress(BlockingIOError):
                    self.board.receive(os.read(self._master, 4096))
                if answer := self.board.take():
                    os.write(self._master, answer)
            time.sleep(0.001)

    def vanish(self) -> None:
        """As when the plug is pulled."""
        with self._lock:
            self._going = False
            os.close(self._slave)
            os.close(self._master)

    def close(self) -> None:
        """Ends the thread."""
        self._going = False
        self.join()
