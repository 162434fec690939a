"""Both codecs side by side, the firmware's compiled for this machine.

``python -m tests.helpers.codec LIBRARY FRAMES`` feeds both the same corrupted frames and prints how many were valid. It
is a process of its own because the type checks of a test session would take most of the time.
"""

import ctypes
import sys
from pathlib import Path

import numpy as np

from hardware.frames import Decoder, Frame, encode

GOLDEN = Path(__file__).resolve().parents[1] / "golden" / "frames.txt"


def golden() -> list[tuple[Frame, bytes]]:
    """Return every recorded frame and its bytes on the wire."""
    rows = []
    for line in GOLDEN.read_text().splitlines():
        if not line.startswith("#"):
            sequence, kind, payload, wire = line.split()
            content = bytes.fromhex(payload.replace("-", ""))
            rows.append((Frame(int(sequence, 16), int(kind, 16), content), bytes.fromhex(wire)))
    return rows


def load(path: str | Path) -> ctypes.CDLL:
    """Load the compiled codec."""
    library = ctypes.CDLL(str(path))
    library.codec_feed.restype = ctypes.c_long
    library.codec_feed.argtypes = [ctypes.c_char_p, ctypes.c_long, ctypes.c_char_p]
    library.frame_encode.restype = ctypes.c_uint8
    library.chain_check_byte.restype = ctypes.c_uint8
    return library


def c_encode(codec: ctypes.CDLL, frame: Frame) -> bytes:
    """Encode a frame in C."""
    wire = ctypes.create_string_buffer(64)
    count = codec.frame_encode(frame.sequence, frame.type, frame.payload, len(frame.payload), wire)
    return wire.raw[:count]


def c_decode(codec: ctypes.CDLL, data: bytes) -> list[Frame]:
    """Decode frames in C."""
    out = ctypes.create_string_buffer(len(data) + 64)
    total = codec.codec_feed(data, len(data), out)
    plain = out.raw[:total]
    frames, at = [], 0
    while at < len(plain):
        after = at + 1 + plain[at]
        frames.append(Frame(plain[at + 2], plain[at + 3], plain[at + 4 : after]))
        at = after
    return frames


def corrupted(count: int, seed: int) -> bytes:
    """Return a stream of frames with changed and missing bytes."""
    random = np.random.default_rng(seed)
    good = [encode(frame) for frame, _ in golden()]
    stream = np.frombuffer(b"".join(good[i] for i in random.integers(0, len(good), count)), np.uint8)
    stream = stream[random.random(len(stream)) > 0.01]
    noise = random.random(len(stream)) < 0.02
    return np.where(noise, random.integers(0, 256, len(stream)), stream).astype(np.uint8).tobytes()


def main(library: str, frames: str) -> None:
    """Compare both codecs on a number of frames."""
    codec, decoder, valid = load(library), Decoder(), 0
    for seed in range(20):
        stream = corrupted(int(frames) // 20, seed)
        ours = decoder.feed(stream)
        assert ours == c_decode(codec, stream), f"seed {seed}"
        valid += len(ours)
    print(valid)


if __name__ == "__main__":
    main(*sys.argv[1:])
