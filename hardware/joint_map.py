"""Calibration: the map from joint angles in radians to the raw numbers of servos, and back."""

import binascii
import json
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from datetime import datetime
from functools import cached_property

import numpy as np

from hardware.channels import CHANNELS, servo_at
from hardware.errors import CalibrationError
from hardware.protocol import FRAME_US
from hardware.servo_limits import ServoLimits

_STEPS_PER_RATE = 16 * FRAME_US / 1e6  # a rate on the wire is in sixteenths of a raw step per servo frame
_MOST_TURNS = 20  # of a servo over its raw range, and of a joint
_LEAST_TRAVEL = math.radians(1)
_FASTEST = math.radians(3600)  # per second, of any joint


@dataclass(frozen=True)
class Measured:
    """Times at which the numbers of a joint were measured; None for an estimate.

    Attributes:
        zero: Of ``neutral``.
        scale: Of ``raw_per_rad`` and ``sign``.
        lower: Of the lower limit.
        upper: Of the upper limit.
        safe: Of the safe pose.
    """

    zero: datetime | None = None
    scale: datetime | None = None
    lower: datetime | None = None
    upper: datetime | None = None
    safe: datetime | None = None


NOT_MEASURED = Measured()
ESTIMATES = ("zero", "scale", "lower", "upper")  # numbers that motions depend on


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
        measured: When its numbers were measured.
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
    measured: Measured = NOT_MEASURED

    def estimates(self) -> tuple[str, ...]:
        """Return the numbers that motions depend on and nobody has measured: zero, scale, lower and upper limit."""
        return tuple(name for name in ESTIMATES if getattr(self.measured, name) is None)

    def shifted(self, zero: int) -> "JointCalibration":
        """Return the joint in raw values that are higher by a number, as boards without negative ones need them.

        Args:
            zero: New raw value of what was 0.
        """
        return replace(self, raw_low=self.raw_low + zero, raw_high=self.raw_high + zero, neutral=self.neutral + zero)

    def raw_limits(self) -> tuple[int, int]:
        """Return the lowest and the highest raw value that the joint may be sent to."""
        ends = sorted(self.neutral + self.sign * self.raw_per_rad * x for x in (self.lower, self.upper))
        return max(self.raw_low, round(ends[0])), min(self.raw_high, round(ends[1]))

    def step(self) -> int:
        """Return the greatest change per servo frame, in sixteenths of a raw step."""
        return round(self.max_rate * self.raw_per_rad * _STEPS_PER_RATE)

    def problems(self, kind: str = "") -> list[str]:
        """Return one sentence per mistake in the numbers; empty if a board takes them.

        Args:
            kind: Kind of board, as in an address of :func:`hardware.connect`; empty for any that has the channel.
        """
        if not all(math.isfinite(x) for x in asdict(self).values() if isinstance(x, float)):
            return ["every number must be finite"]
        servo = servo_at(self.channel, kind)
        if servo is None:
            board = f"a board of kind {kind!r}" if kind else "any board"
            return [f"channel {self.channel!r:.80} is none of {board}; {CHANNELS}"]
        return self._contradictions() or self._implausible(servo)

    def _contradictions(self) -> list[str]:
        """Return what no servo could do."""
        degrees = math.degrees
        found = []
        if self.raw_low >= self.raw_high:
            found.append(f"raw_range must rise; got [{self.raw_low}, {self.raw_high}]")
        if self.sign not in (1, -1):
            found.append(f"sign must be 1 or -1; got {self.sign}")
        if self.raw_per_rad <= 0:
            found.append(f"raw_per_rad must be above 0; got {self.raw_per_rad:g}")
        if self.max_rate <= 0:
            found.append(f"max_rate_deg_s must be above 0; got {degrees(self.max_rate):g}")
        if self.lower >= self.upper:
            found.append(f"limits_deg must rise; got [{degrees(self.lower):g}, {degrees(self.upper):g}]")
        if not self.lower <= self.safe <= self.upper:
            found.append(f"safe_deg must lie inside limits_deg; got {degrees(self.safe):g}")
        return found

    def _implausible(self, servo: ServoLimits) -> list[str]:
        """Return what this servo could not do, or no servo does; the board checks the same on its side."""
        degrees = math.degrees
        most = degrees(2 * math.pi * _MOST_TURNS)
        if self.readback and not servo.reports:
            return [f"readback must be false: {servo.name} does not report its position"]
        if not servo.raw_low <= self.raw_low < self.raw_high <= servo.raw_high:
            return [
                f"raw_range [{self.raw_low}, {self.raw_high}] must lie inside [{servo.raw_low}, {servo.raw_high}], "
                f"which {servo.name} takes"
            ]
        travel = (self.raw_high - self.raw_low) / self.raw_per_rad
        if not _LEAST_TRAVEL <= travel <= 2 * math.pi * _MOST_TURNS:
            return [
                f"raw_per_rad = {self.raw_per_rad:g} would make raw_range {degrees(travel):.3g}° wide; "
                f"expected {degrees(_LEAST_TRAVEL):g}° to {most:g}°"
            ]
        if max(abs(self.lower), abs(self.upper)) > 2 * math.pi * _MOST_TURNS:
            return [f"limits_deg must lie within ±{most:g}; got [{degrees(self.lower):g}, {degrees(self.upper):g}]"]
        ends = sorted(self.neutral + self.sign * self.raw_per_rad * x for x in (self.lower, self.upper))
        if ends[0] < self.raw_low - 0.5 or ends[1] > self.raw_high + 0.5:
            return [
                f"limits_deg reach raw {ends[0]:.1f} to {ends[1]:.1f}, outside raw_range "
                f"[{self.raw_low}, {self.raw_high}]"
            ]
        low, high = self.raw_limits()
        if low >= high:
            return [f"limits_deg [{degrees(self.lower):g}, {degrees(self.upper):g}] are less than a raw step apart"]
        if math.isinf(self.max_rate * self.raw_per_rad) or not 1 <= self.step() <= servo.max_step:
            slowest, fastest = (degrees(x / (self.raw_per_rad * _STEPS_PER_RATE)) for x in (1, servo.max_step))
            return [
                f"max_rate_deg_s must lie between {slowest:.2g} and {min(fastest, degrees(_FASTEST)):.0f} for "
                f"{servo.name}; got {degrees(self.max_rate):g}"
            ]
        if self.max_rate > _FASTEST:
            return [f"max_rate_deg_s is at most {degrees(_FASTEST):g} for any joint; got {degrees(self.max_rate):g}"]
        return []


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

    def problems(self, kind: str = "") -> list[str]:
        """Return one sentence per mistake, with the joint's name; empty if a board takes the calibration.

        Args:
            kind: Kind of board, as in an address of :func:`hardware.connect`; empty for any that has the channels.
        """
        found = []
        for channel, count in Counter(joint.channel for joint in self.joints if joint.channel).items():
            if count > 1:
                both = " and ".join(joint.name for joint in self.joints if joint.channel == channel)
                found.append(f"{both} have one channel, {channel!r}; every servo has a channel of its own")
        return found + [f"{joint.name}: {problem}" for joint in self.joints for problem in joint.problems(kind)]

    def check(self, kind: str = "") -> None:
        """Refuse a calibration that no board of a kind takes; dry run, real boards and files all come by here.

        Args:
            kind: Kind of board, as in an address of :func:`hardware.connect`; empty for any that has the channels.

        Raises:
            CalibrationError: A number is wrong or implausible, or two joints share a channel.
        """
        if found := self.problems(kind):
            raise CalibrationError(found[0])

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
        rows = [asdict(joint) for joint in self.joints]
        for row in rows:
            del row["measured"]  # a time changes no motion
        text = json.dumps([self.robot, *rows], sort_keys=True)
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
