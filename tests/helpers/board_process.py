"""A board behind a pseudo-terminal in a process of its own, which outlives the program that plays on it.

``python -m tests.helpers.board_process KIND`` prints the port and runs until its input ends; then it prints, as JSON,
what it was told to do with its servos: rows of monotonic time [s], servo, and value, 0 when released. Kinds: arduino
(the model), maestro, feetech and dynamixel. A line ``vanish`` closes the port as an unplugged adapter does.
"""

import contextlib
import json
import os
import select
import subprocess
import sys
import time
import tty

from hardware.clock import WallClock
from hardware.simulation import BoardModel
from tests.helpers.servo_bus import BROADCAST, DynamixelBus, FeetechBus, Maestro

STAND, _WRITE = 1500.0, 0x03


class Told:
    """Rows of time, servo and value; only changes, and pulses, are kept."""

    def __init__(self):
        self.rows = []

    def note(self, servo, value):
        self.rows.append((time.monotonic(), int(servo), float(value)))


def arduino(told):
    """Return functions that take bytes and give bytes: a modeled Arduino in wall time."""
    model = BoardModel(lambda count: [128.0 if count > 4 else STAND] * count, keep_pulses=True)
    began, known = time.monotonic(), [0]

    def step(data):
        model.run(int((time.monotonic() - began) * 1e6))
        if data:
            model.receive(data)
        for at, slot, width in model.pulses[known[0] :]:
            told.rows.append((began + 1e-6 * at, slot, width / 16))
        known[0] = len(model.pulses)
        return model.take()

    return step


def maestro(told):
    """Return a function that takes bytes and gives bytes: a Maestro."""
    fake, known = Maestro(), [0]

    def step(data):
        if data:
            fake.write(data)
        for servo, value in fake.history[known[0] :]:
            told.note(servo, value)
        known[0] = len(fake.history)
        return fake.read()

    return step


def servo_bus(kind):
    """Return a function of what it was told that makes a bus of three servos, which takes bytes and gives bytes."""
    base = FeetechBus if kind == "feetech" else DynamixelBus

    def make(told):
        class Bus(base):
            def store(self, servo, address, data):
                super().store(servo, address, data)
                if address == self.goal_at and self.memory[servo][self.torque_at]:
                    told.note(servo, self.get(servo, self.goal_at))
                elif address == self.torque_at and not data[0]:
                    told.note(servo, 0)

            def answer(self, servo, kind, rest):
                if servo == BROADCAST and kind == _WRITE:
                    for each in self.memory:
                        self.store(each, rest[0], rest[1:])
                else:
                    yield from super().answer(servo, kind, rest)

        bus = Bus(range(1, 4), clock=WallClock())
        bus.in_parts = True

        def step(data):
            if data:
                bus.write(data)
            return bus.read()

        return step

    return make


def serve(kind):
    """Run a board until the standard input ends."""
    told = Told()
    step = {"arduino": arduino, "maestro": maestro}.get(kind, servo_bus(kind))(told)
    master, slave = os.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    print(os.ttyname(slave), flush=True)
    gone = False
    while True:
        ready = select.select([0] if gone else [0, master], [], [], 0.002)[0]
        if 0 in ready:
            word = os.read(0, 100)
            if not word:
                break
            gone = True  # "vanish"
            os.close(slave)
            os.close(master)
        data = b""
        with contextlib.suppress(OSError):
            data = b"" if gone else os.read(master, 4096)
        answer = step(data)
        with contextlib.suppress(OSError):
            if answer and not gone:
                os.write(master, answer)
    print(json.dumps(told.rows), flush=True)


class BoardProcess:
    """A board in a process of its own.

    Args:
        kind: Kind of board, as above.
    """

    def __init__(self, kind):
        command = [sys.executable, "-m", "tests.helpers.board_process", kind]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.kind, self.port = kind, self._process.stdout.readline().strip()
        assert self.port

    def vanish(self):
        """Close the port."""
        self._process.stdin.write("vanish\n")
        self._process.stdin.flush()

    def rows(self):
        """End the board; return what it was told: time [s], servo, value."""
        out, _ = self._process.communicate(timeout=20)
        return json.loads(out)


if __name__ == "__main__":
    serve(sys.argv[1])
