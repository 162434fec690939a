"""Frames: known and arbitrary ones, both ways, in Python and C; and numbers that host and firmware share."""

import re
import sys

import pytest
from cobs import cobs
from hypothesis import given
from hypothesis import strategies as st

from hardware import executor, protocol
from hardware.board import Fault, State
from hardware.frames import Decoder, Frame, crc16, encode, unstuff
from hardware.simulation import chain
from tests.helpers.codec import c_decode, c_encode, golden, load
from tests.helpers.firmware import BENCH, FIRMWARE, folder, require, run

SANITIZERS = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g", "-O1"]
PARTS = [FIRMWARE / name for name in ("frame.c", "motion.c", "chain.c")]


@pytest.fixture(scope="module")
def library():
    """Compile the firmware's codec for this machine."""
    require()
    out = folder() / "codec.so"
    run("gcc", "-O2", "-Wall", "-shared", "-fPIC", "-I", FIRMWARE, BENCH / "codec.c", *PARTS, "-o", out)
    return out


@pytest.fixture(scope="module")
def codec(library):
    return load(library)


def test_known_frames_in_python():
    rows = golden()
    assert len(rows) == 20
    for frame, wire in rows:
        assert encode(frame) == wire
        assert Decoder().feed(wire) == [frame]


def test_known_frames_in_c(codec):
    for frame, wire in golden():
        assert c_encode(codec, frame) == wire
        assert c_decode(codec, wire) == [frame]


@given(st.integers(0, 255), st.integers(0, 255), st.binary(max_size=56), st.lists(st.integers(1, 9), max_size=9))
def test_any_frame_in_any_portions(sequence, kind, payload, cuts):
    frame = Frame(sequence, kind, payload)
    wire = encode(frame)
    assert cobs.decode(wire[:-1])[3:-2] == payload
    decoder, got, at = Decoder(), [], 0
    for cut in [*cuts, len(wire)]:
        got += decoder.feed(wire[at : at + cut])
        at += cut
    assert got == [frame]


@given(st.binary(max_size=300))
def test_unstuffing_agrees_with_the_cobs_package(data):
    try:
        expected = cobs.decode(data)
    except cobs.DecodeError:
        expected = None
    if b"\0" not in data and not (len(data) > 254 or b"\xff" in data):
        assert unstuff(data) == expected


def test_a_frame_too_long_is_dropped_and_the_next_is_read():
    long, good = encode(Frame(1, 2, bytes(57))), encode(Frame(1, 2, bytes(56)))
    decoder = Decoder()
    assert decoder.feed(long + good) == [Frame(1, 2, bytes(56))]
    assert decoder.dropped == 1
    with pytest.raises(ValueError, match="at most 248 bytes; got 249"):
        encode(Frame(0, 0, bytes(249)))


@pytest.mark.slow
def test_both_codecs_read_a_million_bad_frames_alike(library):
    valid = int(run(sys.executable, "-m", "tests.helpers.codec", library, "1000000"))
    assert 200_000 < valid < 600_000


@pytest.mark.slow
def test_a_million_bad_frames_change_nothing_in_the_firmware_unless_valid():
    require()
    out = folder() / "fuzz"
    run(
        "gcc", *SANITIZERS, "-Wall", "-Wextra", "-I", FIRMWARE, BENCH / "fuzz.c", FIRMWARE / "link.c", *PARTS, "-o", out
    )
    said = run(out, "1000000", "1")
    frames, valid = map(int, re.match(r"(\d+) frames, (\d+) valid", said).groups())
    assert frames == 1_000_000
    assert 200_000 < valid < 400_000


MESSAGES = {
    "HELLO": 0x01,
    "PING": 0x02,
    "STOP": 0x08,
    "HOLD": 0x09,
    "RELEASE": 0x0A,
    "CONFIG": 0x10,
    "COMMIT": 0x11,
    "ENABLE": 0x12,
    "WAYPOINTS": 0x13,
    "START": 0x14,
    "SETPOINT": 0x15,
    "LIMP": 0x16,
    "CLEAR": 0x17,
    "HELLO_REPLY": 0x81,
    "STATUS": 0x82,
    "ACK": 0x83,
    "NAK": 0x84,
}
FAULTS = {
    "NONE": 0,
    "LATE": 1,
    "UNDERRUN": 2,
    "RANGE": 3,
    "RATE": 4,
    "ORDER": 5,
    "SILENCE": 6,
    "CONFIG": 7,
    "STATE": 8,
    "SERVO": 9,
    "LENGTH": 10,
}
STATES = {"DETACHED": 0, "HOLDING": 1, "PLAYING": 2}


def header_numbers():
    """Return every number that protocol.h and motion.h give a name, with its name."""
    text = (FIRMWARE / "protocol.h").read_text() + (FIRMWARE / "motion.h").read_text()
    return {name: int(value, 0) for name, value in re.findall(r"\b([A-Z_]+) = (0x[0-9A-Fa-f]+|\d+)", text)}


@pytest.mark.parametrize(
    ("codes", "enumeration", "prefix"),
    [(MESSAGES, protocol.Message, ""), (FAULTS, Fault, "FAULT_"), (STATES, State, "")],
    ids=["message", "fault", "state"],
)
def test_codes_on_the_wire_stay_as_they_are(codes, enumeration, prefix):
    """A board keeps its firmware when the host is updated: the numbers written here are for good."""
    assert {member.name: member.value for member in enumeration} == codes
    in_c = header_numbers()
    assert {name: in_c[prefix + name] for name in codes} == codes
    if prefix:
        assert {name.removeprefix(prefix) for name in in_c if name.startswith(prefix)} == codes.keys()


def test_host_and_firmware_share_constants():
    """Compare protocol.h and motion.h with the Python constants."""
    numbers = header_numbers()
    for name in ("PULSES", "CHAINS", "PLACES", "SMART", "RECORD_BYTES", "ANY_ORDER_BELOW", "IN_SEQUENCE_FROM"):
        assert numbers[name] == getattr(protocol, name)
    for name in (
        "SLOT_US",
        "PACKET_US",
        "BRAKE_SLOTS",
        "BRAKE_US",
        "MIN_GAP_US",
        "MAX_LEAD_US",
        "POOL_BYTES",
    ):
        assert numbers[name] == getattr(executor, name)
    for name in ("FRAME_US", "MAX_GAP_US", "STOP_MARGIN_MS"):
        assert numbers[name] == getattr(protocol, name)
    assert crc16(b"123456789") == 0x29B1


@pytest.mark.parametrize("packet", ["B48DFEFE41", "B4C7FEFE11", "B4E8FEFE41", "18C7FEFEA1", "78C7FEFE11", "E8C7FEFE81"])
def test_check_bytes_of_captured_packets(packet, codec):
    *data, check = bytes.fromhex(packet)
    assert chain.check_byte(bytes(data), check & 3) == check
    assert codec.chain_check_byte(bytes(data), check & 3) == check


def test_an_additional_zero_byte_is_noticed(codec):
    """An end of frame garbled into an empty COBS run appends a zero; a CRC with residue zero would not notice."""
    for frame, wire in golden():
        longer = wire[:-1] + b"\x01\x00"
        assert unstuff(longer[:-1]) == unstuff(wire[:-1]) + b"\0"
        assert Decoder(60).feed(longer) == []
        assert c_decode(codec, longer) == [], frame
