"""Trajectories as the messages of ROS 2 spell them: trajectory_msgs/JointTrajectory and the goal of a controller."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxik.errors import FileFormatError
from jaxik.ros_text import NANOSECONDS, as_yaml, has_member, member, nanoseconds, real, stamp

Fields = dict[str, Any]


def message_of(fields: Fields) -> dict[str, Any]:
    """Return a trajectory's fields as a trajectory_msgs/JointTrajectory."""
    times = whole_nanoseconds(fields["time"])
    velocity, acceleration = spline_derivatives(fields["time"], fields["q"])
    rows = zip(times, fields["q"].tolist(), velocity.tolist(), acceleration.tolist(), strict=True)
    return {
        "header": {"stamp": stamp(0), "frame_id": ""},
        "joint_names": list(fields["joint_names"]),
        "points": [
            {
                "positions": q,
                "velocities": qd,
                "accelerations": qdd,
                "effort": [],
                "time_from_start": stamp(time),
            }
            for time, q, qd, qdd in rows
        ],
    }


def fields_of(message: Any) -> Fields:
    """Return the fields of a trajectory from a JointTrajectory, or from a goal or request that holds one.

    Raises:
        FileFormatError: It is neither.
    """
    for holder in ("goal", "trajectory"):
        if not has_member(message, "points") and has_member(message, holder):
            message = member(message, holder)
    names = member(message, "joint_names", "a JointTrajectory")
    points = list(_sequence(member(message, "points", "a JointTrajectory"), "points"))
    times, rows = [], []
    for i, point in enumerate(points):
        where = f"points[{i}]"
        times.append(nanoseconds(member(point, "time_from_start", where), f"{where}.time_from_start"))
        row = _sequence(member(point, "positions", where), f"{where}.positions")
        if len(row) != len(names):
            raise FileFormatError(f"expected {len(names)} positions in {where}; got {len(row)}")
        rows.append([real(x, f"{where}.positions") for x in row])
    return fields_from_samples(names, times, rows)


def fields_from_samples(names: Sequence[str], times: Sequence[int], rows: Sequence[Sequence[float]]) -> Fields:
    """Return the fields of a trajectory from names, times [ns] and joint angles [rad]."""
    return {
        "time": np.array([ns // NANOSECONDS + ns % NANOSECONDS / NANOSECONDS for ns in times], np.float64),
        "q": np.array(rows, np.float64).reshape(len(rows), len(names)),
        "joint_names": tuple(str(name) for name in names),
    }


def goal_text(fields: Fields, tolerance: float | None, goal_time_tolerance: float | None) -> str:
    """Return a control_msgs/action/FollowJointTrajectory goal on one line of YAML."""
    goal: dict[str, Any] = {"trajectory": message_of(fields)}
    if tolerance is not None:
        goal["goal_tolerance"] = [
            {"name": name, "position": float(tolerance), "velocity": 0.0, "acceleration": 0.0}
            for name in fields["joint_names"]
        ]
    if goal_time_tolerance is not None:
        goal["goal_time_tolerance"] = stamp(round(goal_time_tolerance * NANOSECONDS))
    return as_yaml(goal, one_line=True)


def whole_nanoseconds(time: np.ndarray) -> list[int]:
    """Return the times since the first waypoint in whole nanoseconds, as messages hold them.

    Raises:
        ValueError: Two waypoints fall on the same nanosecond, or the last is later than messages can say.
    """
    since = np.rint((time - time[0]) * NANOSECONDS)
    if (np.diff(since) <= 0).any():
        k = int(np.argmax(np.diff(since) <= 0)) + 1
        raise ValueError(f"waypoint {k} of {len(time)} is less than a nanosecond after the one before it")
    if since[-1] >= 2**31 * NANOSECONDS:
        raise ValueError(f"expected less than {2**31} s, the longest time of a message; got {time[-1] - time[0]:.6g} s")
    return [int(ns) for ns in since]


def spline_derivatives(time: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return velocities and accelerations at the waypoints of the cubic spline through them, from rest to rest.

    A controller that is given positions, velocities and accelerations plays exactly this spline: its polynomials of
    third or fifth degree between waypoints are determined by them.

    Args:
        time: Times, ``(K,)`` [s].
        q: Joint angles, ``(K, joint)`` [rad].

    Returns:
        Velocities [rad/s] and accelerations [rad/s²], ``(K, joint)`` each.
    """
    if len(time) == 1:
        return np.zeros_like(q), np.zeros_like(q)
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(time, q, bc_type="clamped")
    velocity = spline(time, 1)
    velocity[[0, -1]] = 0.0  # at rest without rounding: controllers refuse a motion that does not end at rest
    return velocity, spline(time, 2)


def _sequence(value: Any, where: str) -> Any:
    if isinstance(value, str) or not (hasattr(value, "__len__") and hasattr(value, "__getitem__")):
        raise FileFormatError(f"expected {where} to be a list; got {value!r:.80}")
    return value
