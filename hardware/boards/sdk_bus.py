"""Common part of the boards behind the two makers' SDKs: what protects people and servos, and our own errors.

No servo is driven before its mode, limits, alerts, watchdog and first goal have been read and are as they should be.
While it is driven, alerts are looked for in every answer, and torque and watchdog are read again and again.
"""

import math
from collections.abc import Mapping, Sequence

from hardware.boards.host_timed_board import HostTimedBoard, bus_id
from hardware.boards.register_bus import RegisterBus
from hardware.boards.servo_reading import ServoReading, read_servos
from hardware.boards.servo_series import Register, ServoSeries
from hardware.clock import Clock
from hardware.errors import BoardError, LinkError, ServoError
from hardware.joint_map import JointCalibration
from hardware.transport import SerialTransport, Transport

_EXAMINE_S = 0.25
_AT_REST_S = 0.4  # patience while nothing moves
_AGREE = 6
_FAR_OUTSIDE_RAD = math.radians(5)


class SdkBoard(HostTimedBoard):
    """A chain of servos behind an SDK of the Dynamixel family, whose calls have the same names.

    Args:
        series: Series of the servos.
        port: Serial port.
        baud: Bits per second.
        clock: Clock of the host; None for the computer's.
        transport: Transport to use instead of the port; None to open it.

    Raises:
        BoardError: The port cannot be opened, or the maker's package is missing.
    """

    tries = 1  # the bus itself asks again
    zero = 0x8000  # positions are signed

    def __init__(
        self, series: ServoSeries, port: str, baud: int, clock: Clock | None, transport: Transport | None
    ) -> None:
        super().__init__(f"{series.kind}:{port}", clock)
        self._series, self._baud = series, baud
        self._line = transport or SerialTransport(port, baud)
        self._bus = RegisterBus(series, self._line, self.clock)
        self._driven: set[int] = set()
        self._missing: list[int] = []
        self._limits: dict[int, tuple[int, int]] = {}
        self._examined_s, self._turn = self.clock.now(), 0

    def readings(self) -> dict[int, ServoReading]:
        """See :class:`hardware.boards.servo_reading.ReportsServos`."""
        return {self._ids.index(reading.servo): reading for reading in read_servos(self._bus, self._ids)}

    @property
    def without_watchdog(self) -> tuple[str, ...]:
        """See :class:`hardware.Board`."""
        return super().without_watchdog if self._series.watchdog is None else ()

    # ---- for HostTimedBoard ----

    def _servo_id(self, joint: JointCalibration) -> int:
        return bus_id(joint, self._series.ids[0], self._series.ids[-1])

    def _prepare(self, ids: Sequence[int]) -> None:
        series = self._series
        modes = self._values(ids, series.mode)
        for i, mode in modes.items():
            if mode not in series.position_modes:
                good = series.position_modes[0]
                raise BoardError(
                    f"{self._named(i)} is in {series.mode_names.get(mode, mode)} mode and would not go to a goal; set "
                    f"its register {series.mode.address} to {good}, {series.mode_names[good]} mode"
                )
        self._check_ranges(modes)
        self._raise_alerts(ids)
        self._drive_surely(ids, False)
        self._note_counting(modes)
        if series.watchdog is not None:
            self._set(dict.fromkeys(ids, 0), series.watchdog, "the reset of its watchdog")
            self._set_watchdogs(ids)

    def _write(self, ids: Sequence[int], raw: Sequence[int]) -> None:
        self._bus.write({i: self._series.encode(value) for i, value in zip(ids, raw, strict=True)}, self._series.goal)

    def _read(self, ids: Sequence[int]) -> list[int] | None:
        answers = self._bus.read(ids, self._series.position)
        self.retries, self._bus.retries = self.retries + self._bus.retries, 0
        self._missing = [i for i in ids if i not in answers]
        if self._missing:
            return None
        alarmed = [i for i in ids if answers[i].error & self._series.alert_mask]
        if alarmed:
            self._raise_alerts(alarmed)
        return [self._count(i, self._series.decode(answers[i].value)) for i in ids]

    def _drive(self, ids: Sequence[int], on: bool) -> bool:
        self._drive_surely(ids, on)
        return True

    def _drive_surely(self, ids: Sequence[int], on: bool) -> None:
        """Switch servos on or off and read it back; before, a servo has its watchdog, and its goal is where it is."""
        if not on:
            self._driven -= set(ids)
            wrong = self._bus.settle(dict.fromkeys(ids, 0), self._series.torque)
            if wrong:
                names = ", ".join(map(self._named, wrong))
                raise LinkError(f"{self.name}: {names} could not be switched off; switch the supply off")
            return
        new = [i for i in ids if i not in self._driven]
        goals = dict(zip(self._ids, self._goals(), strict=True))
        first = {i: self._series.encode(self._inside(i, goals[i])) for i in new}
        self._set(first, self._series.goal, "its first goal")
        if self._series.watchdog is not None:  # last: a servo that had no power meanwhile has lost it, and its goal too
            self._set_watchdogs(new)
        self._driven |= set(ids)
        self._set(dict.fromkeys(ids, 1), self._series.torque, "being switched on")
        for register, value in self._promises():  # once more: one that had no power in between has lost its settings
            self._holds(ids, register, value)

    def _promises(self) -> list[tuple[Register, int]]:
        """Return the registers of a driven servo that must not change, with their values."""
        series = self._series
        watched = [] if series.watchdog is None else [(series.watchdog, series.watchdog_value)]
        return [(series.torque, 1), *watched]

    def _examine(self) -> bool:
        """Look whether the servos still hold, under their watchdogs; in turn, all at the end and after a jump."""
        now, all_at_once = self.clock.now(), self._executor.done or self._jumped
        ids = [i for i in self._ids if i in self._driven]
        if not ids or (now - self._examined_s < _EXAMINE_S and not all_at_once):
            return True
        promises = self._promises()
        self._examined_s, self._turn = now, self._turn + 1
        asked = promises if all_at_once else [promises[self._turn % len(promises)]]
        return all(self._holds(ids, register, value) for register, value in asked)

    def _holds(self, ids: Sequence[int], register: Register, value: int) -> bool:
        """Raise ServoError if a register has changed, as two readings say; return False if a servo does not answer."""
        complete = True
        for _ in range(2):
            answers = self._bus.read(ids, register)
            alarmed = [i for i in ids if i in answers and answers[i].error & self._series.alert_mask]
            if alarmed:
                self._raise_alerts(alarmed)
            self._missing = [i for i in ids if i not in answers]
            complete = complete and not self._missing
            ids = [i for i in ids if i in answers and answers[i].value != value]
            if not ids:
                return complete
        self._raise_alerts(ids)
        servo = self._named(ids[0])
        if register == self._series.torque:
            raise ServoError(
                f"{servo} no longer holds: it was without power for a moment, or another program switched it off; "
                "check its plug and the supply, and close other programs that use the port"
            )
        raise ServoError(
            f"{servo} has lost its watchdog or was stopped by it (register {register.address} reads "
            f"{answers[ids[0]].value}, not {value}); close other programs that use the port, and play again"
        )

    def _describe_delay(self, delay_ms: float) -> str:
        """Return a sentence about answers that came too late to go on."""
        return self._describe_silence() if self._missing else super()._describe_delay(delay_ms)

    def _describe_silence(self) -> str:
        """Return a sentence about the servos that do not answer, and what to do."""
        scan = f"`jaxik scan {self.name}`"
        missing = self._missing or self._ids
        there = len(self._ids) - len(missing)
        if not there:
            none = f"none of the {len(missing)} servos answers"
            said = none if len(missing) > 1 else f"{self._named(missing[0])} does not answer"
            return (
                f"{self.name}: {said} at {self._baud} baud; is the supply on, the cable in, and the rate right? "
                f"{scan} tries every rate"
            )
        said = f"{', '.join(map(self._named, missing))} {'does' if len(missing) == 1 else 'do'} not answer"
        return (
            f"{self.name}: {said} at {self._baud} baud, the other {there} {'does' if there == 1 else 'do'}; check the "
            f"plug and the ID: {scan} lists what is on the line"
        )

    def _disconnect(self) -> None:
        self._bus.close()

    # ---- for each kind of servo ----

    def _note_counting(self, modes: dict[int, int]) -> None:
        """Note how servos in these modes count turns; may be overridden."""

    def _count(self, servo: int, raw: int) -> int:
        """Return a position as the servo will count it once driven; may be overridden."""
        return raw

    # ---- inside ----

    def _named(self, servo: int) -> str:
        """Return a servo's joint and number in words."""
        return f"{self._names[servo]} (servo {servo})"

    def _values(self, ids: Sequence[int], register: Register) -> dict[int, int]:
        """Return a register of every servo, or raise LinkError with those that do not answer."""
        values: dict[int, int] = {}
        for _ in range(_AGREE):  # until two readings agree: another program's answers may look like ours
            answers = self._bus.read(ids, register, _AT_REST_S)
            self._missing = [i for i in ids if i not in answers]
            if self._missing:
                raise LinkError(self._describe_silence())
            before, values = values, {i: answers[i].value for i in ids}
            if values == before:
                break
        return values

    def _set(self, values: Mapping[int, int], register: Register, what: str) -> None:
        """Write a register until it reads so, or raise."""
        if not values:
            return
        wrong = self._bus.settle(values, register)
        silent = [i for i, value in wrong.items() if value is None]
        if silent:
            self._missing = silent
            raise LinkError(self._describe_silence())
        if wrong:
            self._raise_alerts(list(wrong))
            i = next(iter(wrong))
            raise BoardError(
                f"{self._named(i)} does not take {what}, without which it must not move: register {register.address} "
                f"reads {wrong[i]} after {values[i]} was written again and again"
            )

    def _set_watchdogs(self, ids: Sequence[int]) -> None:
        assert self._series.watchdog is not None
        self._set(dict.fromkeys(ids, self._series.watchdog_value), self._series.watchdog, "its watchdog")

    def _raise_alerts(self, ids: Sequence[int]) -> None:
        """Raise ServoError with the names of the servos' alerts, if they have any."""
        answers = self._bus.read(ids, self._series.alerts)
        suspects = [i for i in ids if i in answers and answers[i].value]
        again = self._bus.read(suspects, self._series.alerts)
        for i in suspects:
            alerts = self._series.named_alerts(answers[i].value & again[i].value) if i in again else []
            if alerts:
                volts = self._bus.read([i], self._series.voltage)
                at = f" at {volts[i].value / 10:.1f} V" if i in volts else ""
                raise ServoError(f"{self._named(i)} reports {' and '.join(alerts)}{at}; {self._series.remedy}")

    def _check_ranges(self, modes: Mapping[int, int]) -> None:
        """Note the servos' own limits, and refuse joints that would go beyond them."""
        series, joints = self._series, self._configured().joints
        low, high = (self._values(self._ids, register) for register in series.limits)
        for i, joint in zip(self._ids, joints, strict=True):
            own = series.decode(low[i]), series.decode(high[i])
            turns = modes[i] in series.turning_modes or own[0] >= own[1]
            most = series.whole_range if turns else own
            goes = joint.raw_limits()
            if not max(most[0], -self.zero) <= goes[0] <= goes[1] <= min(most[1], self.zero - 1):
                raise BoardError(
                    f"{self._named(i)} would go from raw {goes[0]} to {goes[1]}, and its servo is set to take "
                    f"{most[0]} to {most[1]}; correct limits_deg or neutral in the calibration, or the servo's limits"
                )
            self._limits[i] = most

    def _inside(self, servo: int, raw: int) -> int:
        """Return the goal nearest to where a servo stands; refuse if that is far."""
        low, high = self._limits[servo]
        goal = min(max(raw, low), high)
        joint = self._configured().joints[self._ids.index(servo)]
        if abs(goal - raw) > _FAR_OUTSIDE_RAD * joint.raw_per_rad:
            turns = f", {(raw - goal) / 4096:+.1f} turns off" if abs(raw - goal) > 4096 else ""
            raise BoardError(
                f"{self._named(servo)} stands at raw {raw}{turns}, and takes goals from {low} to {high}; turn it back "
                "by hand before it is driven"
            )
        return goal
