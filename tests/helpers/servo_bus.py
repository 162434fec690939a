"""Servos on a bus, byte by byte, in memory or behind a pseudo-terminal; packets get lost or garbled, servos fail."""

import contextlib
import os
import random
import threading
import tty

import numpy as np

from hardware.clock import VirtualClock
from hardware.errors import LinkError

_PING, _READ, _WRITE, _SYNC_READ, _SYNC_WRITE = 0x01, 0x02, 0x03, 0x82, 0x83
BROADCAST = 0xFE
SPEED = 6500.0  # raw steps per second: 570 degrees per second


class ServoBus:
    """Transport to a chain of servos.

    Args:
        ids: Numbers of the servos.
        start: Raw position that they start at.
        clock: Clock of the host; None for a virtual one.
        baud: Bits per second; 0 for a line that takes no time.
        lose: Probability that a packet is lost, each way.
        garble: Probability that a packet is garbled, each way.
        seed: Seed of both.

    Attributes:
        disturbed: Number of packets lost or garbled.
        unguarded: Times and numbers of servos that moved without their watchdog.
        released_from: Torque and position per servo, just before the host first switched one off that was on.
        released_s: Time of that [s].
        deaf_to: Addresses that the servos do not take.
        gone: Numbers of servos that are unplugged.
        events: Times and functions to call at them, in order.
    """

    torque_at = position_at = goal_at = alerts_at = mode_at = 0
    watchdog_at = None
    position_bytes = 2

    def __init__(self, ids, start=2048, clock=None, baud=0, lose=0.0, garble=0.0, seed=0):
        self.clock = VirtualClock() if clock is None else clock
        self.byte_s = 10 / baud if baud else 0.0
        self.lose, self.garble, self.disturbed = lose, garble, 0
        self.unguarded, self.released_from, self.released_s, self.deaf_to = [], None, 0.0, set()
        self.gone, self.vanished, self.closed, self.events = set(), False, False, []
        self.random = random.Random(seed)
        self.in_parts = False  # packets arrive whole
        self.memory, self.at = {}, {}
        self._pending, self._replies, self._ready_s = b"", [], 0.0
        self._stepped_s = self._heard_s = self.clock.now()
        for i in ids:
            self.plug_in(i, start)

    def plug_in(self, servo, position=2048):
        """Add a servo as it is after power-on, or put it in the place of another one."""
        self.memory[servo] = self.fresh(servo)
        self.gone.discard(servo)
        self.at[servo] = float(position)
        self.put(servo, self.goal_at, position)

    def fresh(self, servo):
        raise NotImplementedError

    def pack(self, position):
        raise NotImplementedError

    def unpack(self, data):
        raise NotImplementedError

    def put(self, servo, address, position):
        self.memory[servo][address : address + self.position_bytes] = self.pack(int(position))

    def get(self, servo, address):
        if address == self.position_at:
            return round(self.at[servo])
        return self.unpack(bytes(self.memory[servo][address : address + self.position_bytes]))

    def driven(self):
        """Return the numbers of the servos that hold."""
        return [i for i, memory in self.memory.items() if memory[self.torque_at]]

    def alarm(self, servo, bit):
        """Raise an alert of a servo."""
        self.memory[servo][self.alerts_at] |= 1 << bit

    # ---- transport ----

    def write(self, data):
        self._check()
        self.step()
        self._heard_s = self.clock.now()
        self._ready_s = max(self._ready_s, self.clock.now()) + len(data) * self.byte_s
        data = self.disturb(data)
        self._pending += data
        while (cut := self.take(self._pending)) is not None:
            packet, self._pending = cut
            if packet is None:
                continue
            for reply in self.answer(*packet):
                self._ready_s += len(reply) * self.byte_s
                self._replies.append((self._ready_s, self.disturb(reply)))
        self._pending = self._pending if self.in_parts else b""

    def read(self):
        self._check()
        self.step()
        out = b""
        while self._replies and self._replies[0][0] <= self.clock.now():
            out += self._replies.pop(0)[1]
        return out

    def inject(self, data):
        """Let bytes arrive at the host that answer nothing it asked."""
        self._replies.append((self.clock.now(), data))

    def close(self):
        self.closed = True

    def _check(self):
        if self.vanished:
            raise LinkError("the link to the board is gone (vanished)")

    def disturb(self, packet):
        roll = self.random.random()
        if roll < self.lose:
            self.disturbed += 1
            return b""
        if roll < self.lose + self.garble:
            self.disturbed += 1
            wrong = bytearray(packet)
            for _ in range(self.random.randint(1, 3)):
                wrong[self.random.randrange(len(wrong))] ^= self.random.randint(1, 255)
            return bytes(wrong[: self.random.randint(1, len(wrong))] if self.random.random() < 0.2 else wrong)
        return packet

    # ---- servos ----

    def step(self):
        """Advance the servos to now."""
        now = self.clock.now()
        while self.events and self.events[0][0] <= now:
            self.events.pop(0)[1]()
        most = SPEED * (now - self._stepped_s)
        self._stepped_s = now
        for i, memory in self.memory.items():
            if not memory[self.torque_at]:
                continue
            watchdog = 0 if self.watchdog_at is None else memory[self.watchdog_at]
            if 0 < watchdog < 128 and now - self._heard_s > 0.02 * watchdog:
                memory[self.watchdog_at] = 0xFF
            if self.stopped(memory):
                continue
            way = self.get(i, self.goal_at) - self.at[i]
            if way and self.watchdog_at is not None and not memory[self.watchdog_at]:
                self.unguarded.append((now, i))
            self.at[i] += min(max(way, -most), most)

    def stopped(self, memory):
        return bool(self.watchdog_at is not None and memory[self.watchdog_at] == 0xFF)

    def load(self, servo, address, length):
        """Return the content of registers."""
        memory, at = self.memory[servo], self.position_at
        memory[at : at + self.position_bytes] = self.pack(round(self.at[servo]))
        return bytes(memory[address : address + length])

    def store(self, servo, address, data):
        """Take new content of registers, as far as the servo allows."""
        if servo not in self.memory or servo in self.gone or address in self.deaf_to:
            return
        memory = self.memory[servo]
        if address == self.torque_at and memory[address] and not data[0] and self.released_from is None:
            self.released_from = {i: (m[self.torque_at], round(self.at[i])) for i, m in self.memory.items()}
            self.released_s = self.clock.now()
        memory[address : address + len(data)] = data

    def answers(self, servo):
        return servo in self.memory and servo not in self.gone

    def chain(self, ids):
        """Return the numbers of the servos that answer to a question to several: none after one that is missing."""
        there = [self.answers(i) for i in ids]
        return ids[: there.index(False)] if False in there else ids


