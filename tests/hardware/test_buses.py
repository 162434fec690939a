"""Servos on a bus: whole playbacks against byte-level fakes, what protects people, and what is said of each fault."""

import numpy as np
import pytest

import hardware
from hardware import Fault, PlayResult, State, Waypoint
from hardware.boards.dynamixel import DynamixelBoard
from hardware.boards.feetech import FeetechBoard
from hardware.boards.maestro import MaestroBoard
from hardware.clock import VirtualClock, WallClock
from jaxik import Trajectory
from tests.helpers.servo_bus import DynamixelBus, FeetechBus, Maestro, OnPort

NAMES = tuple(f"joint {i}" for i in range(1, 8))
TIMES = np.linspace(0, 0.8, 21)
TRAJECTORY = Trajectory(TIMES, 0.4 * np.sin(2 * TIMES)[:, None] * np.linspace(0.3, 1, 7), NAMES)
KINDS = {"dynamixel": (DynamixelBus, DynamixelBoard, 57_600), "feetech": (FeetechBus, FeetechBoard, 1_000_000)}
TORQUE = {"dynamixel": 64, "feetech": 40}
GOAL = {"dynamixel": 116, "feetech": 42}
OVERLOAD, OVERHEATING = 5, 2


class SlowClock(WallClock):
    """A quarter of wall time: a busy test machine then keeps up with real servos."""

    def now(self):
        return super().now() / 4

    def sleep(self, seconds):
        super().sleep(4 * seconds)


def joints(names=NAMES, **changes):
    """Return a calibration of servos with 4096 steps per turn, numbers 1, 2, ..."""
    common = {"raw_low": 0, "raw_high": 4095, "neutral": 2048.0, "raw_per_rad": 4096 / (2 * np.pi), "sign": 1}
    common |= {"lower": -1.5, "upper": 1.5, "max_rate": 4.0, "safe": 0.0, "readback": True} | changes
    rows = [hardware.JointCalibration(name=name, channel=str(i), **common) for i, name in enumerate(names, 1)]
    return hardware.JointMap("bus", tuple(rows))


def connected(kind, ids=range(1, 8), **options):
    """Return a bus in memory and the board on it."""
    fake, board_class, baud = KINDS[kind]
    bus = fake(ids, baud=baud, **options)
    return bus, board_class("PORT", transport=bus, clock=bus.clock)


def play(board, trajectory=TRAJECTORY, calibration=None, **options):
    with board:
        return hardware.play(trajectory, board, calibration or joints(), park=False, **options)


@pytest.mark.parametrize("disturbed", [0.0, 0.04])
@pytest.mark.parametrize("kind", KINDS)
def test_a_playback_on_a_bus(kind, disturbed):
    bus, board = connected(kind, lose=disturbed / 2, garble=disturbed / 2)
    report = play(board)
    assert report.result is PlayResult.SUCCESS, report.message
    assert np.nanmax(report.tracking.worst) < 0.1
    end = joints().to_raw(TRAJECTORY.q[-1])
    assert [bus.get(i, bus.goal_at) for i in range(1, 8)] == end.tolist()
    assert [bus.get(i, bus.position_at) for i in range(1, 8)] == pytest.approx(end, abs=1)
    assert (board.retries > 1) == (bus.disturbed > 5) == (disturbed > 0)
    assert all(torque for torque, _ in bus.released_from.values()), "all held until the end"
    assert bus.unguarded == []
    assert bus.driven() == [], "released"
    assert bus.closed


@pytest.mark.parametrize("kind", KINDS)
def test_a_playback_over_a_real_port(kind):
    fake, board_class, _ = KINDS[kind]
    line = OnPort(fake(range(1, 8), clock=SlowClock()))
    with board_class(line.port, clock=SlowClock()) as board:
        with pytest.raises(hardware.BoardError, match="does another program hold it"):
            hardware.connect(f"{kind}:{line.port}")
        report = hardware.play(TRAJECTORY, board, joints(), park=False)
    assert report.result is PlayResult.SUCCESS, report.message
    assert line.bus.driven() == []
    board_class(line.port).close()  # free again
    line.close()


