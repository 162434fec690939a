"""Configuration records: a joint's calibration in the whole numbers that boards take."""

from hardware.errors import BoardError
from hardware.joint_map import JointCalibration
from hardware.protocol import FRAME_US, Record

_FRAME_S = FRAME_US / 1e6
_SIXTEENTHS = 16  # per raw step


def wire_record(joint: JointCalibration, channel: int, highest: int) -> Record:
    """Return the configuration record of one joint.

    Args:
        joint: Calibration of the joint.
        channel: Number of the servo's channel.
        highest: Greatest raw value that the channel takes.

    Raises:
        BoardError: The channel cannot go where the calibration lets the joint go.
    """
    raw_at = lambda q: joint.neutral + joint.sign * joint.raw_per_rad * q  # noqa: E731
    ends = sorted(map(raw_at, (joint.lower, joint.upper)))
    low, high = max(joint.raw_low, round(ends[0])), min(joint.raw_high, round(ends[1]))
    if not 0 <= low < high <= highest:
        raise BoardError(f"{joint.name} would go from raw {low} to {high}; its channel takes 0 to {highest}")
    step = round(joint.max_rate * joint.raw_per_rad * _FRAME_S * _SIXTEENTHS)
    return Record(channel, low, high, min(max(1, step), 0xFFFF), min(max(round(raw_at(joint.safe)), low), high))
