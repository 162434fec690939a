"""Stops and faults: the arm is released, held or lowered as asked for, and signals are handled only meanwhile."""

import os
import signal
import threading
from dataclasses import replace

import numpy as np
import pytest

import hardware
from hardware import OnStop, PlayResult, State
from hardware.boards import CompositeBoard
from hardware.boards.feetech import FeetechBoard
from hardware.boards.maestro import MaestroBoard
from hardware.boards.meccanoid import MeccanoidBoard
from hardware.clock import VirtualClock
from hardware.protocol import parse_channel
from hardware.stop_signals import StopSignal, stop_signals
from jaxik import Trajectory
from tests.helpers.firmware import CYCLES_PER_US, bench
from tests.helpers.meccanoid import MeccanoidFake
from tests.helpers.playing import play_over, plug_in, whole_robot
from tests.helpers.servo_bus import FeetechBus, Maestro

TIME = np.linspace(0.0, 4.0, 101)
TRAJECTORY = Trajectory(TIME, np.stack([np.sin(TIME), 0.5 * np.cos(TIME)], -1), ("a", "b"))
IDEAL = hardware.ideal_joint_map(("a", "b"))


def stopped(on_stop, again_at=None, **simulated):
    """Play until Ctrl-C at 40 %, and another one in mid-air; return report, last status and commands."""
    with hardware.connect("simulated", **simulated) as board, stop_signals() as signals:

        def stop(fraction):
            if fraction > 0.4:
                signals.take(signal.SIGINT)

        def watch(row):
            if again_at is not None and row.phase == "lower" and row.commanded[0] < again_at:
                signals.take(signal.SIGINT)

        report = hardware.play(TRAJECTORY, board, on_stop=on_stop, progress=stop, watch=watch)
        held = board.status()
        commands = IDEAL.to_rad(np.array([frame.commanded for frame in board.log]))
    return report, held, commands


def test_release_lets_the_arm_go_at_once():
    report, board, commands = stopped("release")
    assert report.result is PlayResult.ABORTED
    assert (report.signal, report.message, report.held) == (signal.SIGINT, "stopped by SIGINT", False)
    assert board.state is State.DETACHED
    assert commands[-1][0] > 0.9, "no further than where it was"


def test_hold_keeps_it_driven_as_long_as_somebody_asks():
    report, board, _ = stopped(OnStop.HOLD)
    assert report.held
    assert board.state is State.HOLDING
    with hardware.connect("simulated") as board, stop_signals() as signals:
        hardware.play(TRAJECTORY, board, on_stop="hold", progress=lambda f: f > 0.4 and signals.take(signal.SIGINT))
        asked = iter(range(200))
        hardware.keep_holding(board, lambda: next(asked) == 199)
        assert board.clock.now() > 9
        assert board.status().state is State.HOLDING
        assert np.ptp([frame.commanded for frame in list(board.log)[-300:]], axis=0).max() == 0
    assert board.status().state is State.DETACHED


def test_lower_goes_slowly_to_the_safe_pose_and_releases_there():
    report, board, commands = stopped("lower")
    assert report.result is PlayResult.ABORTED
    assert board.state is State.DETACHED
    np.testing.assert_allclose(commands[-1], IDEAL.column("safe"), atol=3e-4)
    down = commands[int(np.argmax(commands[:, 0])) :]
    assert np.abs(np.diff(down, axis=0)).max() / 0.02 <= 0.2 * 2 * np.pi + 0.02
    assert report.log.phase[-1] == "lower"


def test_a_second_stop_while_it_is_lowered_releases_at_once():
    report, board, commands = stopped("lower", again_at=0.5)
    assert board.state is State.DETACHED
    assert 0.4 < commands[-1][0] < 0.6, "on its way down from 0.98"
    assert "released before it was down" in report.warnings[-1]


