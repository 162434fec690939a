"""Calibrations from data sheets, for a first try of servos that nobody has measured yet."""

import math
from collections.abc import Sequence

from hardware.errors import CalibrationError
from hardware.joint_map import JointCalibration, JointMap, ideal_joint_map
from hardware.protocol import FIRST_PIN, PULSES

_TURN = 4096 / (2 * math.pi)  # of bus servos
_HOBBY = 2000 / math.pi  # microseconds a radian: 500 to 2500 over half a turn


def nominal_joint_map(kind: str, names: Sequence[str]) -> JointMap:
    """What a data sheet says of servos plugged in one after the other: zero in the middle, half a turn, gently.

    Args:
        kind: Kind of board.
        names: Joints in the order of the servos.

    Raises:
        CalibrationError: More joints than the board has such servos.
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
                raw_per_rad=_HOBBY if hobby else _TURN,
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
