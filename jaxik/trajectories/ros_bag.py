"""Recordings of ROS 2 in MCAP, the container of rosbag2: a trajectory written as messages, and read from them.

A file holds the motion twice, as one trajectory_msgs/JointTrajectory, which controllers take, and as
sensor_msgs/JointState at every waypoint, which Foxglove and RViz show.
"""

import io
from pathlib import Path
from typing import Any

from jaxik.errors import FileFormatError, MissingExtraError
from jaxik.ros_text import nanoseconds, stamp
from jaxik.trajectories.ros_trajectory import (
    Fields,
    fields_from_samples,
    fields_of,
    message_of,
    spline_derivatives,
    whole_nanoseconds,
)

STATES, TRAJECTORY = "/joint_states", "/joint_trajectory"

_HEADER = """
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
_STATE_TYPE = f"""\
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort{_HEADER}"""
_TRAJECTORY_TYPE = f"""\
std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint[] points{_HEADER}\
================================================================================
MSG: trajectory_msgs/JointTrajectoryPoint
float64[] positions
float64[] velocities
float64[] accelerations
float64[] effort
builtin_interfaces/Duration time_from_start
================================================================================
MSG: builtin_interfaces/Duration
int32 sec
uint32 nanosec
"""


def write_bag(fields: Fields) -> bytes:
    """Return a trajectory as the content of an MCAP file; its recording begins at time 0."""
    try:
        from mcap_ros2.writer import Writer
    except ImportError as error:
        raise MissingExtraError(_MISSING) from error
    stream = io.BytesIO()
    writer = Writer(stream)
    trajectory = writer.register_msgdef("trajectory_msgs/msg/JointTrajectory", _TRAJECTORY_TYPE)
    state = writer.register_msgdef("sensor_msgs/msg/JointState", _STATE_TYPE)
    writer.write_message(TRAJECTORY, trajectory, message_of(fields), log_time=0)
    velocity, _ = spline_derivatives(fields["time"], fields["q"])
    for i, time in enumerate(whole_nanoseconds(fields["time"])):
        message = {
            "header": {"stamp": stamp(time), "frame_id": ""},
            "name": list(fields["joint_names"]),
            "position": fields["q"][i].tolist(),
            "velocity": velocity[i].tolist(),
            "effort": [],
        }
        writer.write_message(STATES, state, message, log_time=time, sequence=i)
    writer.finish()
    return stream.getvalue()


def read_bag(data: bytes) -> Fields:
    """Return the fields of the trajectory in an MCAP file: its first JointTrajectory, else its JointStates."""
    try:
        from mcap.exceptions import McapError
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory
    except ImportError as error:
        raise MissingExtraError(_MISSING) from error
    states: dict[str, list[tuple[int, Any]]] = {}
    try:
        reader = make_reader(io.BytesIO(data), decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        topics = [
            channel.topic
            for channel in (summary.channels.values() if summary else ())
            if summary and channel.schema_id in summary.schemas
            and _kind(summary.schemas[channel.schema_id].name) in ("JointTrajectory", "JointState")
        ]  # fmt: skip
        for schema, channel, raw, message in reader.iter_decoded_messages(topics=topics or None):
            kind = _kind(schema.name if schema else "")
            if kind == "JointTrajectory" and message.points:
                return fields_of(message)
            if kind == "JointState" and message.name and len(message.name) == len(message.position):
                states.setdefault(channel.topic, []).append((raw.log_time, message))
    except McapError as error:
        raise FileFormatError(f"expected a recording in MCAP; {' '.join(str(error).split())[:200]}") from None
    if not states:
        raise FileFormatError("expected a JointTrajectory or JointState in the recording; it holds neither")
    return _recorded(max(states.values(), key=len))


def _recorded(messages: list[tuple[int, Any]]) -> Fields:
    """Return the motion of the joints that the first message of a topic names.

    Messages of other publishers on the topic, and repeated ones, are left out.
    """
    names = list(messages[0][1].name)
    times, rows = [], []
    for logged, message in messages:
        if not set(names) <= set(message.name):
            continue
        time = nanoseconds(message.header.stamp, "header.stamp") or logged
        if not times or time > times[-1]:
            position = dict(zip(message.name, message.position, strict=True))
            times.append(time)
            rows.append([float(position[name]) for name in names])
    return fields_from_samples(names, [time - times[0] for time in times], rows)


def bag_file(name: str) -> str:
    """Return the MCAP file in the folder of a recording, or the name itself if it is no folder.

    Raises:
        FileFormatError: The folder does not hold exactly one.
    """
    folder = Path(name)
    if not folder.is_dir():
        return name
    files = sorted(folder.glob("*.mcap"))
    if len(files) != 1:
        raise FileFormatError(
            f"{name}: expected a folder with one .mcap file; it has {len(files)} (recordings in sqlite3 are converted "
            f"by `ros2 bag convert`)"
        )
    return str(files[0])


def _kind(name: str) -> str:
    """Return the last word of a message type."""
    return name.rpartition("/")[2]


_MISSING = 'recordings in MCAP need mcap-ros2-support: pip install "jaxik[ros]"'
