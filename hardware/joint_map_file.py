"""Calibration files, one TOML file per robot.

::

    format = 1
    robot = "meccanoid"

    [[joint]]
    name = "right_elbow_flexion"
    raw_range = [24, 232]         # lowest and highest raw value that the servo accepts
    neutral = 128                 # raw value at zero radians
    raw_per_rad = 66.2            # resolution; a full Meccano range of 208 steps is about 180 degrees
    sign = 1                      # -1 for a servo that turns against the joint
    limits_deg = [0, 100]         # range of the joint, inside raw_range
    max_rate_deg_s = 115          # greatest speed of the joint
    safe_deg = 0                  # angle in the safe pose
    readback = true               # true if the servo reports its position
    channel = "D8/4"              # output of the board that it is plugged into; optional for simulated servos
    measured.zero = 2026-11-28T12:00:00Z   # when neutral was measured; likewise scale (of raw_per_rad and sign), lower,
                                           # upper and safe. What has no time is an estimate.

Every number is checked against :mod:`hardware.servo_limits`, as boards do on their side.
"""

import json
import math
import os
import sys
import tomllib
from collections.abc import Mapping
from dataclasses import fields
from datetime import UTC, datetime
from importlib import resources
from pathlib import Path

from hardware.errors import CalibrationError
from hardware.joint_map import JointCalibration, JointMap, Measured
from jaxik.atomic_file import write_atomically

FORMAT = 1
_KEYS = {"name", "raw_range", "neutral", "raw_per_rad", "sign", "limits_deg", "max_rate_deg_s", "safe_deg", "readback"}
_OPTIONAL = {"channel", "measured"}
_MEASURED = tuple(field.name for field in fields(Measured))


def save_joint_map(joints: JointMap, file: str | os.PathLike[str]) -> None:
    """Write a calibration as TOML; :func:`load_joint_map` reads it back.

    The file appears under its name only when it is complete, so a crash leaves the old one.

    Args:
        joints: Calibration to write.
        file: File name; an existing file is replaced.

    Raises:
        CalibrationError: A joint's numbers contradict each other.
        OSError: The file cannot be written.
    """
    joints.check()
    text = f"format = {FORMAT}\nrobot = {json.dumps(joints.robot)}\n"
    write_atomically(file, text + "".join(_table(joint) for joint in joints.joints))


def _table(joint: JointCalibration) -> str:
    """Return a joint's [[joint]] table as text."""
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
    for name in _MEASURED:
        if time := getattr(joint.measured, name):
            rows[f"measured.{name}"] = time.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    return "\n[[joint]]\n" + "".join(f"{key} = {value}\n" for key, value in rows.items())


