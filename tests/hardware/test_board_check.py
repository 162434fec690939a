"""``check``: who answers, at which voltage, and which joint moves which servo."""

import json

import numpy as np
import pytest

import hardware
from hardware import cli_check
from hardware.boards import CompositeBoard
from hardware.boards.dynamixel import DynamixelBoard
from hardware.boards.feetech import FeetechBoard
from hardware.boards.maestro import MaestroBoard
from hardware.clock import VirtualClock
from jaxik.cli import run
from tests.helpers.servo_bus import DynamixelBus, FeetechBus, Maestro

KINDS = {"dynamixel": (DynamixelBus, DynamixelBoard, 57_600), "feetech": (FeetechBus, FeetechBoard, 1_000_000)}
NAMES = ("lift", "turn", "elbow")


def joints(prefixes=("", "", ""), **changes):
    common = {"raw_low": 0, "raw_high": 4095, "neutral": 2048.0, "raw_per_rad": 4096 / (2 * np.pi), "sign": 1}
    common |= {"lower": -1.5, "upper": 1.5, "max_rate": 4.0, "safe": 0.0, "readback": True} | changes
    return hardware.JointMap(
        "three",
        tuple(
            hardware.JointCalibration(name=name, channel=f"{prefix}{i}", **common)
            for i, (name, prefix) in enumerate(zip(NAMES, prefixes, strict=True), 1)
        ),
    )


def connected(kind, ids=(1, 2, 3), **options):
    fake, board_class, baud = KINDS[kind]
    bus = fake(ids, baud=baud, **options)
    return bus, board_class("PORT", transport=bus, clock=bus.clock)


@pytest.mark.parametrize("kind", KINDS)
def test_a_board_that_is_ready(kind):
    bus, board = connected(kind, start=2200)
    driven = []
    store = bus.store
    bus.store = lambda servo, address, data: (
        driven.append(data) if address == bus.torque_at and any(data) else 0,
        store(servo, address, data),
    )
    with board:
        result = hardware.check(board, joints())
    assert result.ok, result.problems
    assert result.raise_if_invalid() is result
    assert result.status is hardware.CheckStatus.OK
    assert result.supply_v == pytest.approx(12.0 if kind == "dynamixel" else 7.4)
    assert [entry.answers for entry in result.joints] == [True] * 3
    assert np.degrees([entry.angle for entry in result.joints]) == pytest.approx([152 * 360 / 4096] * 3)
    assert all(np.isnan(entry.moved) for entry in result.joints)
    assert driven == [], "without a wiggle nothing is driven"


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_wrong_is_said_and_the_others_are_shown(kind):
    bus, board = connected(kind, (1, 3))
    with board:
        result = hardware.check(board, joints(), wiggle=NAMES)
    assert not result.ok
    assert [entry.answers for entry in result.joints] == [True, False, True]
    assert len(result.problems) == 1
    assert "turn (servo 2) does not answer" in result.problems[0]
    assert np.isnan(result.joints[0].moved), "no wiggle before that is mended"
    with pytest.raises(hardware.BoardError, match="turn"):
        result.raise_if_invalid()
    bus, board = connected(kind)
    bus.alarm(3, 5)
    with board:
        result = hardware.check(board, joints())
    assert "elbow (servo 3) reports overload" in result.problems[0]
    assert result.joints[2].reading.alerts == ("overload",)


def test_a_joint_outside_its_range_is_said():
    _, board = connected("feetech", start=3500)
    with board:
        result = hardware.check(board, joints(), wiggle=NAMES)
    assert len(result.problems) == 3
    assert result.problems[0].startswith("lift stands at 127.6°, outside its range -85.9° to 85.9°; move it")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("start", [2048, 3020, 1100])
def test_a_wiggle_is_small_slow_and_comes_back(kind, start):
    bus, board = connected(kind, start=start)
    said, track = [], []
    step = bus.step

    def watch():
        step()
        track.append((bus.clock.now(), tuple(bus.at.values())))

    bus.step = watch
    with board:
        result = hardware.check(board, joints(), wiggle=("turn", "elbow"), say=said.append)
    assert result.ok, result.problems
    assert [line.split()[0] for line in said] == ["turn", "elbow"]
    times, at = np.array([t for t, _ in track]), np.array([p for _, p in track])
    moved = np.ptp(at, axis=0) * 360 / 4096
    assert moved == pytest.approx([0.0, 4.0, 4.0], abs=0.1)
    assert not (np.abs(at[:, 1] - start) > 1)[np.abs(at[:, 2] - start) > 1].any(), "one after the other"
    every = np.arange(times[0], times[-1], 0.2)
    rates = np.abs(np.diff(np.interp(every, times, at[:, 1]))) / 0.2 * 360 / 4096
    assert 5.0 < rates.max() < 13.0
    assert at.min() >= joints().joints[0].raw_limits()[0]
    assert at.max() <= joints().joints[0].raw_limits()[1]
    assert bus.at == {i: pytest.approx(start, abs=1) for i in (1, 2, 3)}
    assert bus.driven() == []
    assert np.degrees([entry.moved for entry in result.joints]) == pytest.approx(
        [np.nan, 4.0, 4.0], abs=0.2, nan_ok=True
    )


