"""Series of servos as data: registers, how they write positions, names of models, modes and alerts."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple


class Register(NamedTuple):
    """Entry of a servo's control table.

    Attributes:
        address: Address of the lowest byte.
        width: Length [bytes].
    """

    address: int
    width: int


class Reply(NamedTuple):
    """Answer of a servo.

    Attributes:
        data: Content of the registers asked for.
        error: Error byte of the reply.
    """

    data: bytes
    error: int

    @property
    def value(self) -> int:
        """The content as an unsigned number."""
        return int.from_bytes(self.data, "little")


@dataclass(frozen=True)
class ServoSeries:
    """Series of servos that share a control table.

    Attributes:
        kind: Kind of the board, as in its address.
        bauds: Rates that the servos can be set to, the factory's first [bits per second].
        ids: Numbers that a servo can have.
        torque: Register that is 1 while the servo is driven.
        goal: Register of the goal.
        position: Register of the position.
        mode: Register of the operating mode.
        position_modes: Modes in which the servo goes to a goal position.
        turning_modes: Those among them in which it counts turns, and its limits do not apply.
        mode_names: Operating modes in words.
        limits: Registers of the lowest and the highest goal that the servo takes.
        voltage: Register of the supply voltage, in tenths of a volt.
        temperature: Register of the temperature [°C].
        alerts: Register of the alerts, a bit each.
        alert_names: Alerts by bit.
        alert_mask: Bits of a reply's error byte that announce an alert.
        model: Register of the model's number.
        models: Names of models by number.
        watchdog: Register after whose time without a word from the host the servo stops; None if there is none.
        watchdog_value: Value that the watchdog is set to.
        remedy: Clause that tells how to clear an alert.
        sdk: Module of the maker's SDK.
        package: Package that brings the module.
        protocol: Version for the SDK's packet handler.
        options: Further arguments of the SDK's ``rxPacket`` and ``syncReadTx``.
        call_all: Ping to all servos, without header and sum.
        parse: Function that returns number, error byte and data of a status packet.
        decode: Function that turns a position register's content into a signed raw value.
        encode: Function that turns a signed raw value into a goal register's content.
        whole_range: Lowest and highest raw value of a servo that counts turns.
    """

    kind: str
    bauds: tuple[int, ...]
    ids: range
    torque: Register
    goal: Register
    position: Register
    mode: Register
    position_modes: tuple[int, ...]
    turning_modes: tuple[int, ...]
    mode_names: Mapping[int, str]
    limits: tuple[Register, Register]
    voltage: Register
    temperature: Register
    alerts: Register
    alert_names: Mapping[int, str]
    alert_mask: int
    model: Register
    models: Mapping[int, str]
    remedy: str
    sdk: str
    package: str
    protocol: int | float
    call_all: tuple[int, ...]
    parse: Callable[[Sequence[int]], tuple[int, int, bytes]]
    decode: Callable[[int], int]
    encode: Callable[[int], int]
    whole_range: tuple[int, int]
    watchdog: Register | None = None
    watchdog_value: int = 0
    options: tuple[Any, ...] = field(default=())

    def named_alerts(self, bits: int) -> list[str]:
        """Return the names of the alerts among the bits of an alert register."""
        return [name for bit, name in self.alert_names.items() if bits >> bit & 1]
