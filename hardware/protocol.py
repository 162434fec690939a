"""What host and firmware say to each other; the same numbers stand in ``firmware/protocol.h``, and tests compare them.

The host's frames are of three groups. HELLO and PING are answered whenever they come. STOP, HOLD and RELEASE are
executed even if frames before them were lost, and make those void. The rest is executed strictly in sequence, and
acknowledged.
"""

import enum
import struct
from collections.abc import Sequence
from typing import NamedTuple

from hardware.frames import MAX_PAYLOAD

PULSES, CHAINS, PLACES = 6, 2, 4
SMART = 0x10  # channels of smart servos: 0x10 + 4 * chain + place
IDEAL = 0x20  # channels that only the simulated board has: 16 bits each way
FIRST_PIN, FIRST_CHAIN_PIN = 2, 8  # as printed on the board: D2 to D7, D8 and D9
ANY_ORDER_BELOW, IN_SEQUENCE_FROM = 0x08, 0x10
MAX_GAP_US = 1_000_000
STOP_MARGIN_MS = 130

_RECORD = struct.Struct("<BHHHH")
_COMMIT = struct.Struct("<HHHH")
_HELLO = struct.Struct("<BHBBHH")
_STATUS = struct.Struct("<IIiBBBBHHH")


class Message(enum.IntEnum):
    """Types of frames."""

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
    LIM = 0x16
    HELLO_REPLY = 0x81
    STATUS = 0x82
    ACK = 0x83
    NAK = 0x84


class Record(NamedTuple):
    """One joint's configuration, in raw units.

    Attributes:
        channel: Which servo.
        low: Lowest raw value.
        high: Highest.
        step: Greatest change per 20 ms, in sixteenths.
        safe: Where a servo without read-back is driven first.
    """

    channel: int
    low: int
    high: int
    step: int
    safe: int

    def pack(self) -> bytes:
        """As the board takes it."""
        return _RECORD.pack(*self)


class Hello(NamedTuple):
    """A board's introduction: firmware's version, starts since power came, cause of the last, limits, calibration."""

    firmware: int
    boots: int
    reset_cause: int
    max_joints: int
    pool_bytes: int
    calibration: int


class BoardStatus(NamedTuple):
    """What the board says of itself, as on the wire."""

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
        """0 detached, 1 holding, 2 playing."""
        return self.flags & 3

    @property
    def done(self) -> bool:
        """Whether the last waypoint has been reached."""
        return bool(self.flags & 4)

    @property
    def configured(self) -> bool:
        """Whether it holds a configuration."""
        return bool(self.flags & 8)


def channel(name: str) -> int | None:
    """A channel by the pin printed on the board: ``"D2"`` to ``"D7"``, or ``"D8/1"`` to ``"D9/4"`` along a chain."""
    pin, _, place = name.partition("/")
    if not (pin[:1] == "D" and pin[1:].isdecimal()):
        return None
    number = int(pin[1:])
    if not place:
        return number - FIRST_PIN if 0 <= number - FIRST_PIN < PULSES else None
    chain = number - FIRST_CHAIN_PIN
    fits = 0 <= chain < CHAINS and place.isdecimal() and 1 <= int(place) <= PLACES
    return SMART + PLACES * chain + int(place) - 1 if fits else None


def value_format(channels: Sequence[int]) -> str:
    """Format of one value per joint, in joint order."""
    return "".join("B" if SMART <= c < IDEAL else "H" for c in channels)


def config_payloads(records: Sequence[Record], max_payload: int = MAX_PAYLOAD) -> list[bytes]:
    """CONFIG messages that hold these records."""
    each = (max_payload - 2) // _RECORD.size
    return [
        bytes((first, len(records))) + b"".join(record.pack() for record in records[first : first + each])
        for first in range(0, len(records), each)
    ]


def unpack_records(data: bytes) -> list[Record]:
    """Records of a CONFIG message."""
    return [Record(*fields) for fields in _RECORD.iter_unpack(data)]


def commit_payload(calibration: int, records_crc: int, stop_within_ms: int, release_after_ms: int) -> bytes:
    """A COMMIT message."""
    return _COMMIT.pack(calibration, records_crc, stop_within_ms, release_after_ms)


def pack_hello(hello: Hello) -> bytes:
    """A HELLO_REPLY message."""
    return _HELLO.pack(*hello)


def unpack_hello(payload: bytes) -> Hello | None:
    """A board's introduction, or None if it is none."""
    return Hello(*_HELLO.unpack(payload)) if len(payload) == _HELLO.size else None


def pack_status(status: BoardStatus) -> bytes:
    """The fixed part of a STATUS message."""
    return _STATUS.pack(*status)


def unpack_status(payload: bytes) -> BoardStatus | None:
    """The fixed part of a STATUS message, or None if it is none."""
    return BoardStatus(*_STATUS.unpack_from(payload)) if len(payload) >= _STATUS.size else None


def status_values(channels: Sequence[int]) -> struct.Struct:
    """The part of a STATUS message that follows, joint by joint: commanded, and measured where there is read-back."""
    return struct.Struct("<" + "".join("HH" if c >= IDEAL else "BB" if c >= SMART else "H" for c in channels))


STATUS_BYTES = _STATUS.size
RECORD_BYTES = _RECORD.size
