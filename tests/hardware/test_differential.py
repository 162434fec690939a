"""The Python model and the firmware's binary: from the same bytes at the same times, the same answers and pulses."""

import struct

import numpy as np
import pytest

from hardware import protocol
from hardware.frames import Decoder, Frame, crc16, encode
from hardware.protocol import Message, Record
from hardware.simulation import BoardModel
from tests.helpers.firmware import CYCLES_PER_US, bench

SLOT_US = 3333
CALIBRATION = 0x1234
RECORDS = [
    Record(0, 500, 2500, 1200, 1500),
    Record(2, 600, 2400, 3000, 1000),
    Record(5, 500, 2500, 800, 2000),
    Record(0x10, 24, 232, 64, 128),
    Record(0x11, 30, 200, 64, 100),
    Record(0x14, 24, 232, 64, 128),
]
STAND = [0, 0, 0, 120, 101, 60]
LAYOUT = protocol.value_format([record.channel for record in RECORDS])
PLACES = {0x10: (0, 0), 0x11: (0, 1), 0x14: (1, 0)}


class Script:
    """Bytes and their times in slots of the board; a PING follows every frame."""

    def __init__(self, seed: int) -> None:
        self.random = np.random.default_rng(seed)
        self.bytes: list[tuple[int, bytes]] = []
        self.slot, self.sequence, self.motion_us, self.index = 4, 0, 0, 0
        self.raw = [1500, 1000, 2000, 120, 101, 60]

    def wait(self, slots: int) -> None:
        self.slot += slots

    def put(self, data: bytes) -> None:
        """Send bytes of which the last arrives in the middle of a slot."""
        self.bytes.append((self.slot * SLOT_US + 1500, data))
        self.slot += 1 + len(data) // 20

    def ping(self) -> None:
        self.put(encode(Frame(self.sequence, Message.PING, b"echo")))
        self.wait(2)

    def say(self, kind: int, payload: bytes = b"", skip: int = 0) -> None:
        self.put(encode(Frame((self.sequence + skip) % 256, kind, payload)))
        self.sequence = (self.sequence + (skip == 0)) % 256
        self.ping()

    def configure(self, rounds: int = 45) -> None:
        packed = b"".join(record.pack() for record in RECORDS)
        for payload in protocol.config_payloads(RECORDS):
            self.say(Message.CONFIG, payload)
        self.say(Message.COMMIT, protocol.commit_payload(CALIBRATION, crc16(packed), 300, 1000))
        for _ in range(rounds):  # time for discovery, without a silence
            self.wait(6)
            self.ping()

    def enable(self) -> None:
        self.say(Message.ENABLE, CALIBRATION.to_bytes(2, "little"))

    def waypoints(self, count: int, last: bool = False, wild: float = 1.0) -> None:
        rows = b""
        for _ in range(count):
            gap = int(self.random.integers(20_000, 60_000))
            self.motion_us += gap
            for j, record in enumerate(RECORDS):
                most = max(1, int(0.9 * wild * record.step / 16 * gap / 20_000))
                wanted = self.raw[j] + int(self.random.integers(-most, most + 1))
                self.raw[j] = int(np.clip(wanted, record.low, record.high)) if wild <= 2 else wanted % 2**8
            rows += struct.pack("<I" + LAYOUT, self.motion_us, *self.raw)
        self.say(Message.WAYPOINTS, self.index.to_bytes(2, "little") + bytes((last,)) + rows)
        self.index += count

    def start(self) -> None:
        self.say(Message.START, (self.slot * SLOT_US + 30_000).to_bytes(4, "little"))

    def forget_motion(self) -> None:
        self.motion_us = self.index = 0

    def episode(self) -> None:
        """Play a motion, perhaps disturbed, to one of several ends."""
        random = self.random
        self.forget_motion()
        self.raw = [1500, 1000, 2000, 120, 101, 60]
        self.configure(rounds=10)
        self.enable()
        self.say(Message.SETPOINT, struct.pack("<" + LAYOUT, *self.raw))
        for _ in range(8):
            self.wait(8)
            self.ping()
        wild = float(random.choice([1.0, 1.0, 1.0, 1.2]))
        for _ in range(6):
            self.waypoints(2)
        self.start()
        for _ in range(int(random.integers(0, 6))):
            self.waypoints(2, wild=wild)
            self.wait(int(random.integers(1, 8)))
        ending = int(random.integers(0, 4))
        if ending == 0:
            self.waypoints(1, last=True)
        elif ending == 1:
            self.wait(int(random.integers(40, 400)))  # silence
        elif ending == 2:
            self.anything()
        for _ in range(40):
            self.wait(12)
            self.ping()

    def anything(self) -> None:
        """Do one of the things that may happen."""
        random = self.random
        match int(random.integers(0, 14)):
            case 0:
                self.say(Message.STOP)
                self.forget_motion()
            case 1:
                self.say(Message.HOLD)
            case 2:
                self.say(int(random.integers(0, 0x20)), random.bytes(int(random.integers(0, 12))))
            case 3:
                self.put(random.bytes(int(random.integers(1, 60))) + b"\0")
            case 4:
                self.say(Message.SETPOINT, bytes.fromhex("dc05e803d0077b6540"))
            case 5:
                self.say(Message.LIMP, int(random.integers(0, 64)).to_bytes(2, "little"))
            case 6:
                self.say(Message.PING, b"echo", skip=int(random.integers(-9, 9)))
            case 7:
                self.say(Message.STOP, skip=int(random.integers(1, 9)))
            case 8:
                self.waypoints(2, wild=float(random.choice([1.0, 4.0])))
            case 9:
                self.say(Message.HELLO)
            case 12:  # in the past, now, or too far ahead
                start_us = self.slot * SLOT_US + int(random.choice([-50_000, 100_000, 20_000_000]))
                self.say(Message.START, (start_us % 2**32).to_bytes(4, "little"))
            case 10:
                self.wait(int(random.integers(1, 150)))
            case 13:
                self.say(Message.CLEAR)
                self.forget_motion()
            case _:
                self.waypoints(1, last=bool(random.random() < 0.3))


