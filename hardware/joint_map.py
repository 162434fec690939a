"""Calibration: the map from joint angles in radians to the raw numbers of servos, and back."""

import binascii
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from functools import cached_property

import numpy as np

from hardware.errors import CalibrationError


@dataclass(frozen=True)
class JointCalibration:
    """One joint and the servo that moves it.

    Attributes:
        name: Name of the joint, as in the trajectory.
        raw_low: Lowest raw value that the servo accepts.
        raw_high: Highest raw value that the servo accepts.
        neutral: Raw value at zero radians.
        raw_per_rad: Raw steps per radian.
        sign: 1, or -1 for a servo that turns against the joint.
        lower: Lowest joint angle [rad].
        upper: Highest joint angle [rad].
        max_rate: Greatest joint speed [rad/s].
        safe: Joint angle of the safe pose [rad].
        readback: True if the servo reports its position.
        channel: Output that the servo is plugged into, as the board names it; may be empty for simulated servos.
    """

    name: str
    raw_low: int
    raw_high: int
    neutral: float
    raw_per_rad: float
    sign: int
    lower: float
    upper: float
    max_rate: float
    safe: float
    readback: bool
    channel: str = ""

    def problems(self) -> list[str]:
        """Return one sentence per mistake in the numbers; empty if they are valid."""
        found = []
        numbers = [x for x in asdict(self).values() if isinstance(x, float)]
        if not all(map(math.isfinite, numbers)):
            return ["every number must be finite"]
        if self.raw_low >= self.raw_high:
            found.append(f"raw_range must rise; got [{self.raw_low}, {self.raw_high}]")
        if self.sign not in (1, -1):
            found.append(f"sign must be 1 or -1; got {self.sign}")
        if self.raw_per_rad <= 0:
            found.append(f"raw_per_rad must be above 0; got {self.raw_per_rad:g}")
        if self.max_rate <= 0:
            found.append(f"max_rate_deg_s must be above 0; got {math.degrees(self.max_rate):g}")
        if self.lower >= self.upper:
            found.append(f"limits_deg must rise; got [{math.degrees(self.lower):g}, {math.degrees(self.upper):g}]")
        if not self.lower <= self.safe <= self.upper:
            found.append(f"safe_deg must lie inside limits_deg; got {math.degrees(self.safe):g}")
        if not found:
            ends = [self.neutral + self.sign * self.raw_per_rad * x for x in (self.lower, self.upper)]
            if min(ends) < self.raw_low - 0.5 or max(ends) > self.raw_high + 0.5:
                found.append(
                    f"limits_deg reach raw {min(ends):.1f} to {max(ends):.1f}, outside raw_range "
                    f"[{self.raw_low}, {self.raw_high}]"
                )
        return found


@dataclass(frozen=True)
class JointMap:
    """Calibration of a robot: its joints in playing order, with their servos.

    Attributes:
        robot: Name of the robot.
        joints: One calibration per joint.
    """

    robot: str
    joints: tuple[JointCalibration, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Joint names in order."""
        return tuple(joint.name for joint in self.joints)

    def column(self, field: str) -> np.ndarray:
        """Return one field of every joint as a read-only array, ``(joint,)``.

        Args:
            field: Name of an attribute of :class:`JointCalibration`, whose unit the array has.
        """
        return self._columns[field]

    @cached_property
    def _columns(self) -> dict[str, np.ndarray]:
        names = [field.name for field in fields(JointCalibration)]
        columns = {name: np.array([getattr(joint, name) for joint in self.joints]) for name in names}
        for column in columns.values():
            column.flags.writeable = False
        return columns

    def to_raw(self, q: np.ndarray) -> np.ndarray:
        """Convert joint angles to the nearest raw values.

        Args:
            q: Joint angles, ``(*batch, joint)`` [rad].

        Returns:
            Integers, ``(*batch, joint)``.
        """
        raw = self.column("neutral") + self.column("sign") * self.column("raw_per_rad") * np.asarray(q, float)
        return np.rint(raw).astype(np.int64)

    def to_rad(self, raw: np.ndarray) -> np.ndarray:
        """Convert raw values to joint angles.

        Args:
            raw: Raw values, ``(*batch, joint)``; nan stays nan.

        Returns:
            Joint angles, ``(*batch, joint)`` [rad].
        """
        return (np.asarray(raw, float) - self.column("neutral")) * self.column("sign") / self.column("raw_per_rad")

    def select(self, names: Sequence[str]) -> "JointMap":
        """Return the calibration of some joints.

        Args:
            names: Joints in the order wanted, such as a trajectory's.

        Raises:
            CalibrationError: A joint is not calibrated; with the names that are.
        """
        known = {joint.name: joint for joint in self.joints}
        missing = [name for name in names if name not in known]
        if missing:
            raise CalibrationError(
                f"the calibration of {self.robot!r} lacks {', '.join(missing)}; it has {', '.join(known)}"
            )
        return JointMap(self.robot, tuple(known[name] for name in names))

    @property
    def crc(self) -> int:
        """CRC-16 of the content; a board echoes it, so that host and board hold the same calibration."""
        text = json.dumps([self.robot, *(asdict(joint) for joint in self.joints)], sort_keys=True)
        return binascii.crc_hqx(text.encode(), 0xFFFF)


def ideal_joint_map(names: Sequence[str]) -> JointMap:
    """Return a calibration of ideal servos: steps of 0.2 mrad, two turns of range, one turn per second.

    Args:
        names: Joints in order.
    """
    turn = 2 * math.pi
    return JointMap(
        "ideal",
        tuple(
            JointCalibration(name, 1, 65535, 32768.0, 5e3, 1, -turn, turn, turn, 0.0, readback=True) for name in names
        ),
    )