@pytest.mark.parametrize("on_stop", OnStop)
def test_a_fault_ends_in_the_same_way(on_stop):
    with hardware.connect("simulated", stuck=["b"]) as board:
        report = hardware.play(
            TRAJECTORY, board, on_stop=on_stop, tolerances=hardware.Tolerances(path=0.2), progress=lambda fraction: None
        )
        assert report.result is PlayResult.PATH_TOLERANCE
        assert report.held == (on_stop is OnStop.HOLD)
        assert board.status().state is (State.HOLDING if report.held else State.DETACHED)
        assert ("lower" in report.log.phase) == (on_stop is OnStop.LOWER)


@pytest.mark.parametrize("on_stop", OnStop)
def test_a_success_releases_in_the_safe_pose(on_stop):
    with hardware.connect("simulated") as board:
        report = hardware.play(TRAJECTORY, board, on_stop=on_stop)
        assert report.ok
        assert not report.held
        assert board.status().state is State.DETACHED


def test_a_watcher_that_fails_on_the_way_down_does_not_leave_the_arm_driven():
    def watch(row):
        if row.phase == "lower":
            raise RuntimeError("a plot")

    with hardware.connect("simulated") as board, stop_signals() as signals:
        with pytest.raises(RuntimeError, match="a plot"):
            hardware.play(
                TRAJECTORY,
                board,
                on_stop="lower",
                watch=watch,
                progress=lambda fraction: fraction > 0.4 and signals.take(signal.SIGTERM),
            )
        assert board.status().state is State.DETACHED


def maestro(clock):
    """Return a board, its calibration, and a function that tells whether it drives its servos."""
    fake = Maestro()
    rows = [hobby(name, str(i)) for i, name in enumerate("ab")]
    return MaestroBoard(transport=fake, clock=clock), rows, lambda: any(fake.targets.values())


def meccanoid(clock):
    fake = MeccanoidFake(clock)
    common = {"raw_low": 24, "raw_high": 232, "neutral": 128.0, "raw_per_rad": 66.0, "sign": 1, "readback": True}
    common |= {"lower": -1.5, "upper": 1.5, "max_rate": 2.5, "safe": 0.0}
    rows = [hardware.JointCalibration(name=name, channel=str(i + 6), **common) for i, name in enumerate("ab")]
    return MeccanoidBoard(exchange=fake, clock=clock), rows, lambda: fake.mode == 2


def feetech(clock):
    bus = FeetechBus([1, 2], clock=clock)
    common = {"raw_low": 0, "raw_high": 4095, "neutral": 2048.0, "raw_per_rad": 4096 / (2 * np.pi), "sign": 1}
    common |= {"lower": -1.5, "upper": 1.5, "max_rate": 4.0, "safe": 0.0, "readback": True}
    rows = [hardware.JointCalibration(name=name, channel=str(i + 1), **common) for i, name in enumerate("ab")]
    return FeetechBoard(transport=bus, clock=clock), rows, lambda: bool(bus.driven())


def several(clock):
    one, rows, driven = maestro(clock)
    other = hardware.SimulatedBoard(clock=clock)
    mixed = [replace(rows[0], channel="maestro:0"), replace(hobby("b", ""), channel="simulated:D2")]
    board = CompositeBoard({"maestro": one, "simulated": other}, {})
    return board, mixed, lambda: driven() or other.model.executor.state is not State.DETACHED


def hobby(name, channel):
    common = {"raw_low": 500, "raw_high": 2500, "neutral": 1500.0, "raw_per_rad": 600.0, "sign": 1, "readback": False}
    common |= {"lower": -1.5, "upper": 1.5, "max_rate": 4.0, "safe": 0.0}
    return hardware.JointCalibration(name=name, channel=channel, **common)


@pytest.mark.parametrize("on_stop", OnStop)
@pytest.mark.parametrize("make", [maestro, meccanoid, feetech, several])
def test_every_board_ends_in_the_state_asked_for(make, on_stop):
    clock = VirtualClock()
    board, rows, driven = make(clock)
    joints = hardware.JointMap("two", tuple(rows))
    with board, stop_signals() as signals:
        report = hardware.play(
            TRAJECTORY,
            board,
            joints,
            on_stop=on_stop,
            tolerances=hardware.Tolerances(path=0.9),
            progress=lambda fraction: fraction > 0.4 and signals.take(signal.SIGTERM),
        )
        assert report.result is PlayResult.ABORTED, report.message
        assert not [said for said in report.warnings if "released" in said]
        assert report.held == (on_stop is OnStop.HOLD)
        assert driven() == report.held
        if on_stop is OnStop.HOLD:
            until = clock.now() + 3
            hardware.keep_holding(board, lambda: clock.now() > until)
            assert driven()
        if on_stop is OnStop.LOWER:
            np.testing.assert_allclose(report.log.commanded[-1], 0, atol=0.02)
    assert not driven(), "released with the board"


