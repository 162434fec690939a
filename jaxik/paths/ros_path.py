"""Paths as the messages of ROS 2 spell them: nav_msgs/Path is written, geometry_msgs/PoseArray is read, too."""

import json
from pathlib import Path as FilePath
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxik.atomic_file import write_atomically
from jaxik.errors import FileFormatError
from jaxik.paths.file_limits import LARGEST, UNIT_TOLERANCE
from jaxik.paths.path import Path
from jaxik.ros_text import NANOSECONDS, as_yaml, has_member, member, nanoseconds, parse_json, parse_yaml, real, stamp
from jaxik.tables import decoded
from jaxik.targets import Pose, matrix_from_wxyz, wxyz_from_matrix

_YAML, _JSON = (".yaml", ".yml"), ".ros.json"


def is_message_file(name: str) -> bool:
    """Return whether a file name has the ending of a message."""
    return name.lower().endswith((*_YAML, _JSON))


def save_message(path: Path, name: str) -> None:
    """Save a path of poses as a nav_msgs/Path, with times from the first waypoint on."""
    if not isinstance(path.target, Pose):
        raise ValueError("messages of ROS 2 hold poses, and this path has pointing targets: save it as .csv")
    since = np.rint((np.asarray(path.time, np.float64) - float(path.time[0])) * NANOSECONDS)
    position = np.asarray(path.target.position, np.float64).tolist()
    turn = wxyz_from_matrix(np.asarray(path.target.rotation, np.float64)).tolist()
    header = {"stamp": stamp(0), "frame_id": "base"}
    poses = [
        {
            "header": header | {"stamp": stamp(int(time))},
            "pose": {
                "position": dict(zip("xyz", p, strict=True)),
                "orientation": dict(zip("xyzw", (*q[1:], q[0]), strict=True)),
            },
        }
        for time, p, q in zip(since, position, turn, strict=True)
    ]
    message = {"header": header, "poses": poses}
    write_atomically(name, json.dumps(message) if name.lower().endswith(_JSON) else as_yaml(message))


def load_message(name: str) -> Path:
    """Load a path from a nav_msgs/Path, or a PoseArray, which has no times and is paced."""
    try:
        text = decoded(FilePath(name).read_bytes())
        message = parse_json(text) if name.lower().endswith(_JSON) else parse_yaml(text)
        return _path(message).checked()
    except FileFormatError as error:
        raise FileFormatError(f"{name}: {error}") from None
    except (ValueError, TypeError, OverflowError) as error:
        raise FileFormatError(f"{name}: expected a nav_msgs/Path or PoseArray; {error}") from None


def _path(message: Any) -> Path:
    poses = member(message, "poses", "a nav_msgs/Path or PoseArray")
    if not isinstance(poses, list) or len(poses) < 2:
        raise FileFormatError(f"expected poses to be a list of at least 2; got {poses!r:.80}")
    stamped = [pose for pose in poses if has_member(pose, "header") and has_member(pose, "pose")]
    plain = [member(pose, "pose") for pose in stamped] if len(stamped) == len(poses) else poses
    position, turn = np.empty((len(plain), 3)), np.empty((len(plain), 4))
    for i, pose in enumerate(plain):
        where = f"poses[{i}]"
        for row, field, names in ((position, "position", "xyz"), (turn, "orientation", "wxyz")):
            part = member(pose, field, where)
            row[i] = [real(member(part, name, f"{where}.{field}"), f"{where}.{field}.{name}") for name in names]
            if not (np.abs(row[i]) <= LARGEST).all():
                raise FileFormatError(f"expected finite numbers in {where}.{field}; got {row[i].tolist()}")
        size = float(np.linalg.norm(turn[i]))
        if not abs(size - 1) <= UNIT_TOLERANCE:
            raise FileFormatError(f"expected a unit quaternion in {where}.orientation; its length is {size:.6g}")
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    target = Pose(jnp.asarray(position), jnp.asarray(matrix_from_wxyz(turn)))
    if len(stamped) == len(poses):
        times = [nanoseconds(member(pose["header"], "stamp", "a header"), "a header's stamp") for pose in poses]
        if any(times):  # stamps of zero stand for no time
            return Path(target, jnp.asarray([(time - times[0]) / NANOSECONDS for time in times]))
    return Path.paced(target)