class DynamixelBus(ServoBus):
    """Dynamixel X servos; protocol 2.0."""

    torque_at, position_at, goal_at, alerts_at, mode_at, position_bytes = 64, 132, 116, 70, 11, 4
    watchdog_at = 98
    shutdown = 0b110100  # overload, electrical shock, overheating

    def fresh(self, servo):
        memory = bytearray(256)
        memory[0:2], memory[11], memory[144:146], memory[146] = (1060).to_bytes(2, "little"), 3, b"\x78\x00", 31
        memory[48:52], memory[52:56] = (4095).to_bytes(4, "little"), bytes(4)
        return memory

    def pack(self, position):
        return position.to_bytes(4, "little", signed=True)

    def unpack(self, data):
        return int.from_bytes(data, "little", signed=True)

    def alarm(self, servo, bit):
        super().alarm(servo, bit)
        if self.shutdown >> bit & 1:
            self.memory[servo][self.torque_at] = 0

    def store(self, servo, address, data):
        memory = self.memory.get(servo)
        if memory is None:
            return
        if address == self.torque_at and data[0]:
            if memory[self.alerts_at] & self.shutdown:
                return
            if not memory[self.torque_at] and memory[11] == 3:
                self.at[servo] %= 4096  # driven, it counts within one turn
        if address == self.goal_at:
            low, high = self.unpack(bytes(memory[52:56])), self.unpack(bytes(memory[48:52]))
            if memory[self.watchdog_at] == 0xFF or (memory[11] == 3 and not low <= self.unpack(data) <= high):
                return
        if address < 64 and memory[self.torque_at]:
            return
        super().store(servo, address, data)

    @staticmethod
    def crc(data):
        crc = 0
        for byte in data:
            crc = crc << 8 & 0xFFFF ^ _CRC[crc >> 8 ^ byte]
        return crc.to_bytes(2, "little")

    def take(self, data):
        at = data.find(b"\xff\xff\xfd\x00")
        if at < 0 or len(data) < at + 7:
            return None
        end = at + 7 + int.from_bytes(data[at + 5 : at + 7], "little")
        if len(data) < end:
            return None
        if len(data) < at + 10 or self.crc(data[at : end - 2]) != data[end - 2 : end]:
            return None, data[at + 4 :]
        return (data[at + 4], data[at + 7], data[at + 8 : end - 2]), data[end:]

    def status(self, servo, data=b"", error=0):
        error |= 0x80 if self.memory[servo][self.alerts_at] else 0
        packet = b"\xff\xff\xfd\x00" + bytes((servo,)) + (len(data) + 4).to_bytes(2, "little")
        packet += b"\x55" + bytes((error,)) + data
        return packet + self.crc(packet)

    def answer(self, servo, kind, rest):
        address, length = int.from_bytes(rest[:2], "little"), int.from_bytes(rest[2:4], "little")
        if kind == _PING:
            for i in sorted(self.memory) if servo == BROADCAST else [servo]:
                if self.answers(i):
                    yield self.status(i, self.load(i, 0, 2) + b"\x2d")
        elif kind == _READ and self.answers(servo):
            yield self.status(servo, self.load(servo, address, length))
        elif kind == _WRITE and self.answers(servo):
            self.store(servo, address, rest[2:])
            yield self.status(servo)
        elif kind == _SYNC_READ:
            for i in self.chain(rest[4:]):
                yield self.status(i, self.load(i, address, length))
        elif kind == _SYNC_WRITE and length:
            for at in range(4, len(rest) - length, length + 1):
                self.store(rest[at], address, rest[at + 1 : at + 1 + length])


