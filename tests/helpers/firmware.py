"""The firmware's binary in simavr, built at test time, in virtual time: a peer for a transport in memory.

Needs Debian's gcc-avr, avr-libc, libsimavr-dev, libelf-dev, make and gcc. If one is missing, the tests that need them
are skipped with a message; with JAXIK_REQUIRE_FIRMWARE set, as in .ci/run, they fail.
"""

import ctypes
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import numpy as np
import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
FIRMWARE = REPOSITORY / "hardware" / "firmware"
BENCH = REPOSITORY / "tests" / "hardware" / "bench"
CYCLES_PER_US = 16
_TIMSK1 = 0x6F

EDGE = np.dtype([("cycle", "<u8"), ("pin", "u1"), ("level", "u1")], align=True)
BYTE = np.dtype([("cycle", "<u8"), ("byte", "u1")], align=True)
PACKET = np.dtype([("cycle", "<u8"), ("chain", "u1"), ("data", "u1", 5), ("answer", "u1")], align=True)


def missing() -> str:
    """Return the names of tools and headers that are not installed."""
    tools = [tool for tool in ("avr-gcc", "avr-size", "gcc", "make") if shutil.which(tool) is None]
    headers = [h for h in ("/usr/include/simavr/sim_avr.h", "/usr/include/libelf.h") if not Path(h).exists()]
    return ", ".join(tools + headers)


def require() -> None:
    """Skip the test if a tool is missing, or fail it if the firmware is required."""
    if lacking := missing():
        say = f"firmware tests need gcc-avr avr-libc libsimavr-dev libelf-dev (apt-get install); missing: {lacking}"
        (pytest.fail if os.environ.get("JAXIK_REQUIRE_FIRMWARE") else pytest.skip)(say)


@cache
def folder() -> Path:
    """Return the folder in which this process builds."""
    return Path(tempfile.mkdtemp(prefix="jaxik-firmware-"))


def run(*command: str | Path) -> str:
    """Run a build step and return its output."""
    words = [str(word) for word in command]
    done = subprocess.run(words, cwd=REPOSITORY, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@cache
def firmware(baud: int = 115_200) -> Path:
    """Build the firmware with its own Makefile; return the binary's path."""
    out = folder() / str(baud)
    run("make", "-s", "-C", FIRMWARE, f"BUILD={out}", f"BAUD={baud}")
    return out / "firmware.elf"


@cache
def sketch() -> Path:
    """Build the firmware as the Arduino IDE builds its folder, with the IDE's options; return the binary's path."""
    out = folder() / "sketch.elf"
    options = ["-Os", "-std=gnu11", "-ffunction-sections", "-fdata-sections", "-flto", "-mmcu=atmega328p"]
    sources = sorted(FIRMWARE.glob("*.c"))
    run("avr-gcc", *options, "-DF_CPU=16000000L", "-Wl,--gc-sections", *sources, "-o", out, "-lm")
    return out


@cache
def library() -> ctypes.CDLL:
    """Build the bench against the distribution's simulator, and load it."""
    out = folder() / "bench.so"
    run("gcc", "-O2", "-shared", "-fPIC", BENCH / "bench.c", BENCH / "core.c", "-o", out, "-lsimavr", "-lelf")
    lib = ctypes.CDLL(str(out))
    lib.bench_new.restype = ctypes.c_void_p
    lib.bench_new.argtypes = [ctypes.c_char_p, ctypes.c_uint32, ctypes.c_int]
    lib.bench_run.restype = ctypes.c_int64
    lib.bench_run.argtypes = [ctypes.c_void_p, ctypes.c_uint64]
    lib.bench_feed.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int, ctypes.c_uint64]
    lib.bench_module.argtypes = [ctypes.c_void_p] + 4 * [ctypes.c_int]
    lib.bench_hand.argtypes = [ctypes.c_void_p] + 3 * [ctypes.c_int]
    lib.bench_dip.argtypes = [ctypes.c_void_p] + 2 * [ctypes.c_int]
    lib.bench_mute.argtypes = [ctypes.c_void_p] + 3 * [ctypes.c_int]
    lib.bench_position.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_int]
    lib.bench_hang.argtypes = [ctypes.c_void_p, ctypes.c_uint32]
    lib.bench_memory.argtypes = [ctypes.c_void_p, ctypes.c_uint16]
    lib.bench_memory.restype = ctypes.c_uint8
    lib.bench_cycle.restype = lib.bench_slept.restype = ctypes.c_uint64
    for name in ("bench_cycle", "bench_slept", "bench_free", "bench_reset", "bench_overruns"):
        getattr(lib, name).argtypes = [ctypes.c_void_p]
    for name in ("bench_edges", "bench_sent", "bench_packets"):
        getattr(lib, name).restype = ctypes.c_void_p
        getattr(lib, name).argtypes = [ctypes.c_void_p, ctypes.POINTER(ctypes.c_size_t)]
    return lib


