"""Process beside the program that releases the servos of a board without a watchdog if the program dies or hangs.

The process shares the open port. It hears of the program with every status, and writes the farewell, which releases the
servos, once it has heard nothing for two seconds or the program is gone. It cannot help if the computer or the cable
fails. Systems without POSIX file descriptors have no such process.

This file is also the process's program, and then loads nothing but the standard library.
"""

import contextlib
import os
import select
import subprocess
import sys

PATIENCE_S = 2.0


class Guardian:
    """The program's side. It does nothing before :meth:`watch`."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None

    def watch(self, descriptor: int | None, farewell: bytes) -> None:
        """Begin to guard; the servos are going to be driven.

        Args:
            descriptor: File descriptor of the port; None if there is none.
            farewell: Bytes that release the servos; empty if none do.
        """
        if descriptor is None or not farewell or os.name != "posix":
            return
        self.close()
        command = [sys.executable, "-I", "-S", __file__, str(descriptor), farewell.hex()]
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=(descriptor,),
            start_new_session=True,  # signals to the program are not for it
        )
        assert self._process.stdin is not None
        os.set_blocking(self._process.stdin.fileno(), False)

    def beat(self) -> None:
        """Say that the program is alive."""
        self._say(b".")

    def close(self) -> None:
        """End the guard; the servos are released, or about to be."""
        process, self._process = self._process, None
        if process is None:
            return
        assert process.stdin is not None
        try:
            os.write(process.stdin.fileno(), b"q")
            process.stdin.close()
        except OSError:
            pass  # it has ended by itself
        process.wait()

    def _say(self, word: bytes) -> None:
        if self._process is None:
            return
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):  # full: it has enough to read
            os.write(self._process.stdin.fileno(), word)


def guard(port: int, farewell: bytes) -> None:
    """Release the servos when the standard input ends or falls silent, unless a ``q`` came before.

    Args:
        port: File descriptor of the port.
        farewell: Bytes that release the servos.
    """
    while True:
        heard = select.select([0], [], [], PATIENCE_S)[0]
        words = os.read(0, 4096) if heard else b""
        if words.endswith(b"q"):
            return
        if not words:
            os.write(port, farewell)
            if heard:
                return


if __name__ == "__main__":
    guard(int(sys.argv[1]), bytes.fromhex(sys.argv[2]))