# ---- who answers ----


@pytest.mark.parametrize("kind", KINDS)
def test_missing_servos_are_named(kind):
    _, board = connected(kind, range(1, 7))
    report = play(board)
    assert report.result is PlayResult.LINK_LOST
    baud = KINDS[kind][2]
    assert report.message == (
        f"{kind}:PORT: joint 7 (servo 7) does not answer at {baud} baud, the other 6 do; check the plug and the ID: "
        f"`jaxik scan {kind}:PORT` lists what is on the line"
    )
    assert "joint 7 (servo 7) could not be switched off" in report.warnings[-1]


@pytest.mark.parametrize("kind", KINDS)
def test_a_line_without_servos(kind):
    """No power, a wrong rate, a wrong port: the sentence asks for all three and offers the scan."""
    _, board = connected(kind, range(11, 14))
    with board, pytest.raises(hardware.LinkError, match=r"none of the 7 servos answers at \d+ baud; is the supply on"):
        board.configure(joints())


@pytest.mark.parametrize("kind", KINDS)
def test_a_missing_port_is_reported(kind):
    with pytest.raises(hardware.BoardError, match=r"/dev/none cannot be opened"):
        hardware.connect(f"{kind}:/dev/none")


def test_channels_are_checked():
    _, board = connected("feetech")
    with board:
        rows = [hardware.JointCalibration(**(vars(joint) | {"channel": "D2"})) for joint in joints().joints]
        with pytest.raises(hardware.BoardError, match="joint 1 needs a channel 0 to 253, its servo's number; got 'D2'"):
            board.configure(hardware.JointMap("x", tuple(rows)))
        same = [hardware.JointCalibration(**(vars(joint) | {"channel": "3"})) for joint in joints().joints]
        with pytest.raises(hardware.CalibrationError, match=r"joint 1 and joint 2 .* one channel, '3'"):
            board.configure(hardware.JointMap("x", tuple(same)))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("who", ["one", "all"])
def test_silence_in_mid_motion_is_a_lost_link(kind, who):
    bus, board = connected(kind)
    ids = {4} if who == "one" else set(range(1, 8))
    bus.events.append((1.4, lambda: bus.gone.update(ids)))
    report = play(board)
    assert report.result is PlayResult.LINK_LOST, report.message
    assert ("joint 4 (servo 4) does not answer" if who == "one" else "none of the 7 servos answers") in report.message
    assert bus.clock.now() < 3.5
    assert all(i in ids for i in bus.driven()), "all that can be reached are released"


@pytest.mark.parametrize("kind", KINDS)
def test_a_port_that_vanishes_is_a_lost_link(kind):
    bus, board = connected(kind)
    bus.events.append((1.4, lambda: setattr(bus, "vanished", True)))
    report = play(board)
    assert report.result is PlayResult.LINK_LOST
    assert "the link to the board is gone" in report.message


# ---- positions ----


@pytest.mark.parametrize(
    ("kind", "mode", "start", "angle_deg"),
    [
        ("feetech", 0, -5, -180.44),
        ("feetech", 0, -1, -180.09),
        ("feetech", 0, 4100, 180.35),
        ("feetech", 0, 2048, 0.0),
        ("dynamixel", 4, -5, -180.44),
        ("dynamixel", 4, 17 * 4096 + 2048, 17 * 360.0),
        ("dynamixel", 4, -3 * 4096 + 2048, -3 * 360.0),
        # In position mode the servo forgets whole turns when it is driven.
        ("dynamixel", 3, -5, 179.56),
        ("dynamixel", 3, 17 * 4096 + 2048, 0.0),
        ("dynamixel", 3, -3 * 4096 + 1024, -90.0),
    ],
)
def test_positions_are_signed_and_count_turns(kind, mode, start, angle_deg):
    bus, board = connected(kind, [1], start=start)
    bus.memory[1][bus.mode_at] = mode
    calibration = joints(NAMES[:1])
    with board:
        board.configure(calibration)
        measured = np.degrees(calibration.to_rad(board.status().measured))
    assert measured == pytest.approx([angle_deg], abs=0.05)


