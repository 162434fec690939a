"""Numbers of a joint from what was measured of it: zero, scale and sign, and the places that limits stand for."""

import math
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from hardware.errors import CalibrationError
from hardware.joint_map import JointCalibration

PLACES = ("lower", "upper", "safe")  # angles that stand for places of the joint
_JOG_RATE = math.radians(30)  # slow enough to let go of a key in time
_OPPOSITE = {"lower": "upper", "upper": "lower", "safe": "safe"}


def fitted(joint: JointCalibration, angles: Sequence[tuple[float, float]]) -> JointCalibration:
    """Return the joint with zero, scale and sign fitted to raw values at known angles; one angle fits only zero.

    Args:
        joint: The joint.
        angles: Raw values and the angles there [rad].

    Raises:
        CalibrationError: Two angles are the same, or at the same place.
    """
    raw, angle = np.array(angles).T
    if len(angles) == 1:
        return replace(joint, neutral=float(raw[0] - joint.sign * joint.raw_per_rad * angle[0]))
    if np.ptp(raw) == 0 or np.ptp(angle) == 0:
        raise CalibrationError("two angles need two different positions")
    slope, neutral = np.polyfit(angle, raw, 1)
    return replace(joint, neutral=float(neutral), raw_per_rad=abs(float(slope)), sign=1 if slope > 0 else -1)


def reversed_joint(joint: JointCalibration) -> JointCalibration:
    """Return the joint with the sign of its angles reversed; every place stays where it is."""
    times = replace(joint.measured, lower=joint.measured.upper, upper=joint.measured.lower)
    return replace(joint, sign=-joint.sign, lower=-joint.upper, upper=-joint.lower, safe=-joint.safe, measured=times)


def opposite(places: Collection[str]) -> set[str]:
    """Return the places' names once the sign is reversed."""
    return {_OPPOSITE[name] for name in places}


def referred(joint: JointCalibration, new: JointCalibration, places: Collection[str]) -> JointCalibration:
    """Return the joint with another zero and scale; places that were measured stay where they are.

    Args:
        joint: The joint before.
        new: The joint with new zero and scale, and the same sign.
        places: Names of the places that were measured; limits that were not give way to what the servo reaches.
    """
    at = {name: joint.neutral + joint.sign * joint.raw_per_rad * getattr(joint, name) for name in places}
    moved = replace(new, **{name: new.sign * (raw - new.neutral) / new.raw_per_rad for name, raw in at.items()})
    return moved if {"lower", "upper"} & set(places) else _within_reach(moved)


def consistent(joint: JointCalibration, before: JointCalibration) -> JointCalibration:
    """Return a joint as far as it has been measured: without places that contradict the rest, or else as it was.

    Args:
        joint: The joint, perhaps in the midst of being measured.
        before: The joint before, without contradictions.
    """
    places = {name: getattr(before, name) for name in PLACES}
    times = replace(joint.measured, **{name: getattr(before.measured, name) for name in PLACES})
    for candidate in (joint, _within_reach(replace(joint, **places, measured=times))):
        if not candidate.problems():
            return candidate
    return before


def whole_range(joint: JointCalibration) -> JointCalibration:
    """Return a joint that may go slowly wherever its servo can: its limits are yet to be found."""
    lower, upper = _reach(joint)
    whole = replace(joint, lower=lower, upper=upper, safe=min(max(joint.safe, lower), upper))
    slow = replace(whole, max_rate=min(joint.max_rate, _JOG_RATE))
    return slow if slow.step() else whole


def _reach(joint: JointCalibration) -> tuple[float, float]:
    """Return the joint angles at the ends of the servo's range."""
    ends = sorted(joint.sign * (raw - joint.neutral) / joint.raw_per_rad for raw in (joint.raw_low, joint.raw_high))
    return ends[0], ends[1]


def _within_reach(joint: JointCalibration) -> JointCalibration:
    """Return a joint whose limits leave out what its servo does not reach."""
    low, high = _reach(joint)
    lower, upper = max(joint.lower, low), min(joint.upper, high)
    return replace(joint, lower=lower, upper=upper, safe=min(max(joint.safe, lower), upper)) if lower < upper else joint
