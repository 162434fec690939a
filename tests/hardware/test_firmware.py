"""The firmware's binary, cycle by cycle: pulses, chains, stopping, silence, restarts, and memory left."""

import numpy as np
import pytest

import hardware
from hardware import Fault, PlayResult, State
from hardware.boards.firmware_board import FirmwareBoard
from hardware.clock import VirtualClock
from hardware.protocol import CHAINS, PLACES
from tests.helpers import firmware
from tests.helpers.faulty_link import FaultyLink
from tests.helpers.firmware import CYCLES_PER_US, bench
from tests.helpers.playing import (
    BLUETOOTH,
    HOBBY,
    WIRE,
    play_over,
    plug_in,
    pulse_errors,
    ramp,
    ready,
    standing,
    whole_robot,
)
from tests.helpers.playing import MECCANOID as JOINTS


def configure_and_enable(board):
    board.configure(JOINTS)
    board.enable()


def test_pulses_are_exact_to_the_cycle_while_chains_and_line_are_busy():
    with bench() as chip:
        plug_in(chip, JOINTS)
        board = ready(chip)
        raw = board.status().commanded.astype(int)
        raw[HOBBY] = [1000, 1234, 1777, 2345]
        board.move(raw.tolist())
        for _ in range(40):
            board.clock.sleep(0.02)
            board.status()
        settled = chip.now_us
        for _ in range(200):  # 100 questions per second
            board.status()
            board.clock.sleep(0.01 - (board.clock.now() % 0.01))
        pulses = chip.pulses()
        pulses = pulses[pulses[:, 0] > settled * CYCLES_PER_US]
        commanded = np.array([1000, 1234, 0, 1777, 2345])[pulses[:, 1]]
        error_us = pulses[:, 2] / CYCLES_PER_US - commanded
        assert len(pulses) > 380
        assert error_us.std() <= 0.1
        assert np.quantile(np.abs(error_us), 0.999) <= 0.5
        assert np.abs(error_us).max() <= 6
        assert np.abs(error_us).max() == 0, "every pulse is exact to the cycle"
        periods = np.diff(pulses[pulses[:, 1] == 0, 0])
        np.testing.assert_array_equal(periods, 6 * 3333 * CYCLES_PER_US)
        packets = chip.packets
        packets = packets[packets["cycle"] > settled * CYCLES_PER_US]
        assert len(packets) / CHAINS / ((chip.now_us - settled) * 1e-6) > 21
        assert chip.overruns == 0


@pytest.mark.parametrize(
    ("link", "silence", "skew"), [(WIRE, 0.3, 0.005), (BLUETOOTH, 0.5, -0.005)], ids=["wire", "radio"]
)
def test_pulses_follow_the_planned_motion(link, silence, skew):
    trajectory, joints = whole_robot(5.0)
    with bench(skew=skew) as chip:
        plug_in(chip, joints)
        played = play_over(chip, trajectory, joints, link=link, stop_within_s=silence, park=False)
        assert played.report.result is PlayResult.SUCCESS
        pulses = chip.pulses()
        error_us = pulse_errors(
            pulses[:, 0] / chip.cycles_per_us * 1e-6,
            pulses[:, 1],
            pulses[:, 2] / CYCLES_PER_US,
            trajectory,
            joints,
            standing(joints),
            played.starts_s[0],
        )
        assert chip.awake < 0.12, "mostly asleep"
        assert len(error_us) > 1000
        assert np.sqrt(np.mean(error_us**2)) <= 1.5
        assert np.abs(error_us).max() <= 6
        assert chip.overruns == 0


def test_stop_is_effective_by_the_next_pulse():
    with bench() as chip:
        plug_in(chip, JOINTS)
        board = ready(chip)
        ramp(board, 0.7, rate=500.0)
        board.start(0)
        board.clock.sleep(0.3)
        board.stop()
        told_us = chip.now_us
        for _ in range(10):
            board.clock.sleep(0.04)
            assert board.status().state is State.HOLDING
        pulses = chip.pulses()
        for pin in set(pulses[:, 1]):
            mine = pulses[pulses[:, 1] == pin]
            moving, after = mine[:, 0] < told_us * CYCLES_PER_US, mine[:, 0] >= told_us * CYCLES_PER_US
            assert np.ptp(mine[moving, 2]) > 1000
            assert np.ptp(mine[after, 2]) == 0, "the width is constant from the first pulse on"


@pytest.mark.parametrize("within_s", [0.3, 0.5])
def test_silence_stops_the_arm_and_then_releases_it(within_s):
    with bench() as chip:
        plug_in(chip, JOINTS)
        board = ready(chip, stop_within_s=within_s)
        ramp(board, 0.75, rate=500.0)
        board.start(0)
        heard = chip.now_us
        chip.run(heard + 3_000_000)
        pulses = chip.pulses()
        at = pulses[:, 0] / CYCLES_PER_US - heard
        for pin in set(pulses[:, 1]):
            mine = pulses[:, 1] == pin
            assert np.ptp(pulses[mine & (at > 0) & (at < within_s * 5e5), 2]) > 0
            assert np.ptp(pulses[mine & (at > within_s * 1e6), 2]) == 0
            steps = np.diff(pulses[mine, 2])
            assert steps.min() >= 0, "the arm stays on its path"
            assert steps.max() <= 500 * 0.02 * CYCLES_PER_US + 1
        assert 1.98e6 < at.max() < 2.03e6
        final = chip.packets["cycle"] / CYCLES_PER_US - heard > within_s * 1e6
        goals = chip.packets["data"][final][:, :4]
        assert set(goals[-8:].ravel()) == {0xFA}, "all limp"


