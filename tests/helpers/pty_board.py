"""The firmware's binary behind a pseudo-terminal, in wall time, for the few tests that need a real port."""

import contextlib
import os
import threading
import time
import tty

from tests.helpers.firmware import Bench


class PtyBoard(threading.Thread):
    """Thread that runs a bench until closed. A host that opens :attr:`port` finds an Arduino there."""

    def __init__(self, chip: Bench) -> None:
        super().__init__(daemon=True)
        self.chip = chip
        self._master, self._slave = os.openpty()  # the slave stays open: a host may close the port and open it again
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)
        self._going, self._lock = True, threading.Lock()
        self.start()

    def run(self) -> None:
        """Keep the chip's time equal to wall time, and carry bytes both ways."""
        began = time.monotonic() - self.chip.now_us * 1e-6
        while self._going:
            with self._lock, contextlib.suppress(OSError):
                self.chip.run(int((time.monotonic() - began) * 1e6))
                with contextlib.suppress(BlockingIOError):
                    self.chip.receive(os.read(self._master, 4096))
                if answer := self.chip.take():
                    os.write(self._master, answer)
            time.sleep(0.001)

    def vanish(self) -> None:
        """Close the port as an unplugged adapter does."""
        with self._lock:
            self._going = False
            os.close(self._slave)
            os.close(self._master)

    def close(self) -> None:
        """End the thread."""
        self._going = False
        self.join()
