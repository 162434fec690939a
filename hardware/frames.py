"""Frames on the wire: COBS( version, sequence, type, payload, CRC-16 ) and a zero byte.

COBS writes a run of bytes without zero as its length plus one and the run, so that a zero ends a frame and nothing
else: a receiver that has lost its place finds it again at the next zero. The CRC (polynomial 0x1021, start 0xFFFF)
comes inverted and high byte first; over a whole frame it is then a constant. Not inverted that constant would be zero,
and stay zero with every zero byte that a garbled end of frame appends.
"""

import binascii
from typing import NamedTuple

VERSION = 1
MAX_PAYLOAD = 56  # what the firmware has room for
_HEAD, _CRC, _RESIDUE = 3, 2, 0x1D0F
FRAME_BYTES = _HEAD + _CRC + 2  # what a frame adds to its payload on the wire


class Frame(NamedTuple):
    """What one frame says.

    Attributes:
        sequence: Its number from the host, or the number the board expects next; 0 to 255, then 0 again.
        type: What kind of message.
        payload: Its content.
    """

    sequence: int
    type: int
    payload: bytes


def crc16(data: bytes, start: int = 0xFFFF) -> int:
    """CRC-16 as both sides compute it."""
    return binascii.crc_hqx(data, start)


def encode(frame: Frame) -> bytes:
    """A frame as it goes on the wire, zero included.

    Raises:
        ValueError: The payload is longer than COBS writes in one run.
    """
    plain = bytes((VERSION, frame.sequence, frame.type)) + frame.payload
    plain += (crc16(plain) ^ 0xFFFF).to_bytes(_CRC, "big")
    if len(plain) > 253:
        raise ValueError(f"a payload has at most {253 - _HEAD - _CRC} bytes; got {len(frame.payload)}")
    return b"".join(bytes((len(run) + 1,)) + run for run in plain.split(b"\0")) + b"\0"


def unstuff(stuffed: bytes) -> bytes | None:
    """Undoes COBS; None where the runs do not fit."""
    runs, at = [], 0
    while at < len(stuffed):
        after = at + stuffed[at]
        if stuffed[at] == 0 or after > len(stuffed):
            return None
        runs.append(stuffed[at + 1 : after])
        at = after
    return b"\0".join(runs)


class Decoder:
    """Cuts a stream of bytes into frames and drops what is none.

    Args:
        max_payload: Longest payload to accept.
    """

    def __init__(self, max_payload: int = MAX_PAYLOAD) -> None:
        self.dropped = 0
        self._longest = _HEAD + max_payload + _CRC
        self._pending = bytearray()
        self._overflow = False

    def feed(self, data: bytes) -> list[Frame]:
        """Takes bytes as they come, in any portions; returns the frames they complete."""
        *whole, rest = data.split(b"\0")
        frames = []
        for piece in whole:
            self._take(piece)
            frame = None if self._overflow else self._frame(bytes(self._pending))
            if frame is not None:
                frames.append(frame)
            elif self._pending:
                self.dropped += 1
            self._pending.clear()
            self._overflow = False
        self._take(rest)
        return frames

    def _take(self, piece: bytes) -> None:
        """Collects, up to what a frame may have."""
        room = self._longest + 2 - len(self._pending)
        self._overflow |= len(piece) > room
        self._pending += piece[:room]

    def _frame(self, stuffed: bytes) -> Frame | None:
        """The frame, or None if it is none."""
        plain = unstuff(stuffed)
        if (
            plain is None
            or not _HEAD + _CRC <= len(plain) <= self._longest
            or crc16(plain) != _RESIDUE
            or plain[0] != VERSION
        ):
            return None
        return Frame(plain[1], plain[2], plain[_HEAD:-_CRC])