def test_dynamixel_with_a_homing_offset_counts_from_it():
    bus, board = connected("dynamixel", [1], start=4096 * 5 - 300)
    bus.memory[1][20:24] = (-500).to_bytes(4, "little", signed=True)
    with board:
        board.configure(joints(NAMES[:1]))
        assert board.status().measured.tolist() == [-300]


@pytest.mark.parametrize("kind", KINDS)
def test_a_sag_below_zero_in_mid_motion_is_a_few_steps(kind):
    """A servo that gives way to three steps below zero is three steps off, not a turn and not sixteen."""
    low = joints(NAMES[:1], neutral=0.0, lower=0.0, upper=2.0)
    times = np.linspace(0, 1, 26)
    still = Trajectory(times, np.full((26, 1), 0.01), NAMES[:1])
    bus, board = connected(kind, [1], start=7)
    bus.events.append((1.2, lambda: bus.at.update({1: -3.0})))
    bus.stopped = lambda memory: 1.2 < bus.clock.now() < 1.3
    report = play(board, still, low)
    assert report.result is PlayResult.SUCCESS, report.message
    measured = report.log.measured[:, 0] * 4096 / (2 * np.pi)
    assert measured.min() == pytest.approx(-3)


def test_a_servo_that_counts_turns_plays_below_zero():
    bus, board = connected("dynamixel", [1], start=-4096)
    bus.memory[1][bus.mode_at] = 4
    below = joints(NAMES[:1], raw_low=-6000, raw_high=-2000, neutral=-4096.0)
    report = play(board, TRAJECTORY_OF_ONE, below)
    assert report.result is PlayResult.SUCCESS, report.message
    assert bus.at[1] == pytest.approx(below.to_raw(TRAJECTORY_OF_ONE.q[-1])[0], abs=1)


TRAJECTORY_OF_ONE = Trajectory(TIMES, TRAJECTORY.q[:, 6:], NAMES[:1])


def test_a_servo_wound_up_is_refused_not_unwound():
    bus, board = connected("dynamixel", [1], start=17 * 4096 + 2048)
    bus.memory[1][bus.mode_at] = 4
    report = play(board, TRAJECTORY_OF_ONE, joints(NAMES[:1]))
    assert report.result is PlayResult.LIMIT
    assert report.message.startswith("joint 1 stands 6120° from the first posture")
    assert bus.driven() == []


@pytest.mark.parametrize("kind", KINDS)
def test_one_impossible_reading_is_asked_again(kind):
    bus, board = connected(kind)
    load, wrong = bus.load, []

    def load_wrong(servo, address, length):
        data = load(servo, address, length)
        if address == bus.position_at and servo == 3 and bus.clock.now() > 1.2 + 0.1 * len(wrong):
            wrong.append(bus.clock.now())
            return (30_000).to_bytes(length, "little")
        return data

    bus.load = load_wrong
    report = play(board)
    assert report.result is PlayResult.SUCCESS, report.message
    assert len(wrong) > 3
    assert np.degrees(np.abs(report.log.measured)).max() < 30


@pytest.mark.parametrize("kind", KINDS)
def test_a_reading_that_stays_is_believed(kind):
    bus, board = connected(kind)
    bus.events.append((1.5, lambda: bus.store(3, bus.mode_at, b"\0") or bus.at.update({3: 3400.0})))
    bus.get = lambda servo, address, get=bus.get: 3400 if servo == 3 and bus.clock.now() > 1.5 else get(servo, address)
    report = play(board)
    assert report.result is PlayResult.PATH_TOLERANCE
    assert report.message.startswith("joint 3 is ")


# ---- what protects people ----


