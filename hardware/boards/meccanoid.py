"""A Meccanoid's own eight servos over Bluetooth LE. Experimental: not yet tried on a robot.

Known from published observations: one frame of 20 bytes each way, whose last two are the sum of the others; no time
stamps, no sequence numbers, no known watchdog; a pose always carries all eight positions; answers get lost unless only
one request at a time is in flight.
"""

import struct
from collections.abc import Collection, Sequence
from typing import Protocol, runtime_checkable

from hardware.boards.host_timed_board import HostTimedBoard, bus_id
from hardware.clock import Clock
from hardware.errors import BoardError, LinkError
from hardware.joint_map import JointCalibration

SERVOS, FRAME_BYTES, PAYLOAD_BYTES = 8, 20, 17
_STATUS, _SET_POSES, _GET_POSES, _SERVO_MODE, _WHEELS, _PIN = 0x01, 0x08, 0x09, 0x0B, 0x0D, 0x1A
_DRIVE_MODE, _READ_MODE = 2, 4
_ANSWER_S, _YELLOW_BUTTON_S = 0.15, 30.0
_KEEP_ALIVE_S = 0.5  # period at which the vendor's program asks for the status
_REFUSED = b"\x00\x01\xff"


@runtime_checkable
class Exchange(Protocol):
    """Requests and answers, one at a time."""

    def ask(self, frame: bytes, answer_s: float) -> bytes | None:
        """Send a frame and return the answer to it, or None if there is none in time.

        Args:
            frame: Request.
            answer_s: Time to wait [s].
        """
        ...

    def close(self) -> None:
        """Close the link; a second call does nothing."""
        ...


def frame(operation: int, payload: bytes = b"") -> bytes:
    """Return a frame: operation, payload padded with zeros, sum."""
    body = bytes((operation,)) + payload.ljust(PAYLOAD_BYTES, b"\0")
    return body + struct.pack(">H", sum(body))


def content(data: bytes, operation: int) -> bytes | None:
    """Return the payload of an answer, or None if it is garbled or of another operation."""
    valid = len(data) == FRAME_BYTES and data[0] == operation and struct.pack(">H", sum(data[:-2])) == data[-2:]
    return data[1:-2] if valid else None


class MeccanoidBoard(HostTimedBoard):
    """A Meccanoid G15KS's own controller; a joint's channel is its servo's slot, 0 to 7, raw values are 24 to 232.

    The slots' joints differ from robot to robot: calibrate. Servos go limp all together or not at all.

    Args:
        address: Bluetooth address of the robot.
        clock: Clock of the host; None for the computer's.
        exchange: Exchange to use instead of Bluetooth, for tests.

    Raises:
        BoardError: The package bleak is missing, or the robot refuses the connection.
        LinkError: The robot does not answer.
    """

    readback_s = 0.8
    poll_s = 0.1  # a pose and an answer; shorter periods have not been tried
    hiccup_us = 500_000  # two lost answers

    def __init__(self, address: str = "", *, clock: Clock | None = None, exchange: Exchange | None = None) -> None:
        super().__init__(f"meccanoid:{address}", clock)
        if exchange is None:
            from hardware.boards.bluetooth import BluetoothExchange

            exchange = BluetoothExchange(address)
        self._exchange = exchange
        self._pose = [128] * SERVOS
        self._alive_s = self.clock.now()
        answer = self._request(_PIN, b"\x01\x00\x01", _YELLOW_BUTTON_S)
        if answer is None:
            raise LinkError(f"{self.name} does not answer; is it on, near, and was its yellow button pressed?")
        if answer.startswith(_REFUSED):
            raise BoardError(f"{self.name} refuses the connection; press its yellow button and try again")
        self._request(_WHEELS, b"\0\0\0\0\xff\xff")

    def _servo_id(self, joint: JointCalibration) -> int:
        return bus_id(joint, 0, SERVOS - 1)

    def _prepare(self, ids: Sequence[int]) -> None:
        self._drive_surely(ids, False)
        self._note_pose()

    def _note_pose(self) -> None:
        """Read the positions of all eight servos: every pose sets all, also those that are no joint's."""
        for _ in range(10):
            answer = self._request(_GET_POSES)
            if answer is not None:
                self._pose = list(answer[:SERVOS])
                return
        raise LinkError(f"{self.name} does not say where its servos are; is it on its battery, not on USB power?")

    def _write(self, ids: Sequence[int], raw: Sequence[int]) -> None:
        for servo, value in zip(ids, raw, strict=True):
            self._pose[servo] = int(value)
        self._request(_SET_POSES, bytes(self._pose) + b"\x01" * (PAYLOAD_BYTES - SERVOS))

    def _read(self, ids: Sequence[int]) -> list[int] | None:
        if self.clock.now() - self._alive_s > _KEEP_ALIVE_S:
            self._alive_s = self.clock.now()
            self._request(_STATUS)
        answer = self._request(_GET_POSES)
        return None if answer is None else [answer[servo] for servo in ids]

    def _drive(self, ids: Sequence[int], on: bool) -> bool:
        mode = _DRIVE_MODE if on else _READ_MODE
        return self._request(_SERVO_MODE, bytes((mode,)) * 16) is not None

    def limp(self, joints: Collection[int]) -> None:
        """See :class:`hardware.Board`; all joints or none."""
        if joints and len(joints) < len(self._ids):
            raise BoardError("a Meccanoid's servos go limp all together; name all of its joints, or none")
        super().limp(joints)

    def _request(self, operation: int, payload: bytes = b"", answer_s: float = _ANSWER_S) -> bytes | None:
        answer = self._exchange.ask(frame(operation, payload), answer_s)
        return None if answer is None else content(answer, operation)

    def _disconnect(self) -> None:
        self._exchange.close()