def test_the_watchdog_restarts_a_hanging_board_and_nothing_is_driven():
    with bench() as chip:
        plug_in(chip, JOINTS)
        board = ready(chip)
        board.clock.sleep(0.1)
        board.status()
        hung = chip.now_us
        chip.hang()
        chip.run(hung + 500_000)
        board.clock.sleep(0.5)
        pulses = chip.pulses()
        assert pulses[-1, 0] / CYCLES_PER_US < hung + 150_000
        with pytest.raises(hardware.LinkError, match="restarted"):
            board.status()


def test_a_servo_unplugged_stops_the_arm_and_is_found_again():
    with bench() as chip:
        plug_in(chip, JOINTS)
        board = ready(chip)
        for _ in range(10):  # each answers while driven
            board.clock.sleep(0.04)
            assert board.status().fault is Fault.NONE
        chip.module(0, 1, present=False)
        for _ in range(30):
            board.clock.sleep(0.04)
            status = board.status()
        assert status.fault is Fault.SERVO
        assert status.joint in (1, 2, 3), "the unplugged one, or one behind it that was asked first"
        assert np.isnan(status.measured[1:4]).all(), "those behind it are gone too"
        assert not np.isnan(status.measured[0])
        with pytest.raises(hardware.BoardError, match="right_shoulder_lift: a smart servo does not answer"):
            configure_and_enable(board)
        chip.module(0, 1, present=True, position=99)
        board.configure(JOINTS)
        board.enable()
        assert board.status().measured[1] == 99


@pytest.mark.parametrize(("dip_us", "heard"), [(5, True), (50, True), (150, False)])
def test_noise_on_a_chain_is_filtered_or_counts_as_silence_and_never_changes_a_value(dip_us, heard):
    with bench() as chip:
        plug_in(chip, JOINTS)
        board = ready(chip)
        for _ in range(10):
            board.clock.sleep(0.04)
            status = board.status()
        good = status.measured[:4]
        np.testing.assert_array_equal(good, status.commanded[:4])
        chip.dip(0, dip_us)
        for _ in range(16):
            board.clock.sleep(0.04)
            status = board.status()
            measured = status.measured[:4]
            np.testing.assert_array_equal(measured, np.where(np.isnan(measured), np.nan, good))
        assert status.fault is (Fault.NONE if heard else Fault.SERVO), "three silences in a row are a lost servo"


def test_a_servo_that_answers_only_while_limp_can_be_driven():
    with bench() as chip:
        plug_in(chip, JOINTS)
        for place in range(4):
            chip.mute(0, place)
        board = ready(chip)
        raw = board.status().commanded.astype(int)
        raw[:4] += 20
        board.move(raw.tolist())
        for _ in range(50):
            board.clock.sleep(0.04)
            status = board.status()
        assert status.fault is Fault.NONE
        assert [chip.position(0, place) for place in range(4)] == raw[:4].tolist()


def test_limp_servos_follow_the_hand_and_hold_where_it_leaves_them():
    with bench() as chip:
        plug_in(chip, JOINTS)
        board = ready(chip)
        board.limp([0, 3])
        chip.hand(0, 0, 77)
        chip.hand(0, 1, 200)
        for _ in range(12):
            board.clock.sleep(0.04)
            status = board.status()
        assert status.measured[0] == 77
        assert status.measured[1] != 200, "not limp"
        board.limp([])
        chip.hand(0, 0, -1)
        for _ in range(12):
            board.clock.sleep(0.04)
            status = board.status()
        assert status.commanded[0] == 77
        with pytest.raises(hardware.BoardError, match="right_wrist_roll have no read-back"):
            board.limp([4])


def test_a_board_drives_nothing_without_the_right_calibration():
    with bench() as chip:
        plug_in(chip, JOINTS)
        clock = VirtualClock()
        board = FirmwareBoard("bench", FaultyLink(chip, clock, byte_s=chip.byte_s), clock)
        board.configure(JOINTS)
        board._joints = hardware.JointMap("another robot", JOINTS.joints)
        with pytest.raises(hardware.BoardError, match="another one than asked for"):
            board.enable()
        clock.sleep(0.2)
        board.stop()
        assert len(chip.pulses()) == 0


def test_missing_tools_are_named_and_fail_in_ci(monkeypatch):
    monkeypatch.setattr(firmware, "missing", lambda: "avr-gcc")
    monkeypatch.delenv("JAXIK_REQUIRE_FIRMWARE", raising=False)
    with pytest.raises(pytest.skip.Exception, match=r"need gcc-avr .*; missing: avr-gcc"):
        firmware.require()
    monkeypatch.setenv("JAXIK_REQUIRE_FIRMWARE", "1")
    with pytest.raises(pytest.fail.Exception, match=r"need gcc-avr .*; missing: avr-gcc"):
        firmware.require()


@pytest.mark.parametrize("budget", ["FLASH_BUDGET=8000", "STATIC_BUDGET=1000", "FRAME_BUDGET=20"])
def test_a_build_over_budget_fails(budget, tmp_path):
    firmware.require()
    firmware.run("make", "-s", "-C", firmware.FIRMWARE, f"BUILD={tmp_path}/fits")
    with pytest.raises(AssertionError, match=r"Over budget|stack usage"):
        firmware.run("make", "-s", "-C", firmware.FIRMWARE, f"BUILD={tmp_path}/over", budget)


def test_supply_and_stack():
    with bench() as chip:
        plug_in(chip, JOINTS)
        board = ready(chip)
        ramp(board, 0.6)
        board.start(0)
        for _ in range(40):
            board.clock.sleep(0.04)
            status = board.status()
        assert abs(status.supply_v - 5.0) < 0.1
        assert chip.stack_left() > 200
        assert CHAINS * PLACES == 8
