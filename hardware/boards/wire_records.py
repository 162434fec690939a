"""Configuration records: a joint's calibration in the whole numbers that boards take."""

from hardware.errors import BoardError
from hardware.joint_map import JointCalibration
from hardware.protocol import Record, wire_servo


def wire_record(joint: JointCalibration, channel: int) -> Record:
    """Return the configuration record of one joint.

    Args:
        joint: Calibration of the joint.
        channel: Number of the servo's channel.

    Raises:
        BoardError: The channel cannot go where the calibration lets the joint go, or not as fast.
    """
    low, high = joint.raw_limits()
    safe = round(joint.neutral + joint.sign * joint.raw_per_rad * joint.safe)
    record = Record(channel, low, high, joint.step(), min(max(safe, low), high))
    if not record.plausible:
        servo = wire_servo(channel)
        raise BoardError(
            f"{joint.name} would go from raw {low} to {high} in steps of {record.step / 16:g} per 20 ms; its channel "
            f"takes {servo.raw_low} to {servo.raw_high} and steps of 1/16 to {servo.max_step / 16:g}"
        )
    return record
