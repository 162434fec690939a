"""The simulated board refuses what the firmware refuses."""

import numpy as np
import pytest

import hardware
from hardware import Fault, State, Waypoint

JOINTS = hardware.ideal_joint_map(["a"])


def ready(**options):
    board = hardware.connect("simulated", **options)
    assert board.configure(JOINTS) == JOINTS.crc
    board.enable()
    return board


def test_it_interpolates_between_waypoints_at_its_own_frames():
    board = ready()
    board.send([Waypoint(0, 100_000, (1000,)), Waypoint(1, 200_000, (3000,), last=True)])
    board.start(0)
    board.clock.sleep(0.15)
    assert board.status().commanded[0] == 1800  # the last frame was at 140 ms
    board.clock.sleep(0.15)
    status = board.status()
    assert status.done
    assert status.state is State.HOLDING
    assert status.fault is Fault.NONE
    assert status.commanded[0] == 3000


@pytest.mark.parametrize(
    ("waypoints", "fault"),
    [
        ([Waypoint(0, 100_000, (99_999,))], Fault.RANGE),
        ([Waypoint(1, 100_000, (0,))], Fault.ORDER),
        ([Waypoint(i, 100_000 * (i + 1), (0,)) for i in range(33)], Fault.ORDER),
    ],
)
def test_bad_waypoints_are_faults(waypoints, fault):
    board = ready()
    board.send(waypoints)
    assert board.status().fault is fault


def test_a_late_waypoint_is_a_fault_never_a_jump():
    board = ready()
    board.send([Waypoint(0, 100_000, (100,))])
    board.start(0)
    board.clock.sleep(0.09)
    board.send([Waypoint(1, 60_000, (20_000,), last=True)])
    assert board.status().fault is Fault.LATE
    board.clock.sleep(0.2)
    assert abs(board.status().commanded[0]) < 300


def test_a_rate_above_the_limit_is_a_fault():
    board = ready()
    board.send([Waypoint(0, 40_000, (20_000,), last=True)])  # 2 rad in two frames
    board.start(0)
    board.clock.sleep(0.1)
    assert board.status().fault is Fault.RATE
    assert board.status().commanded[0] == 0


def test_an_underrun_brakes_to_a_hold_within_the_rate():
    board = ready()
    board.send([Waypoint(0, 200_000, (5000,))])  # 2.5 rad/s, and no last waypoint
    board.start(0)
    board.clock.sleep(0.29)
    board.status()
    board.clock.sleep(0.29)
    assert board.status().fault is Fault.UNDERRUN
    steps = np.diff([pulse.commanded[0] for pulse in board.log])
    assert np.abs(steps).max() <= JOINTS.column("max_rate")[0] * 1e4 * 0.02 + 2
    assert steps[-1] == 0
    assert (np.diff(steps[9:]) <= 0).all(), "slows down without starting again"


def test_nothing_moves_before_it_is_configured():
    board = hardware.connect("simulated")
    with pytest.raises(hardware.BoardError, match="before it has been configured"):
        board.enable()


def test_a_pose_for_other_joints_is_refused():
    with pytest.raises(hardware.BoardError, match="stand at 2 angles; the robot has 1"):
        ready(pose=[0.0, 0.0])
