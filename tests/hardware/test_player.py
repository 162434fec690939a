"""The player: every outcome, nothing forbidden moved, smooth from the present posture, always released."""

import numpy as np
import pytest

import hardware
from hardware import PlayResult, State, schedule
from jaxik import Trajectory
from jaxik.errors import JaxikError

TIME = np.linspace(0.0, 4.0, 101)
TRAJECTORY = Trajectory(TIME, np.stack([np.sin(TIME), 0.5 * np.cos(TIME)], -1), ("a", "b"))


def play(trajectory=TRAJECTORY, simulated=(), **options):
    with hardware.connect("simulated", **dict(simulated)) as board:
        return hardware.play(trajectory, board, **options), board


def commanded(board, joints=("a", "b")):
    """Return the commands of every servo frame [rad]."""
    return hardware.ideal_joint_map(joints).to_rad(np.array([frame.commanded for frame in board.log]))


def test_a_success_follows_the_trajectory_and_releases():
    report, board = play()
    assert report.result is PlayResult.SUCCESS
    assert report.ok
    assert report.status is report.result
    assert report.raise_if_invalid() is report
    q = commanded(board)
    rows = np.array([p == "play" for p in report.log.phase])
    start = report.log.time[rows][0]
    asked = TRAJECTORY.sample(report.log.time[rows] - start)
    deviation = np.abs(report.log.commanded[rows] - asked).max()
    assert deviation < 1.2 * 0.06, "at most three frames late, at 1 rad/s"
    np.testing.assert_allclose(q.max(0), TRAJECTORY.q.max(0), atol=2e-3)
    assert report.tracking.worst.shape == (2,)
    assert 0.005 < report.tracking.worst[0] < 0.1, "the simulated servo lags by 40 ms at 1 rad/s"
    assert board.status().state is State.DETACHED


def test_the_same_run_gives_the_same_log():
    (one, board), (two, other) = play(), play()
    np.testing.assert_array_equal(one.log.measured, two.log.measured)
    np.testing.assert_array_equal(commanded(board), commanded(other))


def test_it_eases_in_from_where_the_arm_stands_without_a_jump():
    _, board = play(simulated={"pose": [-2.0, 1.5]})
    q = commanded(board)
    np.testing.assert_allclose(q[0], [-2.0, 1.5], atol=1e-3)
    step = np.abs(np.diff(q, axis=0)) / 0.02
    assert step.max() <= 0.5 * 2 * np.pi + 0.02, "half of the ideal servos' rate"
    acceleration = np.abs(np.diff(q[:20], n=2, axis=0)) / 0.02**2
    assert acceleration.max() < 10, "starts at rest"


def test_half_speed_takes_twice_as_long():
    whole, half = play(park=False)[0], play(park=False, speed=0.5)[0]
    assert abs((half.duration - whole.duration) - 4.0) < 0.1


@pytest.mark.parametrize(
    ("simulated", "options", "result", "said"),
    [
        ({}, {"speed": 9.0}, PlayResult.LIMIT, "play at speed 6.28 or below"),
        ({"pose": [-3.5, 0.0]}, {}, PlayResult.LIMIT, "move the arm nearer"),
        ({"stuck": ["a"]}, {}, PlayResult.PATH_TOLERANCE, "a is 2"),
        ({"unplugged_at_s": 2.5}, {}, PlayResult.LINK_LOST, "is the cable or radio link still there"),
    ],
)
def test_each_failure_has_its_result(simulated, options, result, said):
    report, board = play(simulated=simulated, **options)
    assert report.result is result
    assert said in report.message
    assert not report.ok
    with pytest.raises(hardware.PlaybackError) as caught:
        report.raise_if_invalid()
    assert isinstance(caught.value, JaxikError)
    for part in ("playback on simulated ended after", f"with {result.name}, not SUCCESS", said, result.message):
        assert part in str(caught.value)
    if result is PlayResult.LIMIT:
        assert not board.log or np.ptp(np.array([p.commanded for p in board.log]), axis=0).max() == 0
    if result is not PlayResult.LINK_LOST and result is not PlayResult.LIMIT:
        assert board.status().state is State.DETACHED


def test_a_goal_that_is_never_reached():
    slow = hardware.Tolerances(path=9.0, goal=0.01, goal_time_s=0.5)
    report, _ = play(simulated={"stuck": ["b"], "pose": [0.0, 0.0]}, tolerances=slow)
    assert report.result is PlayResult.GOAL_TOLERANCE
    assert report.message.startswith("b rests 18.7°")


def test_limits_of_the_calibration_are_checked_before_anything_moves():
    joints = hardware.ideal_joint_map(["a", "b"])
    narrow = hardware.JointCalibration(**(vars(joints.joints[1]) | {"lower": -0.3, "upper": 9.0, "raw_high": 99999}))
    report, board = play(calibration=hardware.JointMap("narrow", (joints.joints[0], narrow)))
    assert report.result is PlayResult.LIMIT
    assert "b would go to -28" in report.message
    assert not board.log


