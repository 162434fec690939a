"""Messages and recordings of ROS 2: written here, read by rosbags and PyYAML, which know nothing of jaxik."""

import json
import math
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
import yaml
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader, Writer
from rosbags.rosbag2.enums import StoragePlugin
from rosbags.typesys import Stores, get_typestore
from scipy.interpolate import CubicSpline

import jaxik

TYPES = get_typestore(Stores.ROS2_JAZZY)
MOTION = jaxik.Trajectory(
    np.array([2.0, 2.125, 2.5, 3.25]),
    np.array([[0.0, 1e-310], [0.1, -1e-5], [0.3, 2.0], [0.2, 1e20 / 3]]),
    ("shoulder", 'the "elbow", Ärmel'),
    notes=("planned",),
)


def shifted(motion):
    return jaxik.Trajectory(motion.time - motion.time[0], motion.q, motion.joint_names)


@pytest.mark.parametrize("ending", [".yaml", ".yml", ".ros.json", ".mcap"])
def test_messages_and_recordings_read_back(tmp_path, ending):
    MOTION.save(tmp_path / f"x{ending}")
    assert jaxik.load_trajectory(tmp_path / f"x{ending}") == shifted(MOTION)


def test_the_message_is_the_one_of_ros():
    message = jaxik.joint_trajectory_message(MOTION)
    known = TYPES.types["trajectory_msgs/msg/JointTrajectory"]
    point = TYPES.types["trajectory_msgs/msg/JointTrajectoryPoint"]
    assert list(message) == [f for f in known.__dataclass_fields__ if not f.startswith("__")]
    assert all(list(p) == [f for f in point.__dataclass_fields__ if not f.startswith("__")] for p in message["points"])
    assert message["points"][2]["time_from_start"] == {"sec": 0, "nanosec": 500_000_000}
    assert message["points"][3]["time_from_start"] == {"sec": 1, "nanosec": 250_000_000}


def powers(s):
    """Powers of s up to the fifth, with their first and second derivatives."""
    return [[math.perm(k, d) * s ** max(k - d, 0) for k in range(6)] for d in range(3)]


def test_velocities_and_accelerations_are_those_of_the_spline():
    time, q = np.cumsum([0, 0.1, 0.2, 0.1, 0.3]), np.random.default_rng(0).normal(size=(5, 2))
    points = jaxik.joint_trajectory_message(jaxik.Trajectory(time, q, ("a", "b")))["points"]
    # The polynomial of fifth degree that a controller plays between two points is the cubic one.
    spline = CubicSpline(time, q, bc_type="clamped")
    left, right, h = points[1], points[2], time[2] - time[1]
    ends = [np.array(p[k]) for p in (left, right) for k in ("positions", "velocities", "accelerations")]
    quintic = np.linalg.solve(np.array(powers(0.0) + powers(h)), np.stack(ends))
    np.testing.assert_allclose(0.07 ** np.arange(6) @ quintic, spline(time[1] + 0.07), atol=1e-12)
    assert points[0]["velocities"] == points[-1]["velocities"] == [0.0, 0.0]


def test_one_waypoint_is_a_message():
    (point,) = jaxik.joint_trajectory_message(jaxik.Trajectory(np.zeros(1), np.ones((1, 1)), ("a",)))["points"]
    assert point["velocities"] == point["accelerations"] == [0.0]


def test_a_goal_is_one_line_that_the_yaml_reader_of_ros_takes():
    text = jaxik.follow_joint_trajectory_goal(MOTION, tolerance=1e-5, goal_time_tolerance=0.5)
    assert text.count("\n") == 1
    goal = yaml.safe_load(text)
    assert goal["trajectory"] == jaxik.joint_trajectory_message(MOTION)
    assert goal["goal_tolerance"][1]["position"] == 1e-5
    assert goal["goal_time_tolerance"] == {"sec": 0, "nanosec": 500_000_000}
    assert jaxik.trajectory_from_message(goal) == shifted(MOTION)


def test_messages_of_ros_packages_and_of_ros_1_are_read():
    clocks = [SimpleNamespace(sec=sec, nanosec=1) for sec in (0, 1)]
    points = [SimpleNamespace(positions=np.array([0.5]), time_from_start=clock) for clock in clocks]
    message = SimpleNamespace(joint_names=["a"], points=points)
    assert jaxik.trajectory_from_message(message).time.tolist() == [1e-9, 1 + 1e-9]
    old = {"joint_names": ["a"], "points": [{"positions": [1], "time_from_start": {"secs": 1, "nsecs": 0}}]}
    assert jaxik.trajectory_from_message(old).time.tolist() == [1.0]


