"""Finding bus servos whose kind, rate and numbers nobody knows, and only by reading."""

import json

import pytest

import hardware
from hardware import cli_check
from hardware.boards.feetech import FeetechBoard
from hardware.clock import VirtualClock, WallClock
from jaxik.cli import run
from tests.helpers.servo_bus import DynamixelBus, FeetechBus, OnPort


class Silence:
    """A line at a rate at which no servo understands."""

    byte_s = 1e-5

    def write(self, data):
        pass

    def read(self):
        return b""

    def close(self):
        pass


class Line:
    """A port with servos at some rates; opens like :class:`hardware.transport.SerialTransport`."""

    def __init__(self, buses, refused=()):
        self.clock, self.buses, self.refused, self.opened = VirtualClock(), buses, refused, []
        for bus in buses.values():
            bus.clock = self.clock

    def __call__(self, port, baud):
        self.opened.append((port, baud))
        if baud in self.refused:
            raise hardware.BoardError(f"{port} cannot be opened: no such rate")
        return self.buses.get(baud, Silence())

    def scan(self, port="/dev/ttyUSB0", **options):
        return hardware.scan(port, open_port=self, clock=self.clock, **options)


def writes_nothing(bus):
    store, stored = bus.store, []
    bus.store = lambda *what: (stored.append(what), store(*what))
    return stored


@pytest.mark.parametrize(
    ("fake", "kind", "baud", "model", "volts"),
    [
        (FeetechBus, "feetech", 1_000_000, "STS3215", 7.4),
        (FeetechBus, "feetech", 115_200, "STS3215", 7.4),
        (DynamixelBus, "dynamixel", 57_600, "XL430-W250", 12.0),
        (DynamixelBus, "dynamixel", 3_000_000, "XL430-W250", 12.0),
    ],
)
def test_a_scan_finds_kind_rate_and_numbers(fake, kind, baud, model, volts):
    bus = fake([3, 7, 200], baud=baud, start=-5 if kind == "feetech" else 1000)
    bus.alarm(7, 0)
    stored, told, fractions = writes_nothing(bus), [], []
    result = Line({baud: bus}).scan(tell=told.append, progress=fractions.append)
    assert [(servo.kind, servo.baud, servo.reading.servo) for servo in result.found] == [
        (kind, baud, i) for i in (3, 7, 200)
    ]
    assert told == list(result.found)
    for servo in result.found:
        assert servo.reading.model == model
        assert servo.reading.voltage_v == pytest.approx(volts)
        assert servo.reading.position == (-5 if kind == "feetech" else 1000)
        assert servo.reading.mode == "position"
        assert not servo.reading.driven
        assert ("voltage" in " ".join(servo.reading.alerts)) == (servo.reading.servo == 7)
    assert result.ok
    assert result.addresses() == (f"{kind}:/dev/ttyUSB0@{baud}",)
    assert stored == [], "nothing is written"
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0


def test_servos_that_do_not_answer_a_call_to_all_are_called_by_number():
    bus = FeetechBus([2, 30], baud=1_000_000)
    answer = bus.answer
    bus.answer = lambda servo, kind, rest: () if servo == 0xFE and kind == 1 else answer(servo, kind, rest)
    line = Line({1_000_000: bus})
    assert [servo.reading.servo for servo in line.scan("feetech:X", bauds=(1_000_000,)).found] == [2]
    assert [servo.reading.servo for servo in line.scan("feetech:X", bauds=(1_000_000,), ids=[30]).found] == [30]


@pytest.mark.parametrize("fake", [FeetechBus, DynamixelBus])
def test_a_scan_over_a_disturbed_line(fake):
    bus = fake(range(1, 8), baud=1_000_000, lose=0.02, garble=0.02, seed=3)
    found = Line({1_000_000: bus}).scan(bauds=(1_000_000,)).found
    assert [servo.reading.servo for servo in found] == list(range(1, 8))