class FeetechBus(ServoBus):
    """Feetech servos of the STS series."""

    torque_at, position_at, goal_at, alerts_at, mode_at, position_bytes = 40, 56, 42, 65, 33, 2

    def fresh(self, servo):
        memory = bytearray(256)
        memory[3:5], memory[9:11], memory[11:13] = (777).to_bytes(2, "little"), bytes(2), (4095).to_bytes(2, "little")
        memory[55], memory[62], memory[63] = 1, 74, 30
        return memory

    def pack(self, position):
        return (abs(position) | (0x8000 if position < 0 else 0)).to_bytes(2, "little")

    def unpack(self, data):
        content = int.from_bytes(data, "little")
        return -(content & 0x7FFF) if content & 0x8000 else content

    def stopped(self, memory):
        return bool(memory[self.alerts_at] & 0b100000)  # in overload it gives way

    def store(self, servo, address, data):
        if servo in self.memory and (address >= 40 or not self.memory[servo][55]):
            super().store(servo, address, data)

    def take(self, data):
        at = data.find(b"\xff\xff")
        if at < 0 or len(data) < at + 4 or len(data) < at + 4 + data[at + 3]:
            return None
        end = at + 4 + data[at + 3]
        if data[at + 3] < 2 or (~sum(data[at + 2 : end - 1])) & 0xFF != data[end - 1]:
            return None, data[at + 2 :]
        return (data[at + 2], data[at + 4], data[at + 5 : end - 1]), data[end:]

    def status(self, servo, data=b""):
        body = bytes((servo, len(data) + 2, self.memory[servo][self.alerts_at])) + data
        return b"\xff\xff" + body + bytes(((~sum(body)) & 0xFF,))

    def answer(self, servo, kind, rest):
        if kind == _PING:
            for i in sorted(self.memory) if servo == BROADCAST else [servo]:
                if self.answers(i):
                    yield self.status(i)
        elif kind == _READ and self.answers(servo) and len(rest) == 2:
            yield self.status(servo, self.load(servo, rest[0], rest[1]))
        elif kind == _WRITE and self.answers(servo) and rest:
            self.store(servo, rest[0], rest[1:])
            yield self.status(servo)
        elif kind == _SYNC_READ and len(rest) > 2:
            for i in self.chain(rest[2:]):
                yield self.status(i, self.load(i, rest[0], rest[1]))
        elif kind == _SYNC_WRITE and len(rest) > 2 and rest[1]:
            for at in range(2, len(rest) - rest[1], rest[1] + 1):
                self.store(rest[at], rest[0], rest[at + 1 : at + 1 + rest[1]])


def _crc_table():
    table = []
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x8005) & 0xFFFF if crc & 0x8000 else crc << 1 & 0xFFFF
        table.append(crc)
    return table


_CRC = _crc_table()


class OnPort(threading.Thread):
    """Thread that answers for a bus on a pseudo-terminal until closed, in real time.

    Args:
        bus: Bus whose clock is the computer's.
        baud: Rate that the bus answers at; at another one it hears nothing. None for any.

    Attributes:
        port: Name of the port.
    """

    def __init__(self, bus, baud=None):
        super().__init__(daemon=True)
        self.bus, self.baud = bus, baud
        bus.in_parts = True
        self._closing = False
        self._master, slave = os.openpty()
        tty.setraw(slave)
        self.port, self._slave = os.ttyname(slave), slave
        self.start()

    def run(self):
        import termios

        with contextlib.suppress(OSError):
            while not self._closing:
                data = os.read(self._master, 4096)
                if self.baud is not None:
                    speed = termios.tcgetattr(self._slave)[5]
                    if speed != getattr(termios, f"B{self.baud}"):
                        continue
                self.bus.write(data)
                os.write(self._master, self.bus.read())

    def close(self):
        self._closing = True
        os.write(self._slave, b"wake up")  # else the thread would read from the next file with this number
        self.join()
        os.close(self._slave)
        os.close(self._master)


class Maestro:
    """A Maestro as a transport: targets in, positions and errors out; some commands are lost."""

    byte_s = 0.0

    def __init__(self, lose=0.0, seed=0):
        self.targets, self.lose, self.lost, self.history = {}, lose, 0, []
        self._random, self._out = np.random.default_rng(seed), b""
        self.closed = False

    def write(self, data):
        for command in self._split(data):
            if self._random.random() < self.lose:
                self.lost += 1
                continue
            if command[0] == 0x84:
                self.targets[command[1]] = command[2] | command[3] << 7
                self.history.append((command[1], self.targets[command[1]]))
            elif command[0] == 0x90:
                self._out += self.targets.get(command[1], 0).to_bytes(2, "little")
            elif command[0] == 0xA1:
                self._out += b"\0\0"

    @staticmethod
    def _split(data):
        sizes = {0x84: 4, 0x90: 2, 0xA1: 1}
        while data:
            size = sizes[data[0]]
            yield data[:size]
            data = data[size:]

    def read(self):
        data, self._out = self._out, b""
        return data

    def close(self):
        self.closed = True
