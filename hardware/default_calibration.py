"""Calibrations by data sheet, for a first try with servos that nobody has measured."""

import math
from collections.abc import Sequence
from dataclasses import replace

from hardware.errors import CalibrationError
from hardware.joint_map import JointCalibration, JointMap, ideal_joint_map
from hardware.protocol import FIRST_PIN, PULSES


def _servo(low: int, high: int, raw_per_rad: float, readback: bool) -> JointCalibration:
    """Return a servo with zero in the middle of its range."""
    quarter, rate = math.pi / 2, math.radians(60)
    middle = (low + high) / 2
    return JointCalibration("", low, high, middle, raw_per_rad, 1, -quarter, quarter, rate, 0.0, readback)


_HOBBY = _servo(500, 2500, 2000 / math.pi, readback=False)  # microseconds of pulse over half a turn
_SMART = _servo(24, 232, 208 / math.pi, readback=True)
_BUS = _servo(1024, 3072, 4096 / (2 * math.pi), readback=True)
# Channel of the first joint.
_FIRST = {"arduino": FIRST_PIN, "dynamixel": 1, "feetech": 1, "maestro": 0, "meccanoid": 0}


def default_joint_map(kind: str, names: Sequence[str]) -> JointMap:
    """Return a calibration by data sheet of servos plugged in one after the other.

    Zero is the middle of the range, every joint may go a quarter turn to either side, at 60 degrees per second.

    Args:
        kind: Kind of board, as in an address of :func:`hardware.connect`.
        names: Joints in the order of the servos.

    Raises:
        CalibrationError: There are more joints than the board has outputs for hobby servos, or there is no such board.
    """
    if kind == "simulated":
        return ideal_joint_map(names)
    if kind not in _FIRST:
        raise CalibrationError(
            f"there is no calibration by data sheet for {kind!r}; there is one for {', '.join(_FIRST)}"
        )
    if kind == "arduino" and len(names) > PULSES:
        raise CalibrationError(
            f"the board has {PULSES} outputs for hobby servos; {len(names)} joints need a calibration"
        )
    servo = {"arduino": _HOBBY, "maestro": _HOBBY, "meccanoid": _SMART}.get(kind, _BUS)
    prefix = "D" if kind == "arduino" else ""
    return JointMap(
        f"{kind}, not calibrated",
        tuple(replace(servo, name=name, channel=f"{prefix}{_FIRST[kind] + i}") for i, name in enumerate(names)),
    )
