"""Transports of bytes to a board and back: a serial port, or a modeled board in memory."""

import contextlib
import errno
import os
from typing import Any, Protocol, runtime_checkable

from hardware.clock import Clock
from hardware.errors import BoardError, LinkError

_LOST = "the link to the board is gone ({}); is the cable or radio link still there, and the board powered?"


@runtime_checkable
class Transport(Protocol):
    """A two-way stream of bytes.

    Attributes:
        byte_s: Time that one byte takes [s].
    """

    byte_s: float

    def write(self, data: bytes) -> None:
        """Send bytes without waiting until they are out.

        Raises:
            LinkError: The link is gone.
        """
        ...

    def read(self) -> bytes:
        """Return the bytes that have arrived, without waiting for more.

        Raises:
            LinkError: The link is gone.
        """
        ...

    def close(self) -> None:
        """Close the link; a second call does nothing."""
        ...


@runtime_checkable
class Peer(Protocol):
    """The other end of a transport in memory; it advances only when told to."""

    def run(self, until_us: int) -> None:
        """Advance to a time [µs] since the transport was made."""
        ...

    def receive(self, data: bytes) -> None:
        """Take bytes from the host, now."""
        ...

    def take(self) -> bytes:
        """Return the bytes sent since the last call."""
        ...


class MemoryTransport:
    """Transport to a modeled board, which catches up with the clock at every call.

    Args:
        peer: Modeled board.
        clock: Clock that the board lives by.
        unplugged_at_s: Time at which the link dies, as a fault to test with [s]; None for never.
    """

    byte_s = 0.0

    def __init__(self, peer: Peer, clock: Clock, unplugged_at_s: float | None = None) -> None:
        self._peer, self._clock, self._began_s = peer, clock, clock.now()
        self._dies_s = None if unplugged_at_s is None else self._began_s + unplugged_at_s

    def write(self, data: bytes) -> None:
        """See :class:`Transport`."""
        self._catch_up()
        self._peer.receive(data)

    def read(self) -> bytes:
        """See :class:`Transport`."""
        self._catch_up()
        return self._peer.take()

    def close(self) -> None:
        """See :class:`Transport`."""

    def _catch_up(self) -> None:
        now = self._clock.now()
        self._peer.run(round((now - self._began_s) * 1e6))
        if self._dies_s is not None and now >= self._dies_s:
            raise LinkError(_LOST.format("unplugged"))


class SerialTransport:
    """Serial port, through pyserial; no other program can open it meanwhile.

    Args:
        port: Name of the port, such as ``/dev/ttyUSB0`` or ``COM3``.
        baud: Bits per second: 115200 on a wire, 57600 through a Bluetooth module.

    Raises:
        BoardError: The port cannot be opened; with likely causes and the ports that exist.
    """

    def __init__(self, port: str, baud: int = 115_200) -> None:
        self._errors, self._port = _open(port, baud)
        self.byte_s = 10 / baud  # with start and stop bit

    @property
    def descriptor(self) -> int | None:
        """File descriptor of the port, for another process; None on systems without."""
        return getattr(self._port, "fd", None)

    def write(self, data: bytes) -> None:
        """See :class:`Transport`."""
        try:
            self._port.write(data)
        except self._errors as error:
            raise LinkError(_LOST.format(error)) from error

    def read(self) -> bytes:
        """See :class:`Transport`."""
        try:  # a port that vanishes raises SerialException in some calls and plain OSError in others
            return self._port.read(self._port.in_waiting)
        except self._errors as error:
            raise LinkError(_LOST.format(error)) from error

    def close(self) -> None:
        """See :class:`Transport`."""
        for step in (lambda: _claim(self._port, False), self._port.close):
            with contextlib.suppress(*self._errors):  # a port that is gone is closed
                step()


def _open(port: str, baud: int):
    """Return the exceptions that calls of the port raise, and the open port."""
    try:
        import serial
    except ImportError as error:
        raise BoardError("serial ports need pyserial: pip install pyserial") from error
    if baud <= 0:
        raise BoardError(f"{port} needs a rate above 0 baud; got {baud}")
    exclusive = True if os.name == "posix" else None  # on other systems every port is exclusive
    try:
        opened = serial.Serial(port, baud, timeout=0, write_timeout=1, exclusive=exclusive)
        _claim(opened, True)
        return (serial.SerialException, OSError), opened
    except (serial.SerialException, OSError, ValueError) as error:
        raise BoardError(f"{port} cannot be opened: {_cause(error)}") from error


def _claim(port: Any, on: bool) -> None:
    """Keep programs out that ignore pyserial's lock, or let them in again."""
    if os.name == "posix":
        import fcntl
        import termios

        fcntl.ioctl(port.fileno(), termios.TIOCEXCL if on else termios.TIOCNXCL)


def _cause(error: Exception) -> str:
    """Return why a port does not open, and what to do."""
    number = getattr(error, "errno", None)
    if number in (errno.EAGAIN, errno.EBUSY):
        return "does another program hold it (another jaxik, a serial monitor)? Close that first"
    if number == errno.ENOENT:
        return f"there is no such port; {_ports()}"
    if number in (errno.EACCES, errno.EPERM):
        return "you may not use it; join its group (sudo usermod -aG dialout $USER), log out and in again"
    return f"{error}; is the name right ({_ports()}), may you use it, and does another program hold it?"


def _ports() -> str:
    """Return the names of the existing ports, in words."""
    from serial.tools import list_ports

    names = sorted(port.device for port in list_ports.comports())
    return f"there are {', '.join(names)}" if names else "there is none now: is the board plugged in?"
