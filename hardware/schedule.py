"""Waypoints of a trajectory, checked against the calibration before anything moves."""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from hardware.board import Waypoint
from hardware.joint_map import JointMap
from hardware.protocol import FRAME_US
from jaxik.trajectories import Trajectory

FRAME_S = FRAME_US / 1e6  # period of a hobby servo's pulses: closer waypoints have no effect
_LONGEST_GAP_S = 0.5  # boards accept at most a second between waypoints
_EASE_SPEED = 0.5  # greatest speed while easing in, as a fraction of each joint's own
_LEAST_EASE_S = 1.0  # even a short distance takes a second, which is time to reach for the switch
_ROUNDING = 1e-6  # relative: numbers this close to a limit are at it


def problems(trajectory: Trajectory, joints: JointMap, speed: float) -> list[str]:
    """Return one sentence per limit or rate that a trajectory exceeds; empty if it can be played.

    Args:
        trajectory: Motion to play.
        joints: Calibration of its joints, in its order.
        speed: Time scale.
    """
    found = []
    times = trajectory.time
    rate = np.abs(trajectory.qd) * speed
    for j, joint in enumerate(joints.joints):
        q = trajectory.q[:, j]
        excess = np.maximum(joint.lower - q, q - joint.upper)
        k = int(np.argmax(excess))
        if excess[k] > _ROUNDING:
            found.append(
                f"{joint.name} would go to {math.degrees(q[k]):.1f}° at {times[k]:.2f} s, outside its range "
                f"{math.degrees(joint.lower):.1f}° to {math.degrees(joint.upper):.1f}°"
            )
        if len(rate) and rate[:, j].max() > joint.max_rate * (1 + _ROUNDING):
            k = int(np.argmax(rate[:, j]))
            fitting = math.floor(100 * speed * joint.max_rate / rate[k, j]) / 100
            found.append(
                f"{joint.name} would need {math.degrees(rate[k, j]):.0f}°/s at {times[k]:.2f} s, above its "
                f"{math.degrees(joint.max_rate):.0f}°/s; play at speed {fitting:.2f} or below"
            )
    return found


def ease(start: np.ndarray, end: np.ndarray, joints: JointMap) -> tuple[np.ndarray, np.ndarray]:
    """Return a minimum-jerk motion between two postures, at rest at both.

    Args:
        start: First posture, ``(joint,)`` [rad].
        end: Last posture, ``(joint,)`` [rad].
        joints: Calibration, whose rates the motion keeps.

    Returns:
        Times ``(N,)`` [s], the first one frame after the start, and postures ``(N, joint)`` [rad].
    """
    peak = 1.875  # greatest speed of u³(10 - 15u + 6u²), relative to the mean
    longest = float(np.max(peak * np.abs(end - start) / (_EASE_SPEED * joints.column("max_rate"))))
    duration = max(_LEAST_EASE_S, longest)
    count = math.ceil(duration / FRAME_S)
    u = np.arange(1, count + 1) / count
    return FRAME_S * np.arange(1, count + 1), start + np.outer(u**3 * (10 - 15 * u + 6 * u**2), end - start)


def frames(trajectory: Trajectory, speed: float) -> tuple[np.ndarray, np.ndarray]:
    """Sample a trajectory for a board: no denser than servo frames, no sparser than boards accept.

    Args:
        trajectory: Motion to play.
        speed: Time scale.

    Returns:
        Times from zero ``(N,)`` [s] at this speed, and postures ``(N, joint)`` [rad].
    """
    times = (trajectory.time - trajectory.time[0]) / speed
    if len(times) > 1 and np.diff(times).min() < FRAME_S * (1 - _ROUNDING):
        times = np.append(np.arange(0.0, times[-1] - FRAME_S / 2, FRAME_S), times[-1])
    gaps = np.diff(times)
    if len(gaps) and gaps.max() > _LONGEST_GAP_S:
        parts = [np.linspace(a, b, math.ceil((b - a) / _LONGEST_GAP_S), endpoint=False) for a, b in pairwise(times)]
        times = np.append(np.concatenate(parts), times[-1])
    return times, trajectory.sample(trajectory.time[0] + times * speed)


def waypoints(pieces: Sequence[tuple[np.ndarray, np.ndarray]], joints: JointMap) -> list[Waypoint]:
    """Return the waypoints of motions that follow one another.

    Args:
        pieces: Times ``(N,)`` [s] and postures ``(N, joint)`` [rad] of each motion, its times counted from its start.
        joints: Calibration of the joints.
    """
    rows, offset = [], 0.0
    for times, q in pieces:
        rows += list(zip(offset + times, joints.to_raw(q).tolist(), strict=True))
        offset += float(times[-1])
    rows = [row for i, row in enumerate(rows) if i == 0 or row[0] > rows[i - 1][0]]  # a piece starts at the last's end
    last = len(rows) - 1
    return [Waypoint(i, round(1e6 * t), tuple(raw), last=i == last) for i, (t, raw) in enumerate(rows)]
