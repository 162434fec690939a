"""The simulated board: interpolation, refusals, braking and silence as in the firmware."""

import numpy as np
import pytest

import hardware
from hardware import Fault, State, Waypoint

JOINTS = hardware.ideal_joint_map(["a"])
ZERO = 32768  # raw value of an ideal servo at zero radians


def ready(**options):
    board = hardware.connect("simulated", **options)
    assert board.configure(JOINTS) == JOINTS.crc
    board.enable()
    return board


def test_it_interpolates_between_waypoints_at_its_own_frames():
    board = ready()
    board.send([Waypoint(0, 100_000, (ZERO + 1000,)), Waypoint(1, 200_000, (ZERO + 3000,), last=True)])
    board.start(0)
    began = board.model.executor.start_us
    board.clock.sleep(0.15)
    board.status()
    frame = board.log[-1]
    np.testing.assert_allclose(frame.commanded[0] - ZERO, 1000 + 20 * (frame.time_us - began - 100_000) / 1000, atol=2)
    board.clock.sleep(0.15)
    status = board.status()
    assert status.done
    assert status.state is State.HOLDING
    assert status.fault is Fault.NONE
    assert status.commanded[0] == ZERO + 3000


@pytest.mark.parametrize(
    ("waypoints", "fault"),
    [
        ([Waypoint(0, 100_000, (1300,))], Fault.RANGE),
        ([Waypoint(1, 100_000, (ZERO,))], Fault.ORDER),
        ([Waypoint(i, 100_000 * (i + 1), (ZERO,)) for i in range(33)], Fault.ORDER),
        ([Waypoint(0, 1_100_000, (ZERO,))], Fault.ORDER),
        ([Waypoint(0, 40_000, (ZERO + 10_000,))], Fault.RATE),
    ],
    ids=["range", "index", "too many", "gap", "rate"],
)
def test_bad_waypoints_are_faults_and_move_nothing(waypoints, fault):
    board = ready()
    board.send(waypoints)
    assert board.status().fault is fault
    with pytest.raises(hardware.BoardError, match=f"cannot start: it is holding still, fault {fault.name}"):
        board.start(0)
    board.clock.sleep(0.2)
    assert board.status().commanded[0] == ZERO


def test_between_waypoints_closer_than_a_step_of_its_clock_it_is_at_the_later():
    board = ready()
    board.send([Waypoint(0, 10, (ZERO,)), Waypoint(1, 100_000, (ZERO + 1000,), last=True)])
    assert board.status().fault is Fault.NONE
    assert [board.model.executor.queue.at_time(0, time) for time in (0, 9, 10)] == [16 * ZERO] * 3


def test_a_late_waypoint_is_a_fault_never_a_jump():
    board = ready()
    board.send([Waypoint(0, 100_000, (ZERO + 100,))])
    board.start(0)
    board.clock.sleep(0.06)
    board.send([Waypoint(1, 20_000, (ZERO + 300,), last=True)])
    assert board.status().fault is Fault.LATE
    board.clock.sleep(0.2)
    assert abs(board.status().commanded[0] - ZERO) < 200


def test_an_underrun_brakes_to_a_hold_before_the_last_waypoint():
    board = ready()
    board.send([Waypoint(0, 200_000, (ZERO + 2500,))])  # 2.5 rad/s, and no last waypoint
    board.start(0)
    for _ in range(6):
        board.clock.sleep(0.1)
        status = board.status()
    assert status.fault is Fault.UNDERRUN
    assert 2000 < status.commanded[0] - ZERO <= 2500
    steps = np.diff([frame.commanded[0] for frame in board.log])
    assert steps.max() <= 2500 * 0.02 / 0.2 + 1
    assert steps[-1] == 0
    moving = steps[np.argmax(steps > 0) + 1 :]
    assert (np.diff(moving) <= 1).all(), "slows down without speeding up again"


def test_silence_brings_it_to_rest_in_time_and_then_releases():
    board = ready()
    board.send([Waypoint(i, 100_000 * (i + 1), (ZERO + 400 * (i + 1),)) for i in range(30)])
    board.start(0)
    heard = board.model.now_us
    board.model.run(heard + 3_000_000)
    at = np.array([frame.time_us for frame in board.log]) - heard
    commanded = np.array([frame.commanded[0] for frame in board.log])
    assert np.ptp(commanded[(at > 0) & (at < 200_000)]) > 0
    assert np.ptp(commanded[at > 300_000]) == 0
    assert board.status().fault is Fault.SILENCE
    assert board.status().state is State.DETACHED


def test_a_jog_keeps_the_rate_and_reaches_its_goal():
    board = ready()
    board.move([ZERO + 3000])
    for _ in range(30):
        board.clock.sleep(0.02)
        board.status()
    steps = np.diff([frame.commanded[0] for frame in board.log])
    assert 0 < steps.max() <= 2 * np.pi * 5000 * 0.02 + 1
    assert board.status().commanded[0] == ZERO + 3000
    with pytest.raises(hardware.BoardError, match="does not move there: a: a waypoint lies outside"):
        board.move([0])


def test_nothing_moves_before_it_is_configured():
    board = hardware.connect("simulated")
    with pytest.raises(hardware.BoardError, match="before it has been configured"):
        board.enable()


def test_a_pose_for_other_joints_is_refused():
    with pytest.raises(hardware.BoardError, match="stand at 2 angles; the calibration has 1"):
        ready(pose=[0.0, 0.0])


def test_a_restarted_board_is_noticed():
    board = ready()
    board.model.reset()
    with pytest.raises(hardware.LinkError, match="restarted"):
        board.status()


def test_servos_of_the_shipped_calibration_are_found_and_answer():
    joints = hardware.load_joint_map("meccanoid.toml")
    board = hardware.connect("simulated")
    assert board.configure(joints) == joints.crc
    status = board.status()
    np.testing.assert_array_equal(np.isnan(status.measured), ~joints.column("readback"))
    assert board.queue_depth >= 25
    board.enable()
    for _ in range(10):  # each answers while driven
        board.clock.sleep(0.04)
        assert board.status().fault is Fault.NONE
    board.model.modules[0].unplug(2)
    board.clock.sleep(1.0)
    status = board.status()
    assert status.fault is Fault.SERVO
    assert joints.names[status.joint] == "right_upper_arm_roll"
