"""Motions of hours: indices and times wrap in model and firmware alike, nothing grows, and nothing freezes or jumps."""

import ctypes
import pickle
import struct

import numpy as np
import pytest

import hardware
from hardware import Fault, State, Waypoint
from hardware.executor import SLOT_US, Executor
from hardware.frames import crc16
from hardware.protocol import Record, commit_payload
from hardware.waypoint_queue import Entry
from tests.helpers import firmware
from tests.helpers.firmware import BENCH, CYCLES_PER_US, FIRMWARE, bench
from tests.helpers.playing import connected

RECORDS = [Record(0, 500, 2500, 1200, 1500), Record(2, 600, 2400, 3000, 1000), Record(5, 500, 2500, 800, 2000)]
CALIBRATION = 0x1234


class Both:
    """The firmware's motion.c, compiled for this machine, and the executor, step by step with the same input."""

    def __init__(self):
        out = firmware.folder() / "native.so"
        sources = [BENCH / "native.c", FIRMWARE / "motion.c", FIRMWARE / "frame.c"]
        firmware.run("gcc", "-O2", "-shared", "-fPIC", *sources, "-o", out)
        self.c, self.python = ctypes.CDLL(str(out)), Executor()
        self.c.native_reset()
        for name, kind in {"state": ctypes.c_uint8, "command": ctypes.c_uint16, "index": ctypes.c_uint16}.items():
            getattr(self.c, f"native_{name}").restype = kind
        self.c.motion_waypoints.restype = self.c.motion_start.restype = ctypes.c_uint8
        self.c.motion_slot.restype = ctypes.c_uint16
        self.slot, self.now_us = 0, 0
        self.index, self.motion_us, self.raw = 0, 0, [1500, 1000, 2000]
        self.random = np.random.default_rng(7)
        packed = b"".join(record.pack() for record in RECORDS)
        commit = commit_payload(CALIBRATION, crc16(packed), 300, 2000)
        self.c.motion_config(bytes((0, len(RECORDS))) + packed, 2 + len(packed))
        self.python.config(0, len(RECORDS), packed)
        self.c.motion_commit(commit)
        self.python.commit(*struct.unpack("<HHHH", commit))
        self.c.motion_enable(CALIBRATION)
        self.python.enable(CALIBRATION)

    def waypoint(self, last=False):
        self.motion_us += int(self.random.integers(5_000, 30_000))
        self.raw = [
            int(np.clip(raw + self.random.integers(-9, 10), record.low, record.high))
            for raw, record in zip(self.raw, RECORDS, strict=True)
        ]
        time_us = self.motion_us % 2**32
        payload = struct.pack("<HBI3H", self.index % 2**16, last, time_us, *self.raw)
        ours = self.python.waypoints(self.index, last, [Entry(self.motion_us, tuple(self.raw))])
        assert self.c.motion_waypoints(payload, len(payload)) == ours == Fault.NONE
        self.index += 1

    def start(self):
        start_us = self.now_us + 30_000
        ours = self.python.start(start_us, self.now_us % 2**32)
        assert self.c.motion_start(start_us % 2**32, self.now_us % 2**32) == ours == Fault.NONE

    def step(self):
        """Advance by a slot, and compare every command."""
        self.slot, self.now_us = (self.slot + 1) % 6, self.now_us + SLOT_US
        board_us = self.now_us % 2**32
        self.c.native_heard(board_us)
        self.python.heard_us = board_us
        self.c.motion_slot(self.slot, board_us)
        self.python.slot(self.slot, board_us)
        ours = [self.python.state | self.python.fault << 2, self.python.next_index, *self.python.command]
        theirs = [self.c.native_state(), self.c.native_index(), *map(self.c.native_command, range(3))]
        assert ours == theirs
        return np.array(self.python.command)

    def play(self, seconds):
        """Play on, the queue kept full; return the commands of every slot."""
        rows = []
        for _ in range(int(seconds * 1e6 / SLOT_US)):
            while len(self.python.queue) < 20:
                self.waypoint()
            rows.append(self.step())
        return np.array(rows)

    def jump(self, us, waypoints):
        """Pretend that the motion has been going on for longer."""
        self.c.native_jump(ctypes.c_uint32(us % 2**32), ctypes.c_uint16(waypoints % 2**16))
        executor, queue = self.python, self.python.queue
        executor.next_index = (executor.next_index + waypoints) % 2**16
        executor.start_us -= us
        executor.time_us = (executor.time_us + us) % 2**32
        queue._passed = Entry((queue._passed.time + us) % 2**32, queue._passed.values)
        queue._ahead = [Entry((entry.time + us) % 2**32, entry.values) for entry in queue._ahead]
        self.motion_us, self.index = self.motion_us + us, self.index + waypoints