@pytest.mark.parametrize(
    ("message", "said"),
    [
        ({}, "to have the field 'joint_names'"),
        ([1], "to have the field 'joint_names'"),
        ({"joint_names": ["a"], "points": 3}, "expected points to be a list"),
        ({"joint_names": ["a"], "points": [{}]}, r"expected points\[0\] to have the field 'time_from_start'"),
        ({"joint_names": ["a"], "points": [{"time_from_start": 1}]}, "whole numbers sec and nanosec; got 1"),
        (
            {"joint_names": ["a"], "points": [{"time_from_start": {"sec": 0, "nanosec": 0}, "positions": [1, 2]}]},
            r"expected 1 positions in points\[0\]; got 2",
        ),
        (
            {"joint_names": ["a"], "points": [{"time_from_start": {"sec": 0, "nanosec": 0}, "positions": ["x"]}]},
            r"expected a number for points\[0\].positions; got 'x'",
        ),
        ({"joint_names": ["a"], "points": []}, "holds no trajectory"),
    ],
)
def test_other_messages_are_refused(message, said, tmp_path):
    with pytest.raises(jaxik.FileFormatError, match=said):
        jaxik.trajectory_from_message(message)
    (tmp_path / "x.yaml").write_text(yaml.safe_dump(message))
    with pytest.raises(jaxik.FileFormatError, match=r"x\.yaml: "):
        jaxik.load_trajectory(tmp_path / "x.yaml")


@pytest.mark.parametrize("ending", [".yaml", ".ros.json", ".mcap"])
@pytest.mark.parametrize("content", [b"", b"nonsense", b"\xff\x00\x80", b"{", b"a: [", b"[" * 100_000])
def test_other_files_are_refused_by_name(tmp_path, ending, content):
    (tmp_path / f"x{ending}").write_bytes(content)
    with pytest.raises(jaxik.FileFormatError, match=rf"x\{ending}: ") as caught:
        jaxik.load_trajectory(tmp_path / f"x{ending}")
    assert "\n" not in str(caught.value)


def test_times_within_a_nanosecond_are_refused(tmp_path):
    close = jaxik.Trajectory(np.array([0.0, 1e-10]), np.zeros((2, 1)), ("a",))
    with pytest.raises(ValueError, match="waypoint 1 of 2 is less than a nanosecond"):
        close.save(tmp_path / "x.yaml")
    assert not list(tmp_path.iterdir())


def test_rosbags_reads_the_recording(tmp_path):
    MOTION.save(tmp_path / "x.mcap")
    with AnyReader([tmp_path / "x.mcap"]) as bag:
        kinds = {c.topic: (c.msgtype, c.msgcount) for c in bag.connections}
        assert kinds["/joint_trajectory"] == ("trajectory_msgs/msg/JointTrajectory", 1)
        assert kinds["/joint_states"] == ("sensor_msgs/msg/JointState", 4)
        got = [(t, bag.deserialize(raw, c.msgtype)) for c, t, raw in bag.messages() if c.topic == "/joint_states"]
    np.testing.assert_array_equal([message.position for _, message in got], MOTION.q)
    assert [t for t, _ in got] == [0, 125_000_000, 500_000_000, 1_250_000_000]
    assert got[0][1].name == list(MOTION.joint_names)
    # The written definitions are those of a ROS installation.
    with Reader(tmp_path / "x.mcap") as raw:
        for c, _, data in raw.messages():
            TYPES.deserialize_cdr(data, c.msgtype)