def test_joints_whose_servos_are_swapped_or_stuck():
    """A chain of Meccano servos knows places only, so that another joint's servo moves."""
    template = hardware.load_joint_map("meccanoid.toml").select(["right_shoulder_lift", "right_elbow_flexion"])
    with hardware.connect("simulated", stuck=["right_elbow_flexion"]) as board:
        result = hardware.check(board, template, wiggle=template.names)
    assert result.problems == ("right_elbow_flexion did not move; is it blocked, or is another servo at its channel?",)
    bus, board = connected("feetech")
    goals = bus.store

    def crossed(servo, address, data):
        goals({1: 2, 2: 1}.get(servo, servo) if address == bus.goal_at else servo, address, data)

    with board:
        board.configure(joints())
        bus.store = crossed
        board._set = lambda values, register, what: bus.store and board._bus.write(values, register)
        result = hardware.check(board, joints(), wiggle=("lift",))
    assert result.problems == ("turn moved in the place of lift; are their channels swapped?",)


def test_hobby_servos_cannot_tell():
    said = []
    hobby = joints(raw_low=500, raw_high=2500, neutral=1500.0, raw_per_rad=600.0, readback=False)
    with MaestroBoard(transport=Maestro(), clock=VirtualClock()) as board:
        result = hardware.check(board, hobby, wiggle=("turn",), say=said.append)
    assert result.ok
    assert [entry.answers for entry in result.joints] == [None] * 3
    assert said[0].startswith("keep clear: lift, turn, elbow report no position")
    assert said[1].startswith("turn (2) moves by 4°")


def test_several_boards():
    clock = VirtualClock()
    buses = {kind: KINDS[kind][0]([1, 2, 3], clock=clock, baud=1_000_000) for kind in KINDS}
    boards = {kind: KINDS[kind][1]("PORT", transport=bus, clock=clock) for kind, bus in buses.items()}
    both = joints(("feetech:", "dynamixel:", "feetech:"))
    with CompositeBoard(boards) as board:
        result = hardware.check(board, both, wiggle=NAMES)
    assert result.ok, result.problems
    assert [entry.reading.model for entry in result.joints] == ["STS3215", "XL430-W250", "STS3215"]
    assert result.supply_v == pytest.approx(7.4)
    assert np.degrees([entry.moved for entry in result.joints]) == pytest.approx([4.0] * 3, abs=0.2)


def test_the_command(monkeypatch, capsys, tmp_path):
    hardware.save_joint_map(joints(), tmp_path / "three.toml")
    opened = []

    def connect(address, **options):
        bus, board = connected(address.partition(":")[0])
        opened.append((bus, options))
        return board

    monkeypatch.setattr(cli_check, "connect", connect)
    monkeypatch.setenv("COLUMNS", "200")
    words = ["check", "feetech:/dev/ttyUSB0", "--calibration", str(tmp_path / "three.toml"), "--baud", "115200"]
    assert run([*words, "--joint", "turn"]) == 0
    printed = capsys.readouterr().out
    assert "turn (2) moves by 4° and back: is it this one?" in printed
    assert "supply 7.4 V" in printed
    assert opened[0][1] == {"baud": 115200}
    assert run([*words, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["status"] == "OK"
    assert [entry["reading"]["model"] for entry in told["joints"]] == ["STS3215"] * 3
    assert run(["check", "maestro:/dev/ttyACM0"]) == 1
    assert "checking maestro:/dev/ttyACM0 needs --calibration FILE" in capsys.readouterr().err
    assert run([*words, "--joint", "neck"]) == 1
    assert "lacks neck; it has lift, turn, elbow" in capsys.readouterr().err


def test_the_dry_run(capsys):
    assert run(["check", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["supply_v"] == pytest.approx(5.0, abs=0.1)
