"""State of a servo on a bus, as it tells it itself."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from hardware.boards.register_bus import RegisterBus


@dataclass(frozen=True)
class ServoReading:
    """State of one servo.

    Attributes:
        servo: Number of the servo (its ID).
        model: Name of the model, or its number.
        position: Position [raw].
        mode: Operating mode in words.
        driven: True while the servo holds.
        voltage_v: Supply voltage [V].
        temperature_c: Temperature [°C].
        alerts: Names of its alerts.
    """

    servo: int
    model: str
    position: int
    mode: str
    driven: bool
    voltage_v: float
    temperature_c: int
    alerts: tuple[str, ...]


@runtime_checkable
class ReportsServos(Protocol):
    """A board whose servos tell more than their positions."""

    def readings(self) -> dict[int, ServoReading]:
        """Return the state of the servos that answer, by the place of their joint; also if configuring failed.

        Raises:
            LinkError: The port is gone.
        """
        ...


def read_servos(bus: RegisterBus, ids: Sequence[int]) -> list[ServoReading]:
    """Return the state of the servos that answer.

    Args:
        bus: Bus that the servos are on.
        ids: Numbers of the servos.

    Raises:
        LinkError: The port is gone.
    """
    series = bus.series
    registers = (
        series.model,
        series.position,
        series.mode,
        series.torque,
        series.voltage,
        series.temperature,
        series.alerts,
    )
    columns = [bus.read(ids, register) for register in registers]
    found = []
    for servo in ids:
        if all(servo in column for column in columns):
            model, position, mode, torque, tenths, celsius, alerts = (column[servo].value for column in columns)
            found.append(
                ServoReading(
                    servo=servo,
                    model=series.models.get(model, f"model {model}"),
                    position=series.decode(position),
                    mode=series.mode_names.get(mode, f"mode {mode}"),
                    driven=bool(torque),
                    voltage_v=tenths / 10,
                    temperature_c=celsius,
                    alerts=tuple(series.named_alerts(alerts)),
                )
            )
    return found