def test_a_watchdog_that_is_not_set_is_a_refusal():
    bus, board = connected("dynamixel")
    bus.deaf_to.add(98)
    with board, pytest.raises(hardware.BoardError, match=r"joint 1 \(servo 1\) does not take its watchdog.* reads 0"):
        board.configure(joints())
    assert bus.unguarded == []
    assert bus.driven() == []


def test_a_watchdog_lost_before_the_start_is_set_again():
    bus, board = connected("dynamixel")
    with board:
        board.configure(joints())
        bus.memory[5][98] = 0  # the servo was without power for a moment
        board.enable()
        assert bus.memory[5][98] == 100


def test_a_watchdog_that_triggers_stops_the_playback():
    bus, board = connected("dynamixel")
    bus.events.append((1.6, lambda: bus.memory[2].__setitem__(98, 0xFF)))
    report = play(board)
    assert report.result is PlayResult.SERVO_FAULT, report.message
    assert "joint 2 (servo 2) has lost its watchdog or was stopped by it (register 98 reads 255" in report.message
    with connected("dynamixel")[1] as board:  # the next playback clears it
        board.configure(joints())


@pytest.mark.parametrize("kind", KINDS)
def test_a_first_goal_that_does_not_arrive_is_a_refusal(kind):
    """Driven with an old goal a servo would jump there."""
    bus, board = connected(kind)
    for i in range(1, 8):
        bus.put(i, bus.goal_at, 3000)
    bus.deaf_to.add(GOAL[kind])
    with board:
        board.configure(joints())
        with pytest.raises(hardware.BoardError, match=r"joint 1 \(servo 1\) does not take its first goal"):
            board.enable()
    assert set(bus.at.values()) == {2048.0}


@pytest.mark.parametrize("kind", KINDS)
def test_a_servo_that_stays_off_is_a_refusal(kind):
    bus, board = connected(kind)
    bus.deaf_to.add(TORQUE[kind])
    with board:
        board.configure(joints())
        with pytest.raises(hardware.BoardError, match="does not take being switched on"):
            board.enable()


@pytest.mark.parametrize("kind", KINDS)
def test_a_servo_that_goes_off_is_no_success(kind):
    """It has lost power for a moment, or another program released it; the position alone would not tell."""
    bus, board = connected(kind)
    bus.events.append((1.5, lambda: bus.memory[4].__setitem__(bus.torque_at, 0)))
    report = play(board)
    assert report.result is PlayResult.SERVO_FAULT, report.message
    assert report.message.startswith("joint 4 (servo 4) no longer holds")
    assert bus.driven() == []


@pytest.mark.parametrize(("bit", "name"), [(OVERLOAD, "overload"), (OVERHEATING, "overheating"), (0, "voltage")])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("at_s", [-1.0, 1.5, 1.64])
def test_alerts_are_named_and_stop(kind, bit, name, at_s):
    bus, board = connected(kind)
    bus.events.append((at_s, lambda: bus.alarm(6, bit)))
    report = play(board)
    assert report.result is PlayResult.SERVO_FAULT, report.message
    assert report.message.startswith("joint 6 (servo 6) reports ")
    assert name in report.message
    assert (" at 12.0 V; " if kind == "dynamixel" else " at 7.4 V; ") in report.message
    assert bus.driven() == []
    assert (len(report.log.time) > 0) == (at_s > 0), "an alert at the start moves nothing"
    if at_s > 0:
        assert bus.released_s < at_s + 0.12, "every answer tells of it"


def test_a_servo_in_another_mode_is_refused():
    for kind, mode, register in (("dynamixel", 1, 11), ("feetech", 1, 33)):
        bus, board = connected(kind)
        bus.memory[2][bus.mode_at] = mode
        with (
            board,
            pytest.raises(hardware.BoardError, match=rf"joint 2 .* velocity mode .* register {register} to"),
        ):
            board.configure(joints())


def test_a_servos_own_limits_count():
    bus, board = connected("feetech")
    bus.memory[2][9:13] = (1500).to_bytes(2, "little") + (2500).to_bytes(2, "little")
    with (
        board,
        pytest.raises(hardware.BoardError, match=r"from raw 1070 to 3026, and its servo is set to"),
    ):
        board.configure(joints())


