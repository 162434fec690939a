"""Registers of servos on a bus, through their maker's SDK: read with retries, written and read back."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib import import_module
from typing import Any

from hardware.boards.sdk_port import SdkPort
from hardware.boards.servo_series import Register, Reply, ServoSeries
from hardware.clock import Clock
from hardware.errors import BoardError
from hardware.transport import Transport

_PATIENCE_S = 0.12  # longer without an answer is a lost line: four questions in vain
_MOST_ASKED, _MOST_WRITTEN = 8, 5


class RegisterBus:
    """Chain of servos of one series. The SDKs do not retry, and a disturbed answer is nothing unusual.

    Args:
        series: Series of the servos.
        transport: Stream of bytes to them.
        clock: Clock of the host.

    Attributes:
        retries: Number of requests repeated because an answer was missing or disturbed.

    Raises:
        BoardError: The maker's package is missing.
    """

    def __init__(self, series: ServoSeries, transport: Transport, clock: Clock) -> None:
        try:
            self._sdk: Any = import_module(series.sdk)
        except ImportError as error:
            transport.close()
            raise BoardError(f"{series.kind} servos need {series.package}: pip install {series.package}") from error
        self.series, self.retries = series, 0
        self._clock = clock
        self._port = SdkPort(transport, clock)
        self._packets: Any = self._sdk.PacketHandler(series.protocol)

    def read(self, ids: Sequence[int], register: Register, patience_s: float = _PATIENCE_S) -> dict[int, Reply]:
        """Return the answers of servos, those that fail being asked again; a servo without an answer is missing.

        Args:
            ids: Numbers of the servos.
            register: Register to read.
            patience_s: Time after which nobody is asked again [s].

        Raises:
            LinkError: The port is gone.
        """
        answers: dict[int, Reply] = {}
        began_s = self._clock.now()
        for attempt in range(_MOST_ASKED):
            missing = [i for i in ids if i not in answers]
            if not missing or (attempt and self._clock.now() - began_s > patience_s):
                break
            self.retries += attempt > 0
            together = len(missing) > 1 and (attempt == 0 or (attempt == 1 and not answers))
            for group in [missing] if together else [[i] for i in missing]:  # one that is missing may silence others
                answers |= self._ask(group, register)
                if self._clock.now() - began_s > patience_s and attempt:
                    break
        return answers

    def write(self, values: Mapping[int, int], register: Register) -> None:
        """Write a register of several servos with one packet, which none of them acknowledges.

        Args:
            values: Unsigned content by the servo's number.
            register: Register to write.

        Raises:
            LinkError: The port is gone.
        """
        content = [byte for i, value in values.items() for byte in (i, *value.to_bytes(register.width, "little"))]
        self._port.is_using = False
        self._packets.syncWriteTxOnly(self._port, register.address, register.width, content, len(content))

    def settle(self, values: Mapping[int, int], register: Register) -> dict[int, int | None]:
        """Write a register, read it back, and repeat until every servo holds its value.

        Args:
            values: Unsigned content by the servo's number.
            register: Register to write.

        Returns:
            Values read from the servos that do not hold theirs, None for those that do not answer; empty if all do.

        Raises:
            LinkError: The port is gone.
        """
        wrong: dict[int, int | None] = dict.fromkeys(values)
        for attempt in range(_MOST_WRITTEN):
            self.retries += attempt > 0
            self.write({i: values[i] for i in wrong}, register)
            answers = self.read(list(wrong), register)
            found = {i: answers[i].value if i in answers else None for i in wrong}
            wrong = {i: value for i, value in found.items() if value != values[i]}
            if not wrong:
                break
        return wrong

    def find(self, candidates: Iterable[int], progress: Callable[[float], None] = lambda fraction: None) -> list[int]:
        """Return the numbers of the servos that answer a call to all, or to their number.

        Args:
            candidates: Numbers that are called one by one besides.
            progress: Function that is called with the fraction done, 0 to 1.

        Raises:
            LinkError: The port is gone.
        """
        found, numbers = self._call_all(), list(candidates)
        for done, servo in enumerate(numbers):
            progress(done / len(numbers))
            if servo not in found and self._ask([servo], self.series.model):
                found.add(servo)
        return sorted(found)

    def close(self) -> None:
        """Close the port."""
        self._port.close()

    def _ask(self, ids: Sequence[int], register: Register) -> dict[int, Reply]:
        """Ask servos once and return the answers that arrive whole."""
        packets, port, width = self._packets, self._port, register.width
        port.is_using = False
        if len(ids) == 1:
            packets.readTx(port, ids[0], register.address, width)
        else:
            packets.syncReadTx(port, register.address, width, list(ids), len(ids), *self.series.options)
        answers: dict[int, Reply] = {}
        while len(answers) < len(ids):
            packet = self._receive()
            if packet is None:
                if port.timed_out:
                    break
                continue  # garbled; the next may be well
            servo, error, data = packet
            if servo in ids and len(data) == width:  # another length is the answer to another question
                answers[servo] = Reply(data, error)
        return answers

    def _receive(self) -> tuple[int, int, bytes] | None:
        """Return number, error byte and data of the next packet, or None if none is whole."""
        try:
            packet, result = self._packets.rxPacket(self._port, *self.series.options)
        except IndexError:  # the SDKs look beyond the end of a truncated packet
            return None
        return self.series.parse(packet) if result == self._sdk.COMM_SUCCESS else None

    def _call_all(self) -> set[int]:
        """Return the numbers of the servos that answer a ping to all."""
        port, found = self._port, set()
        port.is_using = False
        self._packets.txPacket(port, list(self.series.call_all))
        port.setPacketTimeoutMillis(16.0 + 3 * len(self.series.ids))  # as in dynamixel-sdk
        while not port.timed_out:
            packet = self._receive()
            if packet is not None:
                found.add(packet[0])
        return found & set(self.series.ids)