def readable(frame):
    """Return an answer without times and supply, which differ slightly, and separately the smart servos' values."""
    payload, smart = frame.payload, []
    if frame.type == Message.STATUS:
        playing = payload[12] & 3 == 2
        pulses = sum(2 for record in RECORDS if record.channel < protocol.SMART)
        smart = list(payload[protocol.STATUS_BYTES + pulses :])
        fixed = payload[: protocol.STATUS_BYTES]
        payload = fixed[:4] + fixed[8 + (4 if playing else 0) : 20] + payload[protocol.STATUS_BYTES :][:pulses]
    if frame.type == Message.HELLO_REPLY:
        payload = payload[:1] + payload[4:]
    return (frame.sequence, Message(frame.type).name, payload.hex()), smart


def run_model(script):
    model = BoardModel(lambda count: [float(x) for x in STAND], keep_pulses=True)
    for channel, (chain, place) in PLACES.items():
        model.modules[chain].modules[place].position = STAND[[r.channel for r in RECORDS].index(channel)]
    for chain in range(2):
        for place in range(4):
            model.modules[chain].modules[place].present = (chain, place) in PLACES.values()
    answers = []
    for at, data in script.bytes:
        model.run(at)
        model.receive(data)
        answers += Decoder().feed(model.take())
    model.run(script.slot * SLOT_US)
    return answers, np.array(model.pulses).reshape(-1, 3)


def run_firmware(script):
    with bench() as chip:
        for j, record in enumerate(RECORDS):
            if record.channel in PLACES:
                chip.module(*PLACES[record.channel], True, STAND[j])
        boot_us = chip.boot_us
        decoder, answers = Decoder(), []
        for at, data in script.bytes:
            chip.run(round(at + boot_us - len(data) * chip.byte_s * 1e6))
            chip.receive(data)
        chip.run(round(script.slot * SLOT_US + boot_us))
        answers = decoder.feed(chip.take())
        pulses = chip.pulses()
        pulses[:, 0] -= round(boot_us * CYCLES_PER_US)
    return answers, pulses


@pytest.mark.parametrize("seed", range(5))
def test_model_and_firmware_agree(seed):
    script = Script(seed)
    script.say(Message.HELLO)
    script.configure()
    script.enable()
    script.waypoints(2)
    script.waypoints(2)
    script.start()
    for _ in range(3):
        script.waypoints(2, last=False)
    for _ in range(4):
        script.episode()
    for _ in range(20):
        script.anything()
    script.wait(300)
    script.ping()
    expected, model_pulses = run_model(script)
    answers, pulses = run_firmware(script)
    ours, theirs = list(map(readable, expected)), list(map(readable, answers))
    for i, (one, other) in enumerate(zip(ours, theirs, strict=False)):
        assert one[0] == other[0], f"answer {i}"
        # If a packet or a slot falls just before or just after a question depends on a few microseconds: the values are
        # those of this answer or of a neighboring one, within a few raw steps.
        near = [smart for _, smart in theirs[max(0, i - 1) : i + 2] if len(smart) == len(one[1])]
        assert (np.min(np.abs(np.array(near) - one[1]), axis=0) <= 4).all(), f"answer {i}: {one}, {near}"
    assert len(answers) == len(expected)
    assert len(model_pulses) > 100
    assert len(pulses) == len(model_pulses)
    np.testing.assert_array_equal(pulses[:, 1:], model_pulses[:, 1:])
    np.testing.assert_allclose(pulses[:, 0] / CYCLES_PER_US, model_pulses[:, 0], atol=2.0)