def test_a_servo_beyond_its_own_limits_is_not_driven():
    """It would rush to its limit."""
    bus, board = connected("feetech", start=4000)
    bus.memory[1][9:13] = (1000).to_bytes(2, "little") + (3100).to_bytes(2, "little")
    with board:
        board.configure(joints())
        with pytest.raises(hardware.BoardError, match="stands at raw 4000, and takes goals from 1000 to 3100; turn it"):
            board.enable()
    assert bus.driven() == []


@pytest.mark.parametrize("kind", KINDS)
def test_a_goal_that_is_lost_arrives_later(kind):
    bus, board = connected(kind)
    with board:
        board.configure(joints())
        board.enable()
        board.status()
        board.move([2100] * 7)
        answer = bus.answer
        bus.answer = lambda servo, what, rest: () if what == 0x83 else answer(servo, what, rest)
        for _ in range(20):
            board.clock.sleep(0.01)
            board.status()
        assert set(bus.at.values()) == {2048.0}
        bus.answer = answer
        for _ in range(40):
            board.clock.sleep(0.01)
            board.status()
        assert set(bus.at.values()) == {2100.0}


# ---- a Maestro, and what all boards share whose host keeps the time ----


def hobby():
    return joints(raw_low=500, raw_high=2500, neutral=1500.0, raw_per_rad=600.0, readback=False)


@pytest.mark.parametrize("lose", [0.0, 0.02])
def test_a_playback_on_a_maestro(lose):
    fake = Maestro(lose)
    with MaestroBoard(transport=fake, clock=VirtualClock()) as board:
        report = hardware.play(TRAJECTORY, board, hobby(), park=False)
        assert report.result is PlayResult.SUCCESS, report.message
        assert (board.retries > 0) == (fake.lost > 0) == (lose > 0)
    sent = np.array([target for servo, target in fake.history if servo == 7 and target])
    planned = hobby().to_raw(TRAJECTORY.q)[:, 6] * 4
    assert planned.min() <= sent.min()
    assert sent.max() <= planned.max()
    assert np.abs(np.diff(sent)).max() <= 4.0 * 600 * 0.02 * 4 + 8
    assert set(fake.targets.values()) == {0}, "all pulses ended"
    assert fake.closed


def test_a_maestro_has_no_read_back():
    with MaestroBoard(transport=Maestro(), clock=VirtualClock()) as board:
        with pytest.raises(hardware.BoardError, match="a Maestro has none"):
            board.configure(joints())
        board.configure(hobby())
        board.enable()
        with pytest.raises(hardware.BoardError, match="cannot be taught by hand"):
            board.limp([0])


def test_a_host_that_was_away_does_not_jump():
    with MaestroBoard(transport=Maestro(), clock=VirtualClock()) as board:
        board.configure(hobby())
        board.enable()
        board.send([Waypoint(i, 50_000 * (i + 1), (1500 + 20 * (i + 1),) * 7) for i in range(20)])
        board.start(0)
        for _ in range(10):
            board.clock.sleep(0.02)
            before = board.status().commanded[0]
        board.clock.sleep(0.3)
        status = board.status()
        assert status.fault is Fault.UNDERRUN
        assert status.state is State.HOLDING
        assert status.commanded[0] == before


@pytest.mark.parametrize("kind", KINDS)
def test_servos_go_limp_and_hold_where_they_were_put(kind):
    bus, board = connected(kind)
    with board:
        board.configure(joints())
        board.enable()
        board.limp([2, 4])
        assert bus.driven() == [1, 2, 4, 6, 7]
        bus.at[3] = 2500.0
        for _ in range(5):
            board.clock.sleep(0.1)
            assert board.status().measured[2] == 2500
        board.limp([])
        assert bus.driven() == list(range(1, 8))
        for _ in range(5):
            board.clock.sleep(0.1)
            board.status()
        assert bus.at[3] == 2500.0