def test_ctrl_c_stops_and_releases():
    def stop(fraction):
        if fraction > 0.4:
            raise KeyboardInterrupt

    report, board = play(progress=stop)
    assert report.result is PlayResult.ABORTED
    assert board.status().state is State.DETACHED
    q = commanded(board)
    assert np.abs(np.diff(q[-3:], axis=0)).max() < 0.05


def test_a_dead_link_makes_the_board_hold_and_then_release():
    _, board = play(simulated={"unplugged_at_s": 2.5})
    board.model.run(6_000_000)
    times = np.array([frame.time_us for frame in board.log])
    q = commanded(board)
    assert np.ptp(q[(times > 2.4e6) & (times < 2.6e6)], axis=0).max() > 0.05
    assert np.ptp(q[times > 2.8e6], axis=0).max() == 0
    assert times[-1] < 4.6e6


def test_servos_without_read_back_are_noted_and_not_checked():
    joints = hardware.ideal_joint_map(["a", "b"])
    silent = hardware.JointCalibration(**(vars(joints.joints[0]) | {"readback": False}))
    report, _ = play(
        simulated={"stuck": ["a"]}, calibration=hardware.JointMap("no read-back", (silent, joints.joints[1]))
    )
    assert report.result is PlayResult.SUCCESS
    assert "no read-back from a" in report.warnings[0]
    assert np.isnan(report.tracking.worst[0])


def test_dense_trajectories_are_thinned_to_servo_frames():
    """4001 waypoints become one per servo frame, and the board executes the trajectory to within 3e-4 rad.

    A line over one frame is off by at most 0.02² / 8 = 5e-5 rad at 1 rad/s², a raw step of an ideal servo is 2e-4 rad,
    and the board counts time in steps of 16 µs.
    """
    t = np.linspace(0.0, 2.0, 4001)
    trajectory = Trajectory(t, np.stack([np.sin(t), np.cos(t)], -1), ("a", "b"))
    sent = []
    with hardware.connect("simulated") as board:
        send = board.send
        board.send = lambda waypoints: (sent.extend(waypoints), send(waypoints))[1]
        report = hardware.play(trajectory, board, park=False)
        start_us = board.model.executor.start_us
    assert report.result is PlayResult.SUCCESS
    ease_times, _ = schedule.ease(np.zeros(2), trajectory.q[0], hardware.ideal_joint_map(["a", "b"]))
    assert len(sent) == len(ease_times) + 100, "2 s of frames, the first of which is the last of easing in"
    np.testing.assert_array_equal(np.diff([point.time_us for point in sent]), 20_000)
    assert [point.last for point in sent] == [False] * (len(sent) - 1) + [True]
    played = np.array([1e-6 * (frame.time_us - start_us) for frame in board.log]) - ease_times[-1]
    during = (played >= 0) & (played <= 2.0)
    assert during.sum() == 100
    deviation = np.abs(commanded(board)[during] - trajectory.sample(played[during]))
    assert deviation.max() < 3e-4
    np.testing.assert_allclose(commanded(board)[-1], trajectory.q[-1], atol=1e-4)


def test_a_single_posture_is_a_trajectory_too():
    report, board = play(Trajectory(np.zeros(1), np.array([[0.5, -0.5]]), ("a", "b")), park=False)
    assert report.result is PlayResult.SUCCESS
    np.testing.assert_allclose(commanded(board)[-1], [0.5, -0.5], atol=1e-4)


def test_an_arm_outside_its_limits_is_moved_inside_first():
    joints = hardware.load_joint_map("meccanoid.toml").select(["right_elbow_flexion", "right_wrist_roll"])
    trajectory = Trajectory(np.linspace(0, 2, 51), np.linspace([0.2, 0], [1, 0.5], 51), joints.names)
    report, board = play(trajectory, {"pose": [-0.2, 0.0]}, calibration=joints)
    assert report.ok, report.message
    assert "right_elbow_flexion stood at -11.5°, outside its range: moved to 0.0° first" in report.warnings
    steps = np.abs(np.diff([frame.commanded[0] for frame in board.log]))
    assert steps.max() <= np.radians(120) * 66.21 * 0.0916 + 1, "at most a packet's step"


def test_a_start_that_comes_too_late_is_an_underrun():
    with hardware.connect("simulated") as board:
        start = board.model.executor.start
        board.model.executor.start = lambda start_us, now_us: start(start_us, now_us + 10_000_000)
        report = hardware.play(TRAJECTORY, board)
    assert report.result is PlayResult.UNDERRUN
    assert "arrived after its time" in report.message


@pytest.mark.parametrize("speed", [0.0, -1.0, np.nan, np.inf])
def test_speed_is_a_positive_number(speed):
    with pytest.raises(ValueError, match="speed needs to be a number above 0"):
        play(speed=float(speed))


def test_a_calibration_without_the_joints_is_refused():
    with pytest.raises(hardware.CalibrationError, match="lacks a, b"):
        play(calibration="meccanoid.toml")


def test_an_unknown_board_is_refused_with_those_there_are():
    with pytest.raises(hardware.BoardError, match=r"there are arduino, .*simulated"):
        hardware.connect("teensy")
    with pytest.raises(hardware.BoardError, match="has no port"):
        hardware.connect("simulated:/dev/null")
