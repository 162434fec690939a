"""Servos on a serial line that nobody knows yet: every kind, rate and number is asked, and nothing is written."""

import enum
import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from hardware.boards.dynamixel import DYNAMIXEL
from hardware.boards.feetech import FEETECH
from hardware.boards.register_bus import RegisterBus
from hardware.boards.servo_reading import ServoReading, read_servos
from hardware.boards.servo_series import ServoSeries
from hardware.clock import Clock, WallClock
from hardware.errors import BoardError, LinkError
from hardware.transport import SerialTransport, Transport

if TYPE_CHECKING:
    from typing import Self

SERIES = {series.kind: series for series in (FEETECH, DYNAMIXEL)}
_LIKELY = range(1, 21)  # numbers that are called one by one besides the call to all


class ScanStatus(enum.IntEnum):
    """Outcome of a scan."""

    OK = 0
    NOTHING = 1

    @property
    def message(self) -> str:
        """One sentence: what it means and what to do."""
        return _MESSAGES[self]


_MESSAGES = {
    ScanStatus.OK: "servos answer",
    ScanStatus.NOTHING: "nothing answers: is the servos' supply on, is the adapter's switch on USB, are plus, minus "
    "and data where they belong? An Arduino or a Maestro is no servo bus: try `jaxik check arduino:PORT`",
}


@dataclass(frozen=True)
class FoundServo:
    """Servo that answered.

    Attributes:
        kind: Kind of its board, as in an address of :func:`hardware.connect`.
        baud: Rate that it answered at [bits per second].
        reading: Its state.
    """

    kind: str
    baud: int
    reading: ServoReading


@dataclass(frozen=True)
class ScanResult:
    """Result of :func:`scan`.

    Attributes:
        port: Serial port.
        found: Servos that answered.
        tried: Kinds and rates that were tried, in order.
        notes: Things to know, one sentence each.
    """

    port: str
    found: tuple[FoundServo, ...]
    tried: tuple[tuple[str, int], ...]
    notes: tuple[str, ...]

    @property
    def status(self) -> ScanStatus:
        """Outcome of the scan."""
        return ScanStatus.OK if self.found else ScanStatus.NOTHING

    @property
    def ok(self) -> bool:
        """True if a servo answered."""
        return bool(self.found)

    def raise_if_invalid(self) -> "Self":
        """Return the result itself, so that calls chain.

        Raises:
            LinkError: Nothing answered; with what to check.
        """
        if not self.ok:
            raise LinkError(f"{self.port}: {self.status.message}")
        return self

    def addresses(self) -> tuple[str, ...]:
        """Return the addresses for :func:`hardware.connect` at which servos answered."""
        return tuple(dict.fromkeys(f"{servo.kind}:{self.port}@{servo.baud}" for servo in self.found))


def scan(
    port: str,
    *,
    bauds: Sequence[int] = (),
    ids: Iterable[int] = _LIKELY,
    progress: Callable[[float], None] = lambda fraction: None,
    tell: Callable[[FoundServo], None] = lambda servo: None,
    open_port: Callable[[str, int], Transport] = SerialTransport,
    clock: Clock | None = None,
) -> ScanResult:
    """Look for servos on a serial port; it only reads.

    Args:
        port: Port such as ``/dev/ttyUSB0``, or an address such as ``feetech:/dev/ttyUSB0`` for one kind only, and
            ``feetech:/dev/ttyUSB0@115200`` for one rate only.
        bauds: Rates to try [bits per second]; empty for all that each kind can be set to, the factory's first.
        ids: Numbers to call one by one, besides a call to all that some servos do not answer.
        progress: Function that is called with the fraction done, 0 to 1.
        tell: Function that is called with every servo as soon as it is found.
        open_port: Function that opens a port at a rate.
        clock: Clock of the host; None for the computer's.

    Returns:
        The servos found, with the rates tried.

    Raises:
        BoardError: The port cannot be opened, or the maker's package is missing.
        LinkError: The port vanished.
    """
    kind, colon, rest = port.partition(":")
    series = [SERIES[kind]] if colon and kind in SERIES else list(SERIES.values())
    name, _, rate = (rest if colon and kind in SERIES else port).partition("@")
    bauds = bauds or ((int(rate),) if rate.isdecimal() else ())
    clock = WallClock() if clock is None else clock
    plan = _plan(series, bauds)
    found: list[FoundServo] = []
    tried: list[tuple[str, int]] = []
    notes: list[str] = []
    for step, (maker, baud) in enumerate(plan):
        try:
            transport = open_port(name, baud)
            bus = RegisterBus(maker, transport, clock)
        except BoardError as error:
            if not tried and (len(series) == 1 or "cannot be opened" in str(error)):
                raise  # at every rate
            notes.append(str(error))
            continue
        try:
            part = lambda fraction, step=step: progress((step + fraction) / len(plan))  # noqa: E731
            numbers = bus.find([i for i in ids if i in maker.ids], part)
            for reading in read_servos(bus, numbers):
                found.append(FoundServo(maker.kind, baud, reading))
                tell(found[-1])
        finally:
            bus.close()
        tried.append((maker.kind, baud))
    progress(1.0)
    return ScanResult(name, tuple(found), tuple(tried), tuple(dict.fromkeys(notes)))


def _plan(series: Sequence[ServoSeries], bauds: Sequence[int]) -> list[tuple[ServoSeries, int]]:
    """Return kinds and rates in the order to try them, the likeliest first."""
    columns = [[(maker, baud) for baud in (bauds or maker.bauds)] for maker in series]
    return [pair for row in itertools.zip_longest(*columns) for pair in row if pair is not None]
