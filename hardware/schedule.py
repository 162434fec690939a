"""From a trajectory to the waypoints a board plays, checked before anything moves."""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from hardware.device import Waypoint
from hardware.joint_map import JointMap
from jaxik.trajectories import Trajectory

FRAME_S = 0.02  # period of a hobby servo's pulse: waypoints closer together than that say nothing
_LONGEST_GAP_S = 0.5  # boards take a second between waypoints at most
_EASE_SHARE = 0.5  # of a joint's greatest speed that easing in may use
_EASE_LEAST_S = 1.0  # even a short way is eased over a second, time enough to reach for the switch
_ROUNDING = 1e-6  # relative: at a limit to rounding is at it


def problems(trajectory: Trajectory, joints: JointMap, speed: float) -> list[str]:
    """What in a trajectory the calibration forbids, one sentence per joint; empty if nothing."""
    found = []
    times = trajectory.time
    rate = np.abs(trajectory.qd) * speed
    for j, joint in enumerate(joints.joints):
        q = trajectory.q[:, j]
        over = np.maximum(joint.lower - q, q - joint.upper)
        k = int(np.argmax(over))
        if over[k] > _ROUNDING:
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
    """A minimum-jerk way between two postures, at rest at both.

    Args:
        start: ``(joint,)`` [rad].
        end: ``(joint,)`` [rad].
        joints: Whose rates it keeps.

    Returns:
        Times ``(N,)`` [s] from one frame on, and postures ``(N, joint)`` [rad].
    """
    peak = 1.875  # greatest speed of u³(10 - 15u + 6u²), relative to the mean
    longest = float(np.max(peak * np.abs(end - start) / (_EASE_SHARE * joints.column("max_rate"))))
    duration = max(_EASE_LEAST_S, longest)
    count = math.ceil(duration / FRAME_S)
    u = np.arange(1, count + 1) / count
    return FRAME_S * np.arange(1, count + 1), start + np.outer(u**3 * (10 - 15 * u + 6 * u**2), end - start)


def frames(trajectory: Trajectory, speed: float) -> tuple[np.ndarray, np.ndarray]:
    """A trajectory's times from zero at a speed, and postures; no denser than frames, no sparser than boards take."""
    times = (trajectory.time - trajectory.time[0]) / speed
    if len(times) > 1 and np.diff(times).min() < FRAME_S * (1 - _ROUNDING):
        times = np.append(np.arange(0.0, times[-1] - FRAME_S / 2, FRAME_S), times[-1])
    gaps = np.diff(times)
    if len(gaps) and gaps.max() > _LONGEST_GAP_S:
        parts = [np.linspace(a, b, math.ceil((b - a) / _LONGEST_GAP_S), endpoint=False) for a, b in pairwise(times)]
        times = np.append(np.concatenate(parts), times[-1])
    return times, trajectory.sample(trajectory.time[0] + times * speed)


def waypoints(pieces: Sequence[tuple[np.ndarray, np.ndarray]], joints: JointMap) -> list[Waypoint]:
    """Waypoints of pieces that follow one another, each with times of its own [s] and postures [rad]."""
    rows, offset = [], 0.0
    for times, q in pieces:
        rows += list(zip(offset + times, joints.to_raw(q).tolist(), strict=True))
        offset += float(times[-1])
    rows = [row for i, row in enumerate(rows) if i == 0 or row[0] > rows[i - 1][0]]  # a piece's start repeats an end
    last = len(rows) - 1
    return [Waypoint(i, round(1e6 * t), tuple(raw), last=i == last) for i, (t, raw) in enumerate(rows)]
