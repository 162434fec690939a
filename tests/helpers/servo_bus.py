"""Servos on a bus, byte by byte, behind a pseudo-terminal; some replies are garbled."""

import contextlib
import os
import threading
import tty

import numpy as np

_WRITE, _SYNC_READ, _SYNC_WRITE = 0x03, 0x82, 0x83


class ServoBus(threading.Thread):
    """Thread that answers on a pseudo-terminal until closed.

    Args:
        ids: Numbers of the servos.
        start: Raw position that they start at.
        corrupt: Probability that a byte of a reply is wrong.
        seed: Seed of the garbling.
    """

    torque_at = position_at = goal_at = 0
    position_bytes = 2

    def __init__(self, ids, start=2048, corrupt=0.0, seed=0):
        super().__init__(daemon=True)
        self.memory = {i: bytearray(256) for i in ids}
        self._closing = False
        self.corrupt, self.corrupted = corrupt, 0
        self._random = np.random.default_rng(seed)
        self._master, slave = os.openpty()
        tty.setraw(slave)
        self.port, self._slave = os.ttyname(slave), slave
        for i in ids:
            self.put(i, self.position_at, start)
            self.put(i, self.goal_at, start)
        self.start()

    def put(self, servo, address, value):
        self.memory[servo][address : address + self.position_bytes] = int(value).to_bytes(self.position_bytes, "little")

    def get(self, servo, address):
        return int.from_bytes(self.memory[servo][address : address + self.position_bytes], "little")

    def driven(self):
        """Return the numbers of the servos that hold."""
        return [i for i, memory in self.memory.items() if memory[self.torque_at]]

    def write(self, servo, address, data):
        self.memory[servo][address : address + len(data)] = data
        if address == self.goal_at and self.memory[servo][self.torque_at]:
            self.put(servo, self.position_at, self.get(servo, self.goal_at))  # a quick servo

    def run(self):
        pending = b""
        with contextlib.suppress(OSError):
            while not self._closing:
                pending += os.read(self._master, 4096)
                while (cut := self.take(pending)) is not None:
                    packet, pending = cut
                    for reply in self.answer(*packet):
                        os.write(self._master, self.garble(reply))

    def garble(self, reply):
        hit = self._random.random(len(reply)) < self.corrupt
        self.corrupted += bool(hit.any())
        return bytes(np.frombuffer(reply, np.uint8) ^ np.where(hit, 0x20, 0).astype(np.uint8))

    def close(self):
        self._closing = True
        os.write(self._slave, b"wake up")  # else the thread would read from the next file with this number
        self.join()
        os.close(self._slave)
        os.close(self._master)


class DynamixelBus(ServoBus):
    """Dynamixel X servos; protocol 2.0."""

    torque_at, position_at, goal_at, position_bytes = 64, 132, 116, 4

    @staticmethod
    def crc(data):
        crc = 0
        for byte in data:
            crc ^= byte << 8
            for _ in range(8):
                crc = (crc << 1 ^ 0x8005) & 0xFFFF if crc & 0x8000 else crc << 1 & 0xFFFF
        return crc.to_bytes(2, "little")

    def take(self, data):
        at = data.find(b"\xff\xff\xfd\x00")
        if at < 0 or len(data) < at + 7:
            return None
        end = at + 7 + int.from_bytes(data[at + 5 : at + 7], "little")
        if len(data) < end:
            return None
        assert self.crc(data[at : end - 2]) == data[end - 2 : end]
        return (data[at + 4], data[at + 7], data[at + 8 : end - 2]), data[end:]

    def status(self, servo, data=b""):
        packet = b"\xff\xff\xfd\x00" + bytes((servo,)) + (len(data) + 4).to_bytes(2, "little") + b"\x55\x00" + data
        return packet + self.crc(packet)

    def answer(self, servo, kind, rest):
        address, length = int.from_bytes(rest[:2], "little"), int.from_bytes(rest[2:4], "little")
        if kind == _WRITE and servo in self.memory:
            self.write(servo, address, rest[2:])
            yield self.status(servo)
        elif kind == _SYNC_READ:
            for i in rest[4:]:
                if i in self.memory:
                    yield self.status(i, bytes(self.memory[i][address : address + length]))
        elif kind == _SYNC_WRITE:
            for at in range(4, len(rest), length + 1):
                self.write(rest[at], address, rest[at + 1 : at + 1 + length])


class FeetechBus(ServoBus):
    """Feetech servos of the STS series."""

    torque_at, position_at, goal_at, position_bytes = 40, 56, 42, 2

    def take(self, data):
        at = data.find(b"\xff\xff")
        if at < 0 or len(data) < at + 4 or len(data) < at + 4 + data[at + 3]:
            return None
        end = at + 4 + data[at + 3]
        assert (~sum(data[at + 2 : end - 1])) & 0xFF == data[end - 1]
        return (data[at + 2], data[at + 4], data[at + 5 : end - 1]), data[end:]

    def status(self, servo, data=b""):
        body = bytes((servo, len(data) + 2, 0)) + data
        return b"\xff\xff" + body + bytes(((~sum(body)) & 0xFF,))

    def answer(self, servo, kind, rest):
        if kind == _WRITE and servo in self.memory:
            self.write(servo, rest[0], rest[1:])
            yield self.status(servo)
        elif kind == _SYNC_READ:
            for i in rest[2:]:
                if i in self.memory:
                    yield self.status(i, bytes(self.memory[i][rest[0] : rest[0] + rest[1]]))
        elif kind == _SYNC_WRITE:
            for at in range(2, len(rest), rest[1] + 1):
                self.write(rest[at], rest[0], rest[at + 1 : at + 1 + rest[1]])


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
