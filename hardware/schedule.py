"""Waypoints of a trajectory, checked against the calibration before anything moves.

They are made while they are sent, so that a motion of days needs no more memory than one of seconds.
"""

import math
from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from hardware.board import Waypoint
from hardware.joint_map import JointMap
from hardware.protocol import FRAME_US
from jaxik.trajectories import Trajectory

FRAME_S = FRAME_US / 1e6  # period of a hobby servo's pulses: closer waypoints have no effect
_LONGEST_GAP_S = 0.5  # boards accept at most a second between waypoints
_EASE_SPEED = 0.5  # greatest speed while easing in, as a fraction of each joint's own
_LEAST_EASE_S = 1.0  # even a short distance takes a second, which is time to reach for the switch
_LONGEST_S = 7 * 86_400.0  # a playback that would last longer is a mistake in units or speed
_CHUNK = 1024  # waypoints made at a time
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
    if trajectory.duration / speed > _LONGEST_S:
        found.append(
            f"the motion of {_span(trajectory.duration)} would take {_span(trajectory.duration / speed)} at speed "
            f"{speed:g}, and a playback lasts {_span(_LONGEST_S)} at most; are its times in seconds? Play it faster"
        )
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
    lasts = trajectory.duration / speed
    if len(times) > 1 and lasts < FRAME_S and not found:
        found.append(
            f"the motion would last {lasts:.2g} s, less than a servo frame of {FRAME_S:g} s; play at speed "
            f"{math.floor(100 * trajectory.duration / FRAME_S) / 100:g} or below"
        )
    return found


class Segment(NamedTuple):
    """Part of a motion.

    Attributes:
        phase: Name of the part in the log.
        duration: Duration [s].
        chunks: Times from the part's start ``(N,)`` [s] and postures ``(N, joint)`` [rad], in order.
    """

    phase: str
    duration: float
    chunks: Iterable[tuple[np.ndarray, np.ndarray]]


def ease(
    start: np.ndarray, end: np.ndarray, joints: JointMap, speed: float = _EASE_SPEED
) -> tuple[np.ndarray, np.ndarray]:
    """Return a minimum-jerk motion between two postures, at rest at both.

    Args:
        start: First posture, ``(joint,)`` [rad].
        end: Last posture, ``(joint,)`` [rad].
        joints: Calibration, whose rates the motion keeps.
        speed: Greatest speed, as a fraction of each joint's own.

    Returns:
        Times ``(N,)`` [s], the first one frame after the start, and postures ``(N, joint)`` [rad].
    """
    peak = 1.875  # greatest speed of u³(10 - 15u + 6u²), relative to the mean
    longest = float(np.max(peak * np.abs(end - start) / (speed * joints.column("max_rate"))))
    duration = max(_LEAST_EASE_S, longest)
    count = math.ceil(duration / FRAME_S)
    u = np.arange(1, count + 1) / count
    return FRAME_S * np.arange(1, count + 1), start + np.outer(u**3 * (10 - 15 * u + 6 * u**2), end - start)


def eased(phase: str, start: np.ndarray, end: np.ndarray, joints: JointMap, speed: float = _EASE_SPEED) -> Segment:
    """Return the motion of :func:`ease` as a part of a longer one, under the name of a phase."""
    times, q = ease(start, end, joints, speed)
    return Segment(phase, float(times[-1]), [(times, q)])


def played(trajectory: Trajectory, speed: float) -> Segment:
    """Return a trajectory at a speed as a part of a longer motion.

    Args:
        trajectory: Motion to play.
        speed: Time scale.
    """
    chunks = ((times, trajectory.sample(trajectory.time[0] + times * speed)) for times in _times(trajectory, speed))
    return Segment("play", trajectory.duration / speed, chunks)


def frames(trajectory: Trajectory, speed: float) -> tuple[np.ndarray, np.ndarray]:
    """Sample a trajectory for a board: no denser than servo frames, no sparser than boards accept.

    Args:
        trajectory: Motion to play.
        speed: Time scale.

    Returns:
        Times from zero ``(N,)`` [s] at this speed, and postures ``(N, joint)`` [rad].
    """
    times, q = zip(*played(trajectory, speed).chunks, strict=True)
    return np.concatenate(times), np.concatenate(q)


def _times(trajectory: Trajectory, speed: float) -> Iterator[np.ndarray]:
    """Yield the times of the waypoints to send [s], some at a time."""
    times = (trajectory.time - trajectory.time[0]) / speed
    if len(times) > 1 and np.diff(times).min() < FRAME_S * (1 - _ROUNDING):
        count = math.ceil((times[-1] - FRAME_S / 2) / FRAME_S)
        for first in range(0, count, _CHUNK):
            yield FRAME_S * np.arange(first, min(first + _CHUNK, count))
    else:
        for first in range(0, len(times) - 1, _CHUNK):
            ends = times[first : first + _CHUNK + 1]
            if np.diff(ends).max() <= _LONGEST_GAP_S:
                yield ends[:-1]
            else:
                yield from _subdivided(ends)
    yield times[-1:]


def _subdivided(times: np.ndarray) -> Iterator[np.ndarray]:
    """Yield times, except the last, with others in gaps that are too long."""
    for start, end in pairwise(times):
        count = math.ceil((end - start) / _LONGEST_GAP_S)
        for first in range(0, count, _CHUNK):
            yield start + (end - start) / count * np.arange(first, min(first + _CHUNK, count))


def waypoints(segments: Iterable[Segment], joints: JointMap) -> Iterator[tuple[Waypoint, str]]:
    """Yield the waypoints of motions that follow one another, each with its phase.

    Args:
        segments: The motions; they may go on for ever.
        joints: Calibration of the joints.
    """
    index, offset, before = 0, 0.0, -math.inf
    held: tuple[int, tuple[int, ...], str] | None = None  # until it is known whether another one follows
    for segment in segments:
        for times, q in segment.chunks:
            for time, raw in zip((offset + times).tolist(), joints.to_raw(q).tolist(), strict=True):
                if time <= before:
                    continue  # a part starts where the last one ends
                if held is not None:
                    yield Waypoint(index, *held[:2]), held[2]
                    index += 1
                before, held = time, (round(1e6 * time), tuple(raw), segment.phase)
        offset += segment.duration
    if held is not None:
        yield Waypoint(index, *held[:2], last=True), held[2]


def _span(seconds: float) -> str:
    """Return a duration in words."""
    units = ((365.25 * 86_400, "years"), (86_400, "days"), (3600, "hours"), (1, "s"))
    size, name = next(((size, name) for size, name in units if seconds >= 2 * size), units[-1])
    return f"{seconds / size:.3g} {name}"