def test_servos_at_two_rates():
    """One servo of a chain may have been left at another rate."""
    slow, fast = FeetechBus([1], baud=115_200), FeetechBus([2], baud=1_000_000)
    found = Line({115_200: slow, 1_000_000: fast}).scan().found
    assert {(servo.baud, servo.reading.servo) for servo in found} == {(115_200, 1), (1_000_000, 2)}


def test_a_kind_and_rates_can_be_given():
    line = Line({500_000: FeetechBus([1], baud=500_000)})
    assert len(line.scan("feetech:/dev/ttyUSB0", bauds=(500_000,)).found) == 1
    assert line.opened == [("/dev/ttyUSB0", 500_000)]


def test_nothing_answers():
    result = Line({}).scan()
    assert not result.ok
    assert result.status is hardware.ScanStatus.NOTHING
    assert ("feetech", 1_000_000) in result.tried
    assert ("dynamixel", 57_600) in result.tried
    with pytest.raises(hardware.LinkError, match="/dev/ttyUSB0: nothing answers: is the servos' supply on"):
        result.raise_if_invalid()


def test_rates_that_an_adapter_refuses_are_noted():
    result = Line({1_000_000: FeetechBus([1], baud=1_000_000)}, refused=(4_000_000,)).scan()
    assert result.ok
    assert result.notes == ("/dev/ttyUSB0 cannot be opened: no such rate",)
    with pytest.raises(hardware.BoardError, match="cannot be opened"):
        Line({}, refused=(1_000_000,)).scan()


def test_a_scan_of_a_real_port():
    """It is opened and closed once per rate, and another program has it no longer than that."""
    line = OnPort(FeetechBus([5], clock=WallClock()), baud=115_200)
    result = hardware.scan(f"feetech:{line.port}", bauds=(57_600, 115_200), ids=())
    assert [(servo.baud, servo.reading.servo) for servo in result.found] == [(115_200, 5)]
    with (
        FeetechBoard(line.port, baud=115_200),
        pytest.raises(hardware.BoardError, match="does another program hold it"),
    ):
        hardware.scan(line.port, bauds=(115_200,))
    line.close()


def test_the_command(monkeypatch, capsys):
    line = Line({1_000_000: FeetechBus([4], baud=1_000_000)})
    scan = hardware.scan
    monkeypatch.setattr(
        cli_check, "scan_port", lambda port, **options: scan(port, open_port=line, clock=line.clock, **options)
    )
    monkeypatch.setenv("COLUMNS", "160")
    assert run(["scan", "/dev/ttyUSB0"]) == 0
    printed = capsys.readouterr().out
    assert "feetech servo 4 answers at 1000000 baud" in printed
    assert "their address: feetech:/dev/ttyUSB0@1000000" in printed
    assert run(["scan", "feetech:/dev/ttyUSB0", "--baud", "1000000", "115200", "--ids", "1-3,9", "--json"]) == 0
    (servo,) = json.loads(capsys.readouterr().out)["servos"]
    assert (servo["servo"], servo["model"], servo["baud"], servo["alerts"]) == (4, "STS3215", 1_000_000, [])
    assert run(["scan", "/dev/ttyUSB0", "--ids", "1;2"]) == 1
    assert "--ids needs numbers such as 1-20 or 3,7; got '1;2'" in capsys.readouterr().err
    assert run(["check", "feetech:/dev/ttyUSB0"]) == 0
    printed = capsys.readouterr().out
    assert "feetech servo 4 answers at 1000000 baud" in printed
    assert "which servo moves which joint is said by a calibration" in printed
    assert line.opened[-1] == ("/dev/ttyUSB0", 1_000_000)
    assert run(["check", "feetech:/dev/ttyUSB0@115200"]) == 1
    assert line.opened[-1] == ("/dev/ttyUSB0", 115_200)
    capsys.readouterr()
    line.buses.clear()
    assert run(["scan", "/dev/ttyUSB0"]) == 1
    assert "/dev/ttyUSB0: nothing answers" in capsys.readouterr().out
