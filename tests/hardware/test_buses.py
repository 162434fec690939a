"""Servos on a bus: whole playbacks against byte-level fakes that garble replies."""

import numpy as np
import pytest

import hardware
from hardware import Fault, PlayResult, State, Waypoint
from hardware.boards.dynamixel import DynamixelBoard
from hardware.boards.feetech import FeetechBoard
from hardware.boards.maestro import MaestroBoard
from hardware.clock import VirtualClock, WallClock
from jaxik import Trajectory
from tests.helpers.servo_bus import DynamixelBus, FeetechBus, Maestro

NAMES = tuple(f"joint {i}" for i in range(1, 8))
TIMES = np.linspace(0, 0.8, 21)
TRAJECTORY = Trajectory(TIMES, 0.4 * np.sin(2 * TIMES)[:, None] * np.linspace(0.3, 1, 7), NAMES)
KINDS = {"dynamixel": (DynamixelBus, DynamixelBoard), "feetech": (FeetechBus, FeetechBoard)}


class SlowClock(WallClock):
    """A quarter of wall time, the only time the SDKs know: a busy test machine then keeps up with real servos."""

    def now(self):
        return super().now() / 4

    def sleep(self, seconds):
        super().sleep(4 * seconds)


def joints(**changes):
    """Return a calibration of seven servos, 4096 steps per turn, numbers 1 to 7."""
    common = {"raw_low": 0, "raw_high": 4095, "neutral": 2048.0, "raw_per_rad": 4096 / (2 * np.pi), "sign": 1}
    common |= {"lower": -1.5, "upper": 1.5, "max_rate": 4.0, "safe": 0.0, "readback": True} | changes
    rows = [hardware.JointCalibration(name=name, channel=str(i), **common) for i, name in enumerate(NAMES, 1)]
    return hardware.JointMap("bus", tuple(rows))


@pytest.mark.parametrize("corrupt", [0.0, 0.004])
@pytest.mark.parametrize("kind", KINDS)
def test_a_playback_on_a_bus(kind, corrupt):
    fake, board_class = KINDS[kind]
    bus = fake(range(1, 8), corrupt=corrupt)
    with board_class(bus.port, clock=SlowClock()) as board:
        report = hardware.play(TRAJECTORY, board, joints(), park=False)
        assert report.result is PlayResult.SUCCESS, report.message
        assert np.nanmax(report.tracking.worst) < 0.1
        end = joints().to_raw(TRAJECTORY.q[-1])
        assert [bus.get(i, bus.goal_at) for i in range(1, 8)] == end.tolist()
        if corrupt:
            assert bus.corrupted > 5
            assert board.retries > 0
        else:
            assert board.retries <= 10  # of hundreds: a busy machine may exceed the SDK's timeout
    assert bus.driven() == [], "released"
    bus.close()


@pytest.mark.parametrize("kind", KINDS)
def test_a_missing_servo_is_reported(kind):
    fake, board_class = KINDS[kind]
    bus = fake(range(1, 7))
    with board_class(bus.port) as board, pytest.raises(hardware.LinkError, match="a servo could not be switched off"):
        board.configure(joints())
    bus.close()


@pytest.mark.parametrize("kind", KINDS)
def test_a_missing_port_is_reported(kind):
    with pytest.raises(hardware.BoardError, match=r"/dev/none cannot be opened"):
        hardware.connect(f"{kind}:/dev/none")


def test_channels_are_checked():
    bus = FeetechBus(range(1, 8))
    with FeetechBoard(bus.port) as board:
        rows = [hardware.JointCalibration(**(vars(joint) | {"channel": "D2"})) for joint in joints().joints]
        with pytest.raises(hardware.BoardError, match="joint 1 needs a channel 0 to 253, its servo's number; got 'D2'"):
            board.configure(hardware.JointMap("x", tuple(rows)))
        same = [hardware.JointCalibration(**(vars(joint) | {"channel": "3"})) for joint in joints().joints]
        with pytest.raises(hardware.BoardError, match="two joints have channel 3"):
            board.configure(hardware.JointMap("x", tuple(same)))
    bus.close()


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