def load_joint_map(file: str | os.PathLike[str]) -> JointMap:
    """Read a calibration.

    Args:
        file: TOML file; a bare name without such a file in the current folder means one of the package's own, such as
            ``meccanoid.toml``.

    Returns:
        The calibration of every joint in the file.

    Raises:
        CalibrationError: The file is no calibration; with file, joint and what was expected.
        OSError: The file cannot be read.
    """
    name = os.fspath(file)
    path = Path(name)
    shipped = resources.files(__name__.rpartition(".")[0]) / "calibrations" / path.name
    source = shipped if not path.exists() and path.name == name and shipped.is_file() else path
    try:
        content = tomllib.loads(source.read_bytes().decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:  # of bytes that are no UTF-8, and of TOML
        raise CalibrationError(f"{name}: expected a TOML file; {' '.join(str(error).split())[:200]}") from error
    return _parse(name, content)


def _parse(name: str, content: Mapping[str, object]) -> JointMap:
    """Return the calibration that a TOML document holds."""
    if content.get("format") != FORMAT:
        raise CalibrationError(f"{name}: expected format = {FORMAT}; got {content.get('format')!r:.80}")
    robot, tables = content.get("robot"), content.get("joint")
    if not isinstance(robot, str) or not robot:
        raise CalibrationError(f'{name}: expected robot = "a name"; got {robot!r:.80}')
    if not isinstance(tables, list) or not tables:
        raise CalibrationError(f"{name}: expected at least one [[joint]] table")
    joints = tuple(_joint(name, i, table) for i, table in enumerate(tables, 1))
    names = [joint.name for joint in joints]
    twice = sorted({n for n in names if names.count(n) > 1})
    if twice:
        raise CalibrationError(f"{name}: joint {twice[0]!r:.80} appears twice")
    whole = JointMap(robot, joints)
    if found := whole.problems():
        raise CalibrationError(f"{name}: {found[0]}")
    return whole


def _joint(file: str, number: int, table: object) -> JointCalibration:
    """Return the joint that a [[joint]] table describes."""
    where = f"{file}: joint {number}"
    if not isinstance(table, dict):
        raise CalibrationError(f"{where}: expected a [[joint]] table; got {table!r:.80}")
    if isinstance(table.get("name"), str):
        where += f" ({table['name'][:60]})"
    wrong = sorted((_KEYS ^ table.keys()) - _OPTIONAL)
    if wrong:
        verb = "lacks" if wrong[0] in _KEYS else "does not know"
        raise CalibrationError(f"{where}: {verb} {wrong[0]!r:.80}; the keys are {', '.join(sorted(_KEYS))}")
    pair = lambda key: _numbers(where, key, table[key], 2)  # noqa: E731
    one = lambda key: _numbers(where, key, [table[key]], 1)[0]  # noqa: E731
    if not isinstance(table["name"], str) or not table["name"]:
        raise CalibrationError(f"{where}: expected name to be a text; got {table['name']!r:.80}")
    if not isinstance(table["readback"], bool):
        raise CalibrationError(f"{where}: expected readback to be true or false; got {table['readback']!r:.80}")
    if not isinstance(table.get("channel", ""), str):
        raise CalibrationError(f'{where}: expected channel to be a text such as "D8/1"; got {table["channel"]!r:.80}')
    raw, limits, sign = pair("raw_range"), pair("limits_deg"), one("sign")
    if sign not in (1, -1):
        raise CalibrationError(f"{where}: sign must be 1 or -1; got {table['sign']!r:.80}")
    if not all(x.is_integer() for x in raw):
        raise CalibrationError(f"{where}: expected raw_range to be whole numbers; got {table['raw_range']!r:.80}")
    joint = JointCalibration(
        name=table["name"],
        raw_low=int(raw[0]),
        raw_high=int(raw[1]),
        neutral=one("neutral"),
        raw_per_rad=one("raw_per_rad"),
        sign=int(sign),
        lower=math.radians(limits[0]),
        upper=math.radians(limits[1]),
        max_rate=math.radians(one("max_rate_deg_s")),
        safe=math.radians(one("safe_deg")),
        readback=table["readback"],
        channel=table.get("channel", ""),
        measured=_times(where, table.get("measured", {})),
    )
    if found := joint.problems():
        raise CalibrationError(f"{where}: {found[0]}")
    return joint


def _times(where: str, table: object) -> Measured:
    """Return the times at which a joint's numbers were measured."""
    times = table if isinstance(table, dict) else {"": table}
    found: dict[str, datetime] = {}
    for name, time in times.items():
        if name in _MEASURED and isinstance(time, datetime):
            found[name] = time.astimezone(UTC)  # a time without a zone is local
        else:
            raise CalibrationError(
                f"{where}: expected measured to hold times of {', '.join(_MEASURED)}, such as "
                f"measured.zero = 2026-11-28T12:00:00Z; got {f'{name} = {time}':.80}"
            )
    return Measured(**found)


def _numbers(where: str, key: str, value: object, count: int) -> list[float]:
    """Return a list of exactly ``count`` finite numbers, or raise with the key and what was got."""
    numbers = value if isinstance(value, list) else []
    real = (x for x in numbers if isinstance(x, int | float) and not isinstance(x, bool))
    finite = [float(x) for x in real if abs(x) <= sys.float_info.max]  # integers in a file may be larger
    if len(finite) != count or len(numbers) != count:
        expected = "a finite number" if count == 1 else f"{count} finite numbers"
        raise CalibrationError(f"{where}: expected {key} to be {expected}; got {value!r:.80}")
    return finite
