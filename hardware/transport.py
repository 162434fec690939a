"""Bytes to a board and back: a serial port, or a modelled board in memory."""

import contextlib
import os
from typing import Protocol, runtime_checkable

from hardware.clock import Clock
from hardware.errors import BoardError, LinkError

_LOST = "the link to the board is gone ({}); is the cable or radio link still there, and the board powered?"


@runtime_checkable
class Transport(Protocol):
    """A way for bytes."""

    byte_s: float  # how long one byte takes [s]

    def write(self, data: bytes) -> None:
        """Sends; does not wait for them to be out."""
        ...

    def read(self) -> bytes:
        """Whatever has come; does not wait."""
        ...

    def close(self) -> None:
        """Ends the link; harmless when repeated."""
        ...


@runtime_checkable
class Peer(Protocol):
    """The other end of a transport in memory, which lives in the same time."""

    def run(self, until_us: int) -> None:
        """Lives until a time [µs]."""
        ...

    def receive(self, data: bytes) -> None:
        """Takes bytes, now."""
        ...

    def take(self) -> bytes:
        """Bytes it has sent since the last call."""
        ...


class MemoryTransport:
    """Leads to a modelled board that catches up with the clock whenever it is spoken to.

    Args:
        peer: The board.
        clock: Whose time it lives in.
        unplugged_at_s: When the link dies, as a fault to test with; None for never.
    """

    byte_s = 0.0

    def __init__(self, peer: Peer, clock: Clock, unplugged_at_s: float | None = None) -> None:
        self._peer, self._clock, self._began = peer, clock, clock.now()
        self._dies = None if unplugged_at_s is None else self._began + unplugged_at_s

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
        self._peer.run(round((now - self._began) * 1e6))
        if self._dies is not None and now >= self._dies:
            raise LinkError(_LOST.format("unplugged"))


class SerialTransport:
    """A serial port through pyserial.

    Args:
        port: Its name, such as ``/dev/ttyUSB0`` or ``COM3``.
        baud: Bits a second: 115200 on a wire, 57600 through a Bluetooth module.

    Raises:
        BoardError: It cannot be opened; with likely causes and the ports there are.
    """

    def __init__(self, port: str, baud: int = 115_200) -> None:
        self._errors, self._port = _open(port, baud)
        self.byte_s = 10 / baud  # with start and stop bit

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
        with contextlib.suppress(*self._errors):  # gone already is what was wanted
            self._port.close()


def _open(port: str, baud: int):
    """The open port, and what its calls raise."""
    try:
        import serial
    except ImportError as error:
        raise BoardError("serial ports need pyserial: pip install pyserial") from error
    exclusive = True if os.name == "posix" else None  # elsewhere ports are exclusive anyway
    try:
        opened = serial.Serial(port, baud, timeout=0, write_timeout=1, exclusive=exclusive)
        return (serial.SerialException, OSError), opened
    except (serial.SerialException, OSError, ValueError) as error:
        raise BoardError(
            f"{port} cannot be opened: {error}; is the name right ({_ports()}), may you use it (group dialout), "
            "and does another program hold it?"
        ) from error


def _ports() -> str:
    """The ports there are, in words."""
    from serial.tools import list_ports

    names = sorted(port.device for port in list_ports.comports())
    return f"there are {', '.join(names)}" if names else "there is none now: is the board plugged in?"
