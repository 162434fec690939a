"""The port through which the makers' SDKs send: any transport, on any clock.

The SDKs' own ports open a second time what another program holds, keep late answers, and wait by the wall clock only.
"""

from collections.abc import Sequence

from hardware.clock import Clock
from hardware.transport import Transport

_LATENCY_S = 0.024  # of a USB adapter, which may keep bytes for 16 ms; the SDKs wait for 34, and then do not ask again
_POLL_S = 0.0005


class SdkPort:
    """Port with the methods that the packet handlers of dynamixel-sdk and feetech-servo-sdk call.

    Args:
        transport: Stream of bytes to the servos.
        clock: Clock of the host.

    Attributes:
        is_using: True while a packet is under way; set by the SDKs.
    """

    def __init__(self, transport: Transport, clock: Clock) -> None:
        self.is_using = False
        self._transport, self._clock = transport, clock
        self._arrived = b""
        self._deadline_s = 0.0

    def clearPort(self) -> None:
        """Drop what has arrived: answers to earlier questions."""
        self._arrived = b""
        while self._transport.read():
            pass

    def writePort(self, packet: Sequence[int]) -> int:
        """Send a packet and return its length."""
        self._transport.write(bytes(packet))
        return len(packet)

    def readPort(self, length: int) -> bytes:
        """Return up to so many of the bytes that have arrived."""
        self._arrived += self._transport.read()
        length = max(0, length)
        taken, self._arrived = self._arrived[:length], self._arrived[length:]
        return taken

    def setPacketTimeout(self, packet_length: int) -> None:
        """Wait from now for an answer of so many bytes."""
        self._deadline_s = self._clock.now() + packet_length * self._transport.byte_s + _LATENCY_S

    def setPacketTimeoutMillis(self, msec: float) -> None:
        """Wait from now for so many milliseconds."""
        self._deadline_s = self._clock.now() + 1e-3 * msec

    def isPacketTimeout(self) -> bool:
        """Return True if the time to wait is over; otherwise let a little time pass."""
        if self.timed_out:
            return True
        self._clock.sleep(_POLL_S)
        return False

    @property
    def timed_out(self) -> bool:
        """True if the time to wait is over."""
        return self._clock.now() > self._deadline_s

    def close(self) -> None:
        """Close the transport."""
        self._transport.close()