def recorded(folder, rows):
    """A recording as rosbag2 leaves it, of (topic, time, names, positions)."""
    kinds = ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    state, header, clock = (TYPES.types[kind] for kind in kinds)
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        topics = {}
        for topic, time, names, position in rows:
            topics[topic] = topics.get(topic) or bag.add_connection(topic, state.__msgtype__, typestore=TYPES)
            none = np.zeros(0)
            message = state(header(clock(time // 10**9, time % 10**9), ""), names, np.array(position), none, none)
            bag.write(topics[topic], time, TYPES.serialize_cdr(message, state.__msgtype__))


def test_joint_states_of_a_recorded_folder_are_read(tmp_path):
    start = 1_700_000_000_000_000_001
    recorded(
        tmp_path / "bag",
        [
            ("/other", start, ["x"], [9.0]),
            ("/joint_states", start, ["b", "a"], [1.0, 2.0]),
            ("/joint_states", start + 10**8, ["gripper"], [5.0]),
            ("/joint_states", start + 10**8, ["a", "b", "gripper"], [4.0, 3.0, 5.0]),
            ("/joint_states", start + 10**8, ["a", "b"], [4.0, 3.0]),
        ],
    )
    motion = jaxik.load_trajectory(tmp_path / "bag")
    assert (motion.joint_names, motion.time.tolist(), motion.q.tolist()) == (("b", "a"), [0, 0.1], [[1, 2], [3, 4]])


def test_a_folder_without_a_recording_is_refused(tmp_path):
    with pytest.raises(jaxik.FileFormatError, match=r"expected a folder with one .mcap file; it has 0"):
        jaxik.load_trajectory(tmp_path)


def test_a_json_message_needs_no_ending_of_its_own(tmp_path):
    (tmp_path / "x.json").write_text(json.dumps({"goal": {"trajectory": jaxik.joint_trajectory_message(MOTION)}}))
    assert jaxik.load_trajectory(tmp_path / "x.json") == shifted(MOTION)


POSES = jaxik.Pose.from_quaternion(
    jnp.array([[0.3, 0, 0.2], [0.4, 0.1, 0.2], [0.4, 0.2, 0.2]]),
    wxyz=jnp.array([[1.0, 0, 0, 0], [0.6, 0.8, 0, 0], [0.0, 0, 0.6, 0.8]]),
)


@pytest.mark.parametrize("ending", [".yaml", ".ros.json"])
def test_a_path_of_poses_reads_back(tmp_path, ending):
    path = jaxik.Path(POSES, jnp.array([3.0, 3.5, 4.25]))
    jaxik.save_path(path, tmp_path / f"x{ending}")
    back = jaxik.load_path(tmp_path / f"x{ending}")
    np.testing.assert_allclose(back.target.matrix(), path.target.matrix(), atol=1e-15)
    assert back.time.tolist() == [0, 0.5, 1.25]


def test_a_pose_array_is_paced(tmp_path):
    pose = "- {position: {x: %g, y: 0.0, z: 0.5}, orientation: {x: 0.0, y: 0.0, z: 0.0, w: 1.0}}\n"
    (tmp_path / "x.yaml").write_text("header: {frame_id: base}\nposes:\n" + pose % 0.1 + pose % 0.2 + "---\n")
    path = jaxik.load_path(tmp_path / "x.yaml")
    np.testing.assert_allclose(path.target.position[:, 0], [0.1, 0.2])
    np.testing.assert_allclose(path.time, [0, 1.0])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[]", "to have the field 'poses'"),
        ("poses: 3", "a list of at least 2; got 3"),
        ("poses: [{position: {x: 0, y: 0, z: 0}}, {}]", r"expected poses\[0\] to have the field 'orientation'"),
        (
            "poses: [{position: {x: 0, y: 0, z: 0}, orientation: {x: 0, y: 0, z: 0, w: 0}}, {}]",
            r"a unit quaternion in poses\[0\].orientation; its length is 0",
        ),
        ("poses: [{position: {x: a, y: 0, z: 0}}, 1]", r"expected a number for poses\[0\].position.x; got 'a'"),
        ("poses: [{position: {x: 1.e+300, y: 0, z: 0}}, 1]", r"expected finite numbers in poses\[0\].position"),
    ],
)
def test_other_paths_are_refused(tmp_path, text, said):
    (tmp_path / "x.yaml").write_text(text)
    with pytest.raises(jaxik.FileFormatError, match=said) as caught:
        jaxik.load_path(tmp_path / "x.yaml")
    assert "x.yaml: " in str(caught.value)


def test_pointing_targets_are_no_message(tmp_path):
    path = jaxik.Path(POSES.pointing(), jnp.arange(3.0))
    with pytest.raises(ValueError, match=r"this path has pointing targets: save it as .csv"):
        jaxik.save_path(path, tmp_path / "x.yaml")


TABLE = """\
stamp;px;py;pz;rot_w;rot_x;rot_y;rot_z;force
0,5;0,3;0;0,2;1;0;0;0;9
1;0,4;0,1;0,2;0,6;0,8;0;0;9
"""
NAMES = {"time": "stamp", "x": "px", "y": "py", "z": "pz"} | {f"q{a}": f"rot_{a}" for a in "wxyz"}


def test_columns_of_other_programs_are_named(tmp_path):
    (tmp_path / "x.csv").write_text(TABLE)
    path = jaxik.load_path(tmp_path / "x.csv", columns=NAMES)
    np.testing.assert_allclose(path.target.position, [[0.3, 0, 0.2], [0.4, 0.1, 0.2]])
    assert path.time.tolist() == [0, 0.5]
    del NAMES["time"]
    assert jaxik.load_path(tmp_path / "x.csv", columns=NAMES).time[1] > 0.5  # paced


@pytest.mark.parametrize(
    ("columns", "error", "said"),
    [
        ({"x": "nowhere"}, jaxik.FileFormatError, r"expected one column 'nowhere' in the header; got stamp, px"),
        ({"w": "px"}, ValueError, "columns name time, x, y, z, qw"),
        ({"x": "px"}, jaxik.FileFormatError, r"x.csv:1: expected the header"),
    ],
)
def test_columns_that_are_not_there_are_refused(tmp_path, columns, error, said):
    (tmp_path / "x.csv").write_text(TABLE)
    with pytest.raises(error, match=said):
        jaxik.load_path(tmp_path / "x.csv", columns=columns)
    with pytest.raises(jaxik.FileFormatError):
        jaxik.load_path(tmp_path / "x.csv")