@pytest.fixture
def both():
    firmware.require()
    return Both()


def assert_smooth(commands):
    """Check that nothing jumps or freezes: up to 9 raw steps per waypoint, of which at most five begin in 20 ms."""
    assert np.abs(np.diff(commands, axis=0)).max() <= 5 * 9 * 16
    moved = np.abs(np.diff(commands[::60], axis=0)).sum(1)
    assert (moved > 0).all()


@pytest.mark.parametrize("board_us", [0, 2**32 - 1_000_000])
def test_model_and_firmware_agree_where_indices_and_times_wrap(both, board_us):
    """65 536 waypoints; 2^31 µs, where a signed difference turns; 2^32 µs of motion; and the board's own clock."""
    both.now_us = board_us
    for _ in range(20):
        both.waypoint()
    both.start()
    before = both.play(0.5)
    both.jump(0, 65_500 - both.index)
    index = both.play(2.0)
    assert both.index > 65_600
    both.jump(2**31 - 1_000_000 - both.motion_us, 3_000)
    half = both.play(2.5)
    both.jump(2**32 - 1_000_000 - both.motion_us, 100_000)
    whole = both.play(2.5)
    for commands in (before[60:], index, half, whole):
        assert_smooth(commands)
    assert both.python.time_us < 2_000_000, "it has wrapped"
    both.waypoint(last=True)
    for _ in range(300):
        both.step()
    assert both.python.done
    assert both.python.fault is Fault.NONE
    assert both.python.command == [value * 16 for value in both.raw]


def test_a_fault_is_cleared_without_releasing(both):
    for _ in range(20):
        both.waypoint()
    both.start()
    for _ in range(200):
        commands = both.step()
    assert both.python.fault is Fault.UNDERRUN
    both.c.motion_clear()
    both.python.clear()
    assert (both.step() == commands).all()
    assert (both.python.state, both.python.fault) == (State.HOLDING, Fault.NONE)
    both.index = both.motion_us = 0
    both.waypoint()


def drawn(count, gap_us):
    """Return waypoints of a motion of two servos that never rests."""
    time_us = gap_us * np.arange(1, count + 1)
    raw = np.rint(1500 + np.outer(np.sin(time_us * 2e-6), [300, 200])).astype(int)
    return [
        Waypoint(i, int(t), tuple(row), i == count - 1)
        for i, (t, row) in enumerate(zip(time_us, raw.tolist(), strict=True))
    ]


@pytest.mark.slow
def test_the_binary_plays_beyond_65536_waypoints():
    """Waypoints 4 ms apart, so that four minutes are enough, over the whole protocol."""
    rows = hardware.load_joint_map("meccanoid.toml").select(["right_wrist_roll", "left_wrist_roll"])
    points = drawn(66_000, 4_000)
    with bench() as chip:
        board = connected(chip)
        board.configure(rows)
        board.enable()
        board.move(points[0].raw)
        for _ in range(10):
            board.clock.sleep(0.1)
            board.status()
        sent = 0
        while not (status := board.status()).done:
            assert status.fault is Fault.NONE
            board.send(points[sent : sent + status.free])
            started, sent = sent > 0, min(sent + status.free, len(points))
            if not started:
                board.start(100_000)
                start_us = chip.now_us + 100_000
            board.clock.sleep(0.12)
        pulses = chip.pulses()
    time_us, played = np.array([point.time_us for point in points]), np.array([point.raw for point in points])
    for j, pin in enumerate((0, 3)):
        at, _, width = pulses[pulses[:, 1] == pin].T
        moving = at > (start_us + 100_000) * CYCLES_PER_US
        planned = np.interp(at[moving] / CYCLES_PER_US - start_us, time_us, played[:, j])
        assert moving.sum() > 13_000
        assert np.abs(width[moving] / CYCLES_PER_US - planned).max() < 3, "0.6 raw steps per ms, started within 5 ms"


def test_the_modeled_board_and_its_host_grow_no_further():
    """Everything that board, link and model hold, apart from a log cut short here, has its size after a few seconds."""
    board = hardware.connect("simulated")
    board.model.log = type(board.model.log)(maxlen=20)
    joints = hardware.load_joint_map("meccanoid.toml")
    board.configure(joints)
    board.enable()

    def size_after(seconds):
        for _ in range(int(seconds / 0.1)):
            board.clock.sleep(0.1)
            board.status()
        return len(pickle.dumps(vars(board.model) | {"_stand": 0, "_stuck": 0})) + len(pickle.dumps(board.link.fit))

    sizes = [size_after(seconds) for seconds in (30, 10, 10)]
    assert max(sizes) - min(sizes) < 200, sizes
    assert len(board.link._asked) <= 64