class Bench:
    """One chip with the firmware, in the simulator; a :class:`hardware.transport.Peer`.

    Args:
        baud: Bits per second of the serial line.
        skew: Relative excess of its clock's rate over the host's.
        plain: True to let simavr run every instruction itself, which takes longer and must not make a difference.
        ide: True for the binary of the Arduino IDE.
    """

    def __init__(self, baud: int = 115_200, skew: float = 0.0, plain: bool = False, ide: bool = False) -> None:
        self.lib, self.cycles_per_us = library(), CYCLES_PER_US * (1 + skew)
        self.byte_s = 10 / baud
        binary = sketch() if ide else firmware(baud)
        self.handle = self.lib.bench_new(str(binary).encode(), baud, plain)
        assert self.handle
        self._taken = self._sent = self.now_us = 0
        while not self.lib.bench_memory(self.handle, _TIMSK1):  # its clock starts with its first timer
            self.run(self.now_us + 1)
        self.boot_us = self.now_us

    def cycle(self, time_us: float) -> int:
        """Return the chip's cycle at a host's time [µs]."""
        return round(time_us * self.cycles_per_us)

    def run(self, until_us: int) -> None:
        """Advance to a host's time [µs]."""
        self.now_us = until_us
        self._sent = self.lib.bench_run(self.handle, self.cycle(until_us))
        assert self._sent >= 0, "the firmware crashed"

    def receive(self, data: bytes) -> None:
        """Send bytes to its serial port, from now on, one line time apart."""
        self.lib.bench_feed(self.handle, data, len(data), self.cycle(self.now_us))

    def take(self) -> bytes:
        """Return the bytes it has sent since the last call."""
        if self._sent == self._taken:
            return b""
        new = self._list(self.lib.bench_sent, BYTE, self._taken)["byte"]
        self._taken += len(new)
        return new.tobytes()

    def _list(self, call, dtype: np.dtype, first: int = 0) -> np.ndarray:
        """Return one of the bench's lists, from an entry on."""
        count = ctypes.c_size_t()
        at = call(self.handle, ctypes.byref(count))
        if count.value == first:
            return np.zeros(0, dtype)
        return np.frombuffer(
            ctypes.string_at(at + first * dtype.itemsize, (count.value - first) * dtype.itemsize), dtype
        )

    @property
    def cycles(self) -> int:
        """Number of cycles since power came on."""
        return self.lib.bench_cycle(self.handle)

    @property
    def awake(self) -> float:
        """Fraction of the time since power came on that it was not asleep."""
        return 1 - self.lib.bench_slept(self.handle) / self.cycles

    @property
    def sent(self) -> np.ndarray:
        """Bytes it has sent, with their cycles."""
        return self._list(self.lib.bench_sent, BYTE)

    @property
    def edges(self) -> np.ndarray:
        """Writes to the pulse outputs' pins, with their cycles."""
        return self._list(self.lib.bench_edges, EDGE)

    def memory(self) -> bytes:
        """Return registers and memory."""
        return bytes(self.lib.bench_memory(self.handle, at) for at in range(0x900))

    @property
    def packets(self) -> np.ndarray:
        """Packets that the modeled smart servos received."""
        return self._list(self.lib.bench_packets, PACKET)

    def pulses(self) -> np.ndarray:
        """Return all complete pulses: start cycle, pin 0-5, width in cycles."""
        edges = self.edges
        rows = []
        for pin in range(6):
            mine = edges[edges["pin"] == pin]
            mine = mine[np.append(True, mine["level"][1:] != mine["level"][:-1])] if len(mine) else mine
            rise = mine["cycle"][mine["level"] == 1].astype(np.int64)
            fall = mine["cycle"][mine["level"] == 0].astype(np.int64)
            fall = fall[fall > rise[0]] if len(rise) else fall[:0]
            count = min(len(rise), len(fall))
            rows.append(np.stack([rise[:count], np.full(count, pin), fall[:count] - rise[:count]], -1))
        table = np.concatenate(rows)
        return table[np.argsort(table[:, 0], kind="stable")]

    def module(self, chain: int, place: int, present: bool = True, position: int = 128) -> None:
        """Plug a smart servo in, at a position, or out."""
        self.lib.bench_module(self.handle, chain, place, present, position)

    def mute(self, chain: int, place: int) -> None:
        """Let a smart servo answer only while it is limp."""
        self.lib.bench_mute(self.handle, chain, place, 1)

    def dip(self, chain: int, us: int) -> None:
        """Disturb the third bit of every answer for a time [µs]; 0 for an undisturbed line."""
        self.lib.bench_dip(self.handle, chain, us)

    def hand(self, chain: int, place: int, position: int) -> None:
        """Hold a smart servo by hand at a position while it is limp; -1 for no hand."""
        self.lib.bench_hand(self.handle, chain, place, position)

    def position(self, chain: int, place: int) -> int:
        """Return the position of a smart servo."""
        return self.lib.bench_position(self.handle, chain, place)

    def reset(self) -> None:
        """Press the reset button."""
        self.lib.bench_reset(self.handle)

    def hang(self) -> None:
        """Let the program hang in the endless loop behind main, with interrupts off."""
        names = run("avr-nm", firmware()).splitlines()
        (end,) = [line.split()[0] for line in names if line.endswith(" __stop_program")]
        self.lib.bench_hang(self.handle, int(end, 16))

    @property
    def overruns(self) -> int:
        """Number of received bytes that the firmware fetched too late."""
        return self.lib.bench_overruns(self.handle)

    def stack_left(self) -> int:
        """Return the number of bytes never used between static memory and stack."""
        (end,) = [line.split()[0] for line in run("avr-nm", firmware()).splitlines() if line.endswith(" _end")]
        at = end = int(end, 16) & 0xFFFF
        while self.lib.bench_memory(self.handle, at) == 0xC5:
            at += 1
        return at - end

    def close(self) -> None:
        """Free the chip."""
        self.lib.bench_free(self.handle)


@contextmanager
def bench(**options) -> Iterator[Bench]:
    """Yield a chip for a with statement; skip the test without the packages."""
    require()
    chip = Bench(**options)
    try:
        yield chip
    finally:
        chip.close()
