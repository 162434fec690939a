"""Channels: names of the outputs that servos are plugged into, and the kind of servo there."""

import re

from hardware.protocol import SMART, parse_channel
from hardware.servo_limits import BUS_SERVO, FEETECH_SERVO, IDEAL_SERVO, PULSE_SERVO, SMART_SERVO, ServoLimits

# Per kind of board with numbered outputs: the highest number, and the servo.
_NUMBERED = {
    "dynamixel": (252, BUS_SERVO),
    "feetech": (253, FEETECH_SERVO),
    "maestro": (23, PULSE_SERVO),
    "meccanoid": (7, SMART_SERVO),
}
_ANY = (253, BUS_SERVO)  # a number without a board's name
CHANNELS = 'an Arduino has "D2" to "D7" and "D8/1" to "D9/4", a servo bus or a Maestro has numbers such as "5"'


def servo_at(channel: str, kind: str = "") -> ServoLimits | None:
    """Return the limits of the servo at a channel, or None if there is no such channel.

    Args:
        channel: Channel of a calibration: ``"D2"``, ``"D8/1"``, ``"5"``; with its board's kind in front if several play
            together, ``"meccanoid:5"``; empty for a simulated servo.
        kind: Kind of board; empty for any.
    """
    if not channel:
        return None if kind in ("arduino", *_NUMBERED) else IDEAL_SERVO
    named, _, output = channel.rpartition(":")
    if named not in ("", "arduino", *_NUMBERED):
        return None
    kind = named or kind
    if kind not in _NUMBERED and (number := parse_channel(output)) is not None:
        return PULSE_SERVO if number < SMART else SMART_SERVO
    if kind == "arduino":
        return None
    last, servo = _NUMBERED.get(kind, _ANY)
    return servo if re.fullmatch(r"0|[1-9][0-9]{0,2}", output) and int(output) <= last else None


def family(channel: str) -> str:
    """Return words for the boards that have a channel of such a name; empty for no channel."""
    if not channel:
        return ""
    named, _, output = channel.rpartition(":")
    if named:
        return "several boards together"
    return "an Arduino" if parse_channel(output) is not None else "a servo bus or a Maestro"