@pytest.mark.parametrize("on_stop", OnStop)
def test_a_servo_in_overload_releases_holds_or_ends_the_lowering(on_stop):
    clock = VirtualClock()
    bus = FeetechBus([1, 2], clock=clock)
    _, rows, _ = feetech(clock)
    with FeetechBoard(transport=bus, clock=clock) as board:
        report = hardware.play(
            TRAJECTORY,
            board,
            hardware.JointMap("two", tuple(rows)),
            on_stop=on_stop,
            progress=lambda fraction: fraction > 0.4 and bus.alarm(1, 5),
        )
        assert report.result is PlayResult.SERVO_FAULT
        assert "overload" in report.message
        assert report.held == (on_stop is OnStop.HOLD)
        assert bus.driven() == ([1, 2] if report.held else [])
        if report.held:
            until = clock.now() + 3
            hardware.keep_holding(board, lambda: clock.now() > until)
            assert bus.driven() == [1, 2]
        if on_stop is OnStop.LOWER:
            assert "released before it was down" in report.warnings[-1]
    assert bus.driven() == []


def test_the_firmware_itself_lowers_after_a_servo_is_gone():
    trajectory, joints = whole_robot(2.0)
    with bench() as chip:
        plug_in(chip, joints)
        run = chip.run

        def run_and_unplug(until_us):
            if chip.now_us < 3_000_000 <= until_us:
                chip.module(1, 3, False)
            run(until_us)

        chip.run = run_and_unplug
        played = play_over(chip, trajectory, joints, park=False, on_stop="lower")
        assert played.report.result is PlayResult.LINK_LOST
        assert "left_elbow_flexion" in played.report.message
        assert not played.report.warnings[1:], "lowered without trouble"
        pulses, safe = chip.pulses(), joints.to_raw(joints.column("safe"))
        for j, joint in enumerate(joints.joints):
            if not joint.readback:
                mine = pulses[pulses[:, 1] == parse_channel(joint.channel)]
                assert mine[-1, 2] == safe[j] * CYCLES_PER_US
        assert played.board.status().state is State.DETACHED


def test_signals_are_handled_only_meanwhile_and_only_in_the_main_thread():
    before = signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)
    with stop_signals() as signals:
        with stop_signals() as inner:
            assert inner is signals
        assert signal.getsignal(signal.SIGTERM) == signals.take
        os.kill(os.getpid(), signal.SIGTERM)
        assert (signals.count, signals.first.number) == (1, signal.SIGTERM)
        with pytest.raises(StopSignal), signals.raising():
            pass
    assert (signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)) == before
    seen = []

    def elsewhere():
        with stop_signals() as other:
            seen.append((other.count, signal.getsignal(signal.SIGTERM)))

    thread = threading.Thread(target=elsewhere)
    thread.start()
    thread.join()
    assert seen == [(0, before[0])]


def test_only_the_first_signal_interrupts():
    reached = []
    with stop_signals() as signals:

        def interrupted():
            with signals.raising():
                os.kill(os.getpid(), signal.SIGTERM)
                reached.append("never")

        with pytest.raises(StopSignal, match="stopped by SIGTERM") as caught:
            interrupted()
        assert caught.value.exit_code == 143
        os.kill(os.getpid(), signal.SIGINT)
        reached.append("the way out")
        assert signals.count == 2
    assert reached == ["the way out"]


def test_what_the_program_ignores_stays_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stop_signals() as signals:
            os.kill(os.getpid(), signal.SIGHUP)
            assert signals.count == 0
    finally:
        signal.signal(signal.SIGHUP, before)
