"""Calibrations by data sheet, for a first try with servos that nobody has measured."""

import math
from collections.abc import Sequence

from hardware.errors import CalibrationError
from hardware.joint_map import JointCalibration, JointMap, ideal_joint_map
from hardware.protocol import FIRST_PIN, PULSES

_BUS_SERVO = 4096 / (2 * math.pi)  # raw steps per radian
_HOBBY_SERVO = 2000 / math.pi  # microseconds per radian: 500 to 2500 over half a turn


def default_joint_map(kind: str, names: Sequence[str]) -> JointMap:
    """Return a calibration by data sheet of servos plugged in one after the other.

    Zero is the middle of the range, every joint may go a quarter turn to either side, at 60 degrees per second.

    Args:
        kind: Kind of board, as in an address of :func:`hardware.connect`.
        names: Joints in the order of the servos.

    Raises:
        CalibrationError: There are more joints than the board has outputs for hobby servos.
    """
    if kind == "simulated":
        return ideal_joint_map(names)
    quarter, rate = math.pi / 2, math.radians(60)
    hobby = kind in ("arduino", "maestro")
    if kind == "arduino" and len(names) > PULSES:
        raise CalibrationError(
            f"the board has {PULSES} outputs for hobby servos; {len(names)} joints need a calibration"
        )
    first = {"arduino": FIRST_PIN, "maestro": 0}.get(kind, 1)
    prefix = "D" if kind == "arduino" else ""
    return JointMap(
        f"{kind}, not calibrated",
        tuple(
            JointCalibration(
                name=name,
                raw_low=500 if hobby else 1024,
                raw_high=2500 if hobby else 3072,
                neutral=1500.0 if hobby else 2048.0,
                raw_per_rad=_HOBBY_SERVO if hobby else _BUS_SERVO,
                sign=1,
                lower=-quarter,
                upper=quarter,
                max_rate=rate,
                safe=0.0,
                readback=not hobby,
                channel=f"{prefix}{first + i}",
            )
            for i, name in enumerate(names)
        ),
    )
