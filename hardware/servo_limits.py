"""Numbers that servos take: one table for host, model and firmware, which all check a calibration against it.

``firmware/limits.h`` has the rows that the firmware needs, and tests compare the two.
"""

from typing import NamedTuple


class ServoLimits(NamedTuple):
    """Plausible numbers of a kind of servo.

    Attributes:
        name: Words for such a servo.
        raw_low: Lowest raw value.
        raw_high: Highest raw value.
        max_step: Greatest change per servo frame of 20 ms, in sixteenths of a raw step.
        reports: True if it can report its position.
    """

    name: str
    raw_low: int
    raw_high: int
    max_step: int
    reports: bool


PULSE_SERVO = ServoLimits("a hobby servo", 400, 2600, 8000, False)  # µs; 45° per frame is faster than any there is
SMART_SERVO = ServoLimits("a Meccano smart servo", 24, 232, 640, True)
BUS_SERVO = ServoLimits("a bus servo", -0x8000, 0x7FFF, 0xFFFF, True)  # eight turns either way
FEETECH_SERVO = ServoLimits("a Feetech servo", -30_719, 30_719, 0xFFFF, True)
IDEAL_SERVO = ServoLimits("a simulated servo", 0, 0xFFFF, 0xFFFF, True)
