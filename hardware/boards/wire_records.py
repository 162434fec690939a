"""A joint's calibration as boards take it: whole numbers within what the servo can do."""

from hardware.errors import BoardError
from hardware.joint_map import JointCalibration
from hardware.protocol import Record

_FRAME_S, _SIXTEENTHS = 0.02, 16  # what a board's rate limit counts in


def record_of(joint: JointCalibration, channel: int, most: int) -> Record:
    """One joint's configuration.

    Args:
        joint: Its calibration.
        channel: Which servo.
        most: Greatest raw value the channel takes.

    Raises:
        BoardError: The channel cannot go where the calibration lets the joint go.
    """
    raw_at = lambda q: joint.neutral + joint.sign * joint.raw_per_rad * q  # noqa: E731
    ends = sorted(map(raw_at, (joint.lower, joint.upper)))
    low, high = max(joint.raw_low, round(ends[0])), min(joint.raw_high, round(ends[1]))
    if not 0 <= low < high <= most:
        raise BoardError(f"{joint.name} would go from raw {low} to {high}; its channel takes 0 to {most}")
    step = round(joint.max_rate * joint.raw_per_rad * _FRAME_S * _SIXTEENTHS)
    return Record(channel, low, high, min(max(1, step), 0xFFFF), min(max(round(raw_at(joint.safe)), low), high))
