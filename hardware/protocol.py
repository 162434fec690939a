"""Messages between host and firmware; ``firmware/protocol.h`` has the same numbers, and tests compare the two.

The host's messages come in three groups. HELLO and PING are answered at any time. STOP, HOLD and RELEASE are executed
even if frames before them were lost, and cancel those. All others are executed strictly in sequence and acknowledged.
"""

import enum
import struct
from collections.abc import Sequence
from typing import NamedTuple

from hardware.frames import MAX_PAYLOAD
from hardware.servo_limits import IDEAL_SERVO, PULSE_SERVO, SMART_SERVO, ServoLimits

PULSES, CHAINS, PLACES = 6, 2, 4
SMART = 0x10  # channels of smart servos: 0x10 + 4 * chain + place
IDEAL = 0x20  # channels of ideal servos, which only the executor on the host has: 16 bits each way
FIRST_PIN, FIRST_CHAIN_PIN = 2, 8  # as printed on the board: D2 to D7, D8 and D9
ANY_ORDER_BELOW, IN_SEQUENCE_FROM = 0x08, 0x10  # bounds of the groups of message types
FRAME_US = 20_000  # servo frame: period of the pulses, and what rate limits refer to
MAX_GAP_US = 1_000_000
STOP_MARGIN_MS = 130

_CHANNELS = {f"D{FIRST_PIN + pin}": pin for pin in range(PULSES)} | {
    f"D{FIRST_CHAIN_PIN + chain}/{place + 1}": SMART + PLACES * chain + place
    for chain in range(CHAINS)
    for place in range(PLACES)
}
_RECORD = struct.Struct("<BHHHH")
_COMMIT = struct.Struct("<HHHH")
_HELLO = struct.Struct("<BHBBHH")
_STATUS = struct.Struct("<IIiBBBBHHH")
STATUS_BYTES = _STATUS.size
RECORD_BYTES = _RECORD.size


class Message(enum.IntEnum):
    """Message types; the first thirteen come from the host, the others from the board."""

    HELLO = 0x01
    PING = 0x02
    STOP = 0x08
    HOLD = 0x09
    RELEASE = 0x0A
    CONFIG = 0x10
    COMMIT = 0x11
    ENABLE = 0x12
    WAYPOINTS = 0x13
    START = 0x14
    SETPOINT = 0x15
    LIMP = 0x16
    CLEAR = 0x17
    HELLO_REPLY = 0x81
    STATUS = 0x82
    ACK = 0x83
    NAK = 0x84


class Record(NamedTuple):
    """Configuration of one joint, in raw units.

    Attributes:
        channel: Number of the servo's channel.
        low: Lowest raw value.
        high: Highest raw value.
        step: Greatest change per 20 ms, in sixteenths of a raw step.
        safe: First raw value of a servo without read-back.
    """

    channel: int
    low: int
    high: int
    step: int
    safe: int

    def pack(self) -> bytes:
        """Return the record's bytes in a CONFIG message."""
        return _RECORD.pack(*self)

    @property
    def plausible(self) -> bool:
        """True if the channel exists and can go where the numbers say."""
        channel = self.channel
        servo = wire_servo(channel)
        exists = channel < PULSES or SMART <= channel < SMART + CHAINS * PLACES or channel >= IDEAL
        ordered = servo.raw_low <= self.low <= self.safe <= self.high <= servo.raw_high and self.low < self.high
        return exists and ordered and 0 < self.step <= servo.max_step


class Hello(NamedTuple):
    """Content of a HELLO_REPLY.

    Attributes:
        firmware: Version of the firmware.
        boots: Number of starts since power came on.
        reset_cause: Processor's reset register (MCUSR) at the last start.
        max_joints: Greatest number of joints.
        pool_bytes: Memory for queued waypoints [bytes].
        calibration: CRC of the calibration it holds, or 0.
    """

    firmware: int
    boots: int
    reset_cause: int
    max_joints: int
    pool_bytes: int
    calibration: int


