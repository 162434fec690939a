"""Frames on the wire: COBS( version, sequence, type, payload, CRC-16 ) and a zero byte.

COBS writes each run of bytes without a zero as the run's length plus one, then the run. Zero bytes then occur only at
the end of a frame, so a receiver that has lost track resynchronizes at the next one. The CRC (polynomial 0x1021, start
0xFFFF) is sent inverted, high byte first: the CRC of a whole frame is then a constant. Without the inversion that
constant would be zero, and would stay zero for every zero byte that a garbled end of frame appends.
"""

import binascii
from typing import NamedTuple

VERSION = 1
MAX_PAYLOAD = 56  # the firmware has room for no more
_HEAD, _CRC, _RESIDUE = 3, 2, 0x1D0F
FRAME_BYTES = _HEAD + _CRC + 2  # bytes on the wire beside the payload


class Frame(NamedTuple):
    """Content of one frame.

    Attributes:
        sequence: From the host, the frame's number; from the board, the number it expects next. 0 to 255, then 0 again.
        type: Message type, a :class:`hardware.protocol.Message`.
        payload: Content of the message.
    """

    sequence: int
    type: int
    payload: bytes


def crc16(data: bytes, start: int = 0xFFFF) -> int:
    """Return the CRC-16 that host and board compute.

    Args:
        data: Bytes to check.
        start: CRC of the bytes before these.
    """
    return binascii.crc_hqx(data, start)


def encode(frame: Frame) -> bytes:
    """Return a frame's bytes on the wire, final zero included.

    Raises:
        ValueError: The payload is longer than COBS writes in one run.
    """
    plain = bytes((VERSION, frame.sequence, frame.type)) + frame.payload
    plain += (crc16(plain) ^ 0xFFFF).to_bytes(_CRC, "big")
    if len(plain) > 253:
        raise ValueError(f"a payload has at most {253 - _HEAD - _CRC} bytes; got {len(frame.payload)}")
    return b"".join(bytes((len(run) + 1,)) + run for run in plain.split(b"\0")) + b"\0"


def unstuff(stuffed: bytes) -> bytes | None:
    """Decode COBS; return None if the run lengths do not add up."""
    runs, at = [], 0
    while at < len(stuffed):
        after = at + stuffed[at]
        if stuffed[at] == 0 or after > len(stuffed):
            return None
        runs.append(stuffed[at + 1 : after])
        at = after
    return b"\0".join(runs)


class Decoder:
    """Incremental decoder of a stream of bytes; it drops everything invalid.

    Args:
        max_payload: Longest payload to accept [bytes].

    Attributes:
        dropped: Number of invalid frames so far.
    """

    def __init__(self, max_payload: int = MAX_PAYLOAD) -> None:
        self.dropped = 0
        self._longest = _HEAD + max_payload + _CRC
        self._pending = bytearray()
        self._overflow = False

    def feed(self, data: bytes) -> list[Frame]:
        """Take the next bytes of the stream, in portions of any size; return the frames that they complete."""
        *whole, rest = data.split(b"\0")
        frames = []
        for piece in whole:
            self._collect(piece)
            frame = None if self._overflow else self._frame(bytes(self._pending))
            if frame is not None:
                frames.append(frame)
            elif self._pending:
                self.dropped += 1
            self._pending.clear()
            self._overflow = False
        self._collect(rest)
        return frames

    def _collect(self, piece: bytes) -> None:
        """Append bytes to the pending frame, as far as the longest frame goes."""
        room = self._longest + 2 - len(self._pending)
        self._overflow |= len(piece) > room
        self._pending += piece[:room]

    def _frame(self, stuffed: bytes) -> Frame | None:
        """Return the frame, or None if it is invalid."""
        plain = unstuff(stuffed)
        if (
            plain is None
            or not _HEAD + _CRC <= len(plain) <= self._longest
            or crc16(plain) != _RESIDUE
            or plain[0] != VERSION
        ):
            return None
        return Frame(plain[1], plain[2], plain[_HEAD:-_CRC])
