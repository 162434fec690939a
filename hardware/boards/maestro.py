"""Pololu Maestro servo controllers, in the compact protocol of their documentation: hobby servos without read-back.

A Maestro reports the pulse that it makes, which tells if a target arrived: a target that was lost is sent again.
"""

from collections.abc import Sequence

from hardware.boards.host_timed_board import HostTimedBoard, bus_id
from hardware.clock import Clock
from hardware.errors import BoardError, LinkError
from hardware.joint_map import JointCalibration
from hardware.transport import SerialTransport, Transport

_SET_TARGET, _GET_POSITION, _GET_ERRORS = 0x84, 0x90, 0xA1
_QUARTERS = 4  # targets are in quarters of a microsecond
_ANSWER_S, _POLL_S, _TRIES = 0.05, 0.0005, 5


class MaestroBoard(HostTimedBoard):
    """A Pololu Maestro; a joint's channel is its output, 0 to 23, raw values are microseconds of pulse.

    A Maestro makes its last pulses for ever when the host falls silent, unless a timeout is set in Pololu's Control
    Center. On Linux and macOS a process beside this one ends them if the program dies.

    Args:
        port: Command port, such as ``/dev/ttyACM0`` or ``COM3``; USB dual port mode.
        clock: Clock of the host; None for the computer's.
        transport: Transport to use instead of the port, for tests.

    Raises:
        BoardError: The port cannot be opened, or the Maestro does not answer.
    """

    def __init__(self, port: str = "", *, clock: Clock | None = None, transport: Transport | None = None) -> None:
        super().__init__(f"maestro:{port}", clock)
        self._line = SerialTransport(port) if transport is None else transport
        self._targets: dict[int, int] = {}
        self._turn = 0
        if self._ask(bytes((_GET_ERRORS,))) is None:
            raise BoardError(
                f"{self.name} does not answer; likely causes: it has no power, the port is its TTL port and not the "
                "command port, or its serial mode is not USB dual port"
            )

    def _servo_id(self, joint: JointCalibration) -> int:
        if joint.readback:
            raise BoardError(f"{joint.name} says readback = true, and a Maestro has none; correct the calibration")
        return bus_id(joint, 0, 23)

    def _prepare(self, ids: Sequence[int]) -> None:
        self._drive(ids, False)

    def _write(self, ids: Sequence[int], raw: Sequence[int]) -> None:
        self._targets = dict(zip(ids, raw, strict=True))
        self._line.write(b"".join(_target(i, value) for i, value in self._targets.items()))

    def _read(self, ids: Sequence[int]) -> list[int] | None:
        """Return the targets; each call compares the next of them with the pulse made, and resends a lost one."""
        self._turn = (self._turn + 1) % len(ids)
        servo = ids[self._turn]
        wanted = self._targets.get(servo)
        answer = self._ask(bytes((_GET_POSITION, servo)))
        if answer is None:
            return None
        if wanted is not None and answer != wanted * _QUARTERS:
            self._line.write(_target(servo, wanted))
            self.retries += 1
        commands = zip(ids, self._executor.command, strict=True)
        return [self._targets.get(i, (command + 8) >> 4) for i, command in commands]

    def _drive(self, ids: Sequence[int], on: bool) -> bool:
        if on:
            return True
        self._targets = {}
        self._line.write(b"".join(_target(i, 0) for i in ids))  # a target of zero ends the pulses
        return all(self._ask(bytes((_GET_POSITION, i))) == 0 for i in ids)

    def _ask(self, request: bytes) -> int | None:
        """Return the two-byte answer to a request, or None if there is none."""
        for _ in range(_TRIES):
            while self._line.read():
                pass  # discard late answers
            self._line.write(request)
            answer, deadline = b"", self.clock.now() + _ANSWER_S
            while len(answer) < 2 and self.clock.now() < deadline:
                self.clock.sleep(_POLL_S)
                answer += self._line.read()
            if len(answer) == 2:
                return int.from_bytes(answer, "little")
            self.retries += 1
        return None

    def _farewell(self) -> tuple[int | None, bytes]:
        return getattr(self._line, "descriptor", None), b"".join(_target(i, 0) for i in self._ids)

    def _disconnect(self) -> None:
        self._line.close()


def _target(servo: int, microseconds: int) -> bytes:
    """Return the command that sets one output's pulse, in quarters of a microsecond, seven bits per byte."""
    quarters = microseconds * _QUARTERS
    if quarters >> 14:
        raise LinkError(f"a Maestro's pulses are below 4096 µs; got {microseconds}")
    return bytes((_SET_TARGET, servo, quarters & 0x7F, quarters >> 7))