class StatusHeader(NamedTuple):
    """Part of a STATUS message that is the same for every configuration.

    Attributes:
        echo: Number sent with the PING.
        time_us: Board's clock, 32 bits [µs].
        motion_us: Time since the motion's zero [µs]; negative before.
        flags: State in bits 0-1, then done, configured, braking.
        fault: Code of the :class:`hardware.board.Fault`.
        fault_joint: Place of the joint that the fault is about.
        free: Free places in the waypoint queue.
        next_index: Index of the waypoint expected next.
        calibration: CRC of the calibration it holds, or 0.
        vcc_mv: Supply voltage [mV]; 0 before the first measurement.
    """

    echo: int
    time_us: int
    motion_us: int
    flags: int
    fault: int
    fault_joint: int
    free: int
    next_index: int
    calibration: int
    vcc_mv: int

    @property
    def state(self) -> int:
        """Code of the :class:`hardware.board.State`."""
        return self.flags & 3

    @property
    def done(self) -> bool:
        """True once the last waypoint has been reached."""
        return bool(self.flags & 4)

    @property
    def configured(self) -> bool:
        """True while the board holds a configuration."""
        return bool(self.flags & 8)


def parse_channel(name: str) -> int | None:
    """Return the number of a channel named by its pin, or None if there is no such channel.

    Args:
        name: ``"D2"`` to ``"D7"`` for a pulse output, ``"D8/1"`` to ``"D9/4"`` for a place on a chain.
    """
    return _CHANNELS.get(name)


def wire_servo(channel: int) -> ServoLimits:
    """Return the limits of the servo at a channel's number."""
    return IDEAL_SERVO if channel >= IDEAL else SMART_SERVO if channel >= SMART else PULSE_SERVO


def value_format(channels: Sequence[int]) -> str:
    """Return the struct format of one value per joint, in joint order."""
    return "".join("B" if SMART <= channel < IDEAL else "H" for channel in channels)


def config_payloads(records: Sequence[Record], max_payload: int = MAX_PAYLOAD) -> list[bytes]:
    """Return the payloads of the CONFIG messages that carry these records.

    Args:
        records: One per joint.
        max_payload: Longest payload [bytes].
    """
    each = (max_payload - 2) // _RECORD.size
    return [
        bytes((first, len(records))) + b"".join(record.pack() for record in records[first : first + each])
        for first in range(0, len(records), each)
    ]


def unpack_records(data: bytes) -> list[Record]:
    """Return the records of a CONFIG message."""
    return [Record(*fields) for fields in _RECORD.iter_unpack(data)]


def commit_payload(calibration: int, records_crc: int, stop_within_ms: int, release_after_ms: int) -> bytes:
    """Return the payload of a COMMIT message.

    Args:
        calibration: CRC of the calibration.
        records_crc: CRC of all packed records.
        stop_within_ms: Silence within which the arm must be at rest [ms].
        release_after_ms: Silence after which the servos are released [ms].
    """
    return _COMMIT.pack(calibration, records_crc, stop_within_ms, release_after_ms)


def pack_hello(hello: Hello) -> bytes:
    """Return the payload of a HELLO_REPLY message."""
    return _HELLO.pack(*hello)


def unpack_hello(payload: bytes) -> Hello | None:
    """Return the content of a HELLO_REPLY message, or None if the length is wrong."""
    return Hello(*_HELLO.unpack(payload)) if len(payload) == _HELLO.size else None


def pack_status(status: StatusHeader) -> bytes:
    """Return the header of a STATUS message."""
    return _STATUS.pack(*status)


def unpack_status(payload: bytes) -> StatusHeader | None:
    """Return the header of a STATUS message, or None if it is too short."""
    return StatusHeader(*_STATUS.unpack_from(payload)) if len(payload) >= _STATUS.size else None


def status_values(channels: Sequence[int]) -> struct.Struct:
    """Return the layout of a STATUS message behind its header: per joint commanded and, with read-back, measured."""
    return struct.Struct("<" + "".join("HH" if c >= IDEAL else "BB" if c >= SMART else "H" for c in channels))
