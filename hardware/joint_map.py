"""Calibration: joint angles in radians to a servo's raw numbers and back.

One TOML file per robot::

    format = 1
    robot = "meccanoid"

    [[joint]]
    name = "right_elbow_flexion"
    raw_range = [24, 232]         # what the servo accepts
    neutral = 128                 # raw value at zero radians
    raw_per_rad = 66.2            # resolution; a full Meccano range of 208 steps is about 180 degrees
    sign = 1                      # -1 where the servo is mounted the other way round
    limits_deg = [0, 100]         # where the joint may go, inside raw_range
    max_rate_deg_s = 115          # how fast it may go
    safe_deg = 0                  # where it rests
    readback = true               # whether the servo reports where it is
    channel = "D8/4"              # where it is plugged in, in the board's words; may be left out for simulated servos
"""

import binascii
import json
import math
import os
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from functools import cached_property
from importlib import resources
from pathlib import Path

import numpy as np

from hardware.errors import CalibrationError

FORMAT = 1
_KEYS = {"name", "raw_range", "neutral", "raw_per_rad", "sign", "limits_deg", "max_rate_deg_s", "safe_deg", "readback"}
_OPTIONAL = {"channel"}


@dataclass(frozen=True)
class JointCalibration:
    """One joint and the servo that moves it.

    Attributes:
        name: The joint's name, as in the trajectory.
        raw_low: Lowest raw value the servo accepts.
        raw_high: Highest.
        neutral: Raw value at zero radians.
        raw_per_rad: Raw steps per radian.
        sign: 1, or -1 where the servo turns the other way.
        lower: Lowest joint angle [rad].
        upper: Highest [rad].
        max_rate: Greatest joint speed [rad/s].
        safe: Joint angle to rest at [rad].
        readback: Whether the servo reports where it is.
        channel: Where it is plugged in, in the board's words; empty if not said.
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
        """What is wrong with the numbers; empty if nothing."""
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
    """Joints in playing order, with their servos.

    Attributes:
        robot: Which robot.
        joints: One calibration per joint.
    """

    robot: str
    joints: tuple[JointCalibration, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Joint names in order."""
        return tuple(joint.name for joint in self.joints)

    def column(self, field: str) -> np.ndarray:
        """One number of every joint as an array, ``(joint,)``, read-only."""
        return self._columns[field]

    @cached_property
    def _columns(self) -> dict[str, np.ndarray]:
        names = [field.name for field in fields(JointCalibration)]
        columns = {name: np.array([getattr(joint, name) for joint in self.joints]) for name in names}
        for column in columns.values():
            column.flags.writeable = False
        return columns

    def to_raw(self, q: np.ndarray) -> np.ndarray:
        """Joint angles ``(*batch, joint)`` [rad] to the nearest raw values, integers."""
        raw = self.column("neutral") + self.column("sign") * self.column("raw_per_rad") * np.asarray(q, float)
        return np.rint(raw).astype(np.int64)

    def to_rad(self, raw: np.ndarray) -> np.ndarray:
        """Raw values ``(*batch, joint)`` to joint angles [rad]; nan stays nan."""
        return (np.asarray(raw, float) - self.column("neutral")) * self.column("sign") / self.column("raw_per_rad")

    def select(self, names: Sequence[str]) -> "JointMap":
        """The joints of a trajectory, in its order.

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
        """CRC-16 of the content, which a board echoes so that both sides mean the same."""
        text = json.dumps([self.robot, *(asdict(joint) for joint in self.joints)], sort_keys=True)
        return binascii.crc_hqx(text.encode(), 0xFFFF)


def ideal_joint_map(names: Sequence[str]) -> JointMap:
    """Servos without faults for trying things out: steps of 0.2 mrad, two turns of range, one turn per second.

    Args:
        names: The joints, in order.

    Returns:
        The calibration.
    """
    turn = 2 * math.pi
    return JointMap(
        "ideal",
        tuple(
            JointCalibration(name, 1, 65535, 32768.0, 5e3, 1, -turn, turn, turn, 0.0, readback=True) for name in names
        ),
    )


def save_joint_map(joints: JointMap, file: str | os.PathLike[str]) -> None:
    """Writes a calibration that :func:`load_joint_map` reads back, under a temporary name that is then renamed.

    Args:
        joints: What to write.
        file: TOML file.

    Raises:
        CalibrationError: A joint's numbers do not fit together.
        OSError: The file cannot be written.
    """
    for joint in joints.joints:
        if found := joint.problems():
            raise CalibrationError(f"{joint.name}: {found[0]}")
    text = f"format = {FORMAT}\nrobot = {json.dumps(joints.robot)}\n"
    text += "".join(_table(joint) for joint in joints.joints)
    path = Path(file)
    unfinished = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        unfinished.write_text(text, encoding="utf-8")
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


def _table(joint: JointCalibration) -> str:
    """One [[joint]] table."""
    degrees = lambda x: f"{math.degrees(x):.10g}"  # noqa: E731
    rows = {
        "name": json.dumps(joint.name),
        "raw_range": f"[{joint.raw_low}, {joint.raw_high}]",
        "neutral": f"{joint.neutral:.10g}",
        "raw_per_rad": f"{joint.raw_per_rad:.10g}",
        "sign": f"{joint.sign}",
        "limits_deg": f"[{degrees(joint.lower)}, {degrees(joint.upper)}]",
        "max_rate_deg_s": degrees(joint.max_rate),
        "safe_deg": degrees(joint.safe),
        "readback": json.dumps(joint.readback),
    }
    if joint.channel:
        rows["channel"] = json.dumps(joint.channel)
    return "\n[[joint]]\n" + "".join(f"{key} = {value}\n" for key, value in rows.items())


def load_joint_map(file: str | os.PathLike[str]) -> JointMap:
    """Reads a calibration.

    Args:
        file: A TOML file; a bare name that is no file here is looked up among those that come with the package.

    Returns:
        The calibration.

    Raises:
        CalibrationError: Not a calibration; one sentence with file, joint, and what was expected.
        OSError: The file cannot be read.
    """
    name = os.fspath(file)
    path = Path(name)
    shipped = resources.files("hardware") / "calibrations" / path.name
    source = shipped if not path.exists() and path.name == name and shipped.is_file() else path
    try:
        content = tomllib.loads(source.read_bytes().decode("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise CalibrationError(f"{name}: expected a TOML file; {error}") from error
    return _parse(name, content)


def _parse(name: str, content: Mapping[str, object]) -> JointMap:
    """The calibration a TOML document holds."""
    if content.get("format") != FORMAT:
        raise CalibrationError(f"{name}: expected format = {FORMAT}; got {content.get('format')!r}")
    robot, tables = content.get("robot"), content.get("joint")
    if not isinstance(robot, str) or not robot:
        raise CalibrationError(f'{name}: expected robot = "a name"; got {robot!r}')
    if not isinstance(tables, list) or not tables:
        raise CalibrationError(f"{name}: expected at least one [[joint]] table")
    joints = tuple(_joint(name, i, table) for i, table in enumerate(tables, 1))
    names = [joint.name for joint in joints]
    twice = sorted({n for n in names if names.count(n) > 1})
    if twice:
        raise CalibrationError(f"{name}: joint {twice[0]!r} appears twice")
    return JointMap(robot, joints)


def _joint(file: str, number: int, table: object) -> JointCalibration:
    """One [[joint]] table."""
    where = f"{file}: joint {number}"
    if not isinstance(table, dict):
        raise CalibrationError(f"{where}: expected a [[joint]] table; got {table!r}")
    if isinstance(table.get("name"), str):
        where += f" ({table['name']})"
    wrong = sorted((_KEYS ^ table.keys()) - _OPTIONAL)
    if wrong:
        what = "lacks" if wrong[0] in _KEYS else "does not know"
        raise CalibrationError(f"{where}: {what} {wrong[0]!r}; the keys are {', '.join(sorted(_KEYS))}")
    pair = lambda key: _numbers(where, key, table[key], 2)  # noqa: E731
    one = lambda key: _numbers(where, key, [table[key]], 1)[0]  # noqa: E731
    if not isinstance(table["name"], str) or not table["name"]:
        raise CalibrationError(f"{where}: expected name to be a text; got {table['name']!r}")
    if not isinstance(table["readback"], bool):
        raise CalibrationError(f"{where}: expected readback to be true or false; got {table['readback']!r}")
    if not isinstance(table.get("channel", ""), str):
        raise CalibrationError(f'{where}: expected channel to be a text such as "D8/1"; got {table["channel"]!r}')
    raw, limits = pair("raw_range"), pair("limits_deg")
    joint = JointCalibration(
        name=table["name"],
        raw_low=int(raw[0]),
        raw_high=int(raw[1]),
        neutral=one("neutral"),
        raw_per_rad=one("raw_per_rad"),
        sign=int(one("sign")),
        lower=math.radians(limits[0]),
        upper=math.radians(limits[1]),
        max_rate=math.radians(one("max_rate_deg_s")),
        safe=math.radians(one("safe_deg")),
        readback=table["readback"],
        channel=table.get("channel", ""),
    )
    found = joint.problems()
    if found:
        raise CalibrationError(f"{where}: {found[0]}")
    return joint


def _numbers(where: str, key: str, value: object, count: int) -> list[float]:
    """So many finite numbers."""
    numbers = value if isinstance(value, list) else []
    good = [float(x) for x in numbers if isinstance(x, int | float) and not isinstance(x, bool) and math.isfinite(x)]
    if len(good) != count or len(numbers) != count:
        what = "a finite number" if count == 1 else f"{count} finite numbers"
        raise CalibrationError(f"{where}: expected {key} to be {what}; got {value!r}")
    return good
