"""The firmware's main loop and ``link.c`` in Python: frames in; answers, pulses and packets out, in board time."""

import math
import struct
from collections import deque
from collections.abc import Callable

import numpy as np

from hardware import protocol
from hardware.board import Fault, State
from hardware.executor import MAX_JOINTS, PACKET_US, POOL_BYTES, SLOT_US, Executor
from hardware.frames import Decoder, Frame, encode
from hardware.protocol import CHAINS, IDEAL, PLACES, PULSES, SMART, Message
from hardware.simulation.chain import Chain, Module, Modules
from hardware.simulation.servos import ServoFrame, Servos
from hardware.waypoint_queue import Entry, signed_us

PACKET_PERIOD_US = 45_312  # 66 bits of 416 us for the packet, 15360 us to listen, and six bits of rest
_FIRMWARE, _RESET_CAUSE, _VCC_MV = 2, 1, 5000
_LOG_FRAMES = 30_000
_PAYLOAD_BYTES: dict[int, int] = {
    Message.STOP: 0,
    Message.HOLD: 0,
    Message.RELEASE: 0,
    Message.CLEAR: 0,
    Message.COMMIT: 8,
    Message.ENABLE: 2,
    Message.LIMP: 2,
    Message.START: 4,
}
MAX_PAYLOAD = 240  # ideal servos, any number of them, have longer messages than the firmware's


class BoardModel:
    """A board and its servos; a :class:`hardware.transport.Peer`.

    Args:
        stand: Function of the number of servos that returns the raw values they stand at; None for their safe values.
        stuck: Function of the number of servos that returns True for each that does not move; None for no such servo.
        keep_pulses: True to keep lists of all single pulses and packets, for tests.

    Attributes:
        now_us: Time since power came on [µs].
        executor: Execution of the motion.
        modules: Smart servos per chain.
        log: Latest servo frames, of ten minutes at most: memory stays constant however long the board runs.
        pulses: Start [µs], output and width in sixteenths of a microsecond of every pulse, if kept.
        packets: Time [µs], chain and bytes of every packet, if kept.
    """

    def __init__(
        self,
        stand: Callable[[int], list[float]] | None = None,
        stuck: Callable[[int], list[bool]] | None = None,
        keep_pulses: bool = False,
    ) -> None:
        self.now_us = 0
        self.log: deque[ServoFrame] = deque(maxlen=_LOG_FRAMES)
        self.pulses: list[tuple[int, int, int]] = []
        self.packets: list[tuple[int, int, bytes]] = []
        self.modules = [Modules([Module() for _ in range(PLACES)]) for _ in range(CHAINS)]
        self._stand, self._stuck, self._keep = stand, stuck, keep_pulses
        self._servos: Servos | None = None
        self._boots = 0
        self.reset()

    def reset(self) -> None:
        """Restart the firmware, as a power failure or the watchdog does."""
        self._boots += 1
        self._began_us = self.now_us
        self.executor = Executor()
        self._chains = [Chain(self.executor, i) for i in range(CHAINS)]
        self._decoder = Decoder(MAX_PAYLOAD)
        self._expected = 0
        self._out = bytearray()
        self._widths = [0] * PULSES
        self._slot, self._slot_us = 0, self.now_us + SLOT_US
        self._packet_us = self._heard_us = math.inf
        self._used: list[int] = []
        self._sent: list[bytes] = []
        self._answers = [0] * CHAINS

    # ---- time ----

    def run(self, until_us: int) -> None:
        """Advance to a time [µs]."""
        while (due := min(self._slot_us, self._packet_us, self._heard_us)) <= until_us:
            self.now_us = int(due)
            if due == self._packet_us:
                self._next_packet()
            elif due == self._heard_us:
                self._hear_packet()
            else:
                self._next_slot()
        self.now_us = max(self.now_us, until_us)

    @property
    def _time_us(self) -> int:
        """The board's own clock."""
        return (self.now_us - self._began_us) % 2**32

    def _next_slot(self) -> None:
        slot = self._slot
        if self._keep and self._widths[slot]:
            self.pulses.append((self._slot_us, slot, self._widths[slot]))
        if slot == 0 and self.executor.configured:
            self._frame()
        self._slot = (slot + 1) % PULSES
        self._slot_us += SLOT_US
        self.executor.slot(self._slot, (self._slot_us - self._began_us) % 2**32)
        if self.executor.state is State.DETACHED:
            self._widths = [0] * PULSES
        else:
            self._widths[self._slot] = self.executor.pulse(self._slot)

    def _frame(self) -> None:
        """Move the servos for one frame of 20 ms, and log it."""
        executor = self.executor
        if self._servos is None:
            self._attach()
        servos = self._servos
        assert servos is not None
        if executor.state is not State.DETACHED:
            servos.follow([command / 16 for command in executor.command])
        for j, joint in enumerate(executor.joints):
            if joint.channel >= IDEAL:
                executor.set_measured(joint.channel, max(1, round(servos.positions[j])))
            elif joint.channel >= SMART:
                servos.positions[j] = self._module(joint.channel).position
        if executor.state is not State.DETACHED:
            commanded = np.array([(command + 8) >> 4 for command in executor.command])
            self.log.append(ServoFrame(self._time_us, commanded, np.array(servos.positions)))

    def _attach(self) -> None:
        """Make the servos once the configuration says which there are."""
        joints = self.executor.joints
        stand = self._stand(len(joints)) if self._stand else [joint.safe for joint in joints]
        stuck = self._stuck(len(joints)) if self._stuck else [False] * len(joints)
        self._servos = Servos(stand, [joint.step / 16 for joint in joints], stuck)
        for j, joint in enumerate(joints):
            if SMART <= joint.channel < IDEAL:
                module = self._module(joint.channel)
                module.position, module.stuck = stand[j], stuck[j]

    def _module(self, channel: int) -> Module:
        return self.modules[(channel - SMART) // PLACES].modules[(channel - SMART) % PLACES]

    def _next_packet(self) -> None:
        """Take the answers to the packets that have been out, and send the next ones."""
        for chain, answer in zip(self._chains, self._answers, strict=True):
            chain.answer(answer)
        self.executor.packet()
        self._sent = [chain.packet() for chain in self._chains]
        self._heard_us = self._packet_us + PACKET_US
        self._packet_us += PACKET_PERIOD_US

    def _hear_packet(self) -> None:
        """Let the modules execute the packets that have arrived."""
        self._heard_us = math.inf
        self._answers = [0] * CHAINS
        for i in self._used:
            self._answers[i] = self.modules[i].answer(self._sent[i])
            if self._keep:
                self.packets.append((self.now_us, i, self._sent[i]))

    def _use_chains(self) -> None:
        """Start talking on the chains that a new configuration names."""
        executor = self.executor
        smart = [joint.channel - SMART for joint in executor.joints if SMART <= joint.channel < IDEAL]
        used = sorted({place // PLACES for place in smart}) if executor.configured else []
        if used != self._used:
            self._used, self._answers = used, [0] * CHAINS
            self._packet_us, self._heard_us = self.now_us if used else math.inf, math.inf

    # ---- messages ----

    def receive(self, data: bytes) -> None:
        """Take bytes from the host, now."""
        for frame in self._decoder.feed(data):
            self.executor.heard_us = self._time_us
            self._handle(frame)
            self._use_chains()

    def take(self) -> bytes:
        """Return the bytes sent to the host since the last call."""
        data = bytes(self._out)
        self._out.clear()
        return data

    def _answer(self, kind: Message, payload: bytes = b"") -> None:
        self._out += encode(Frame(self._expected, kind, payload))

    def _handle(self, frame: Frame) -> None:
        ahead = (frame.sequence - self._expected + 128) % 256 - 128
        fresh = ahead >= 0 if frame.type < protocol.IN_SEQUENCE_FROM else ahead == 0
        if frame.type == Message.HELLO and not frame.payload:
            self._expected = (frame.sequence + 1) % 256
            calibration = self.executor.calibration if self.executor.configured else 0
            hello = protocol.Hello(_FIRMWARE, self._boots, _RESET_CAUSE, MAX_JOINTS, POOL_BYTES, calibration)
            self._answer(Message.HELLO_REPLY, protocol.pack_hello(hello))
        elif frame.type == Message.PING and len(frame.payload) == 4:
            self._answer(Message.STATUS, self._status(frame.payload))
        elif frame.type < protocol.ANY_ORDER_BELOW or frame.type >= 0x80:
            return
        elif ahead > 0 and not fresh:
            self._answer(Message.NAK)
        else:
            fault = self.executor.fault
            if fresh:
                self._expected = (frame.sequence + 1) % 256
                fault = self._execute(frame.type, frame.payload)
            self._answer(Message.ACK, bytes((fault,)))

    def _status(self, echo: bytes) -> bytes:
        executor = self.executor
        playing = executor.state is State.PLAYING
        since = self._time_us - executor.start_us if playing else executor.time_us
        status = protocol.StatusHeader(
            echo=int.from_bytes(echo, "little"),
            time_us=self._time_us,
            motion_us=signed_us(since),
            flags=executor.state | executor.done << 2 | executor.configured << 3 | executor.braking << 4,
            fault=executor.fault,
            fault_joint=executor.fault_joint,
            free=executor.depth - len(executor.queue) if executor.configured else 0,
            next_index=executor.next_index,
            calibration=executor.calibration if executor.configured else 0,
            vcc_mv=_VCC_MV,
        )
        values = []
        joints = executor.joints if executor.configured else []
        for joint, command, measured in zip(joints, executor.command, executor.measured, strict=False):
            values += [(command + 8) >> 4, measured] if joint.channel >= SMART else [(command + 8) >> 4]
        return protocol.pack_status(status) + protocol.status_values([joint.channel for joint in joints]).pack(*values)

    def _execute(self, kind: int, payload: bytes) -> Fault:
        """Execute a message whose turn it is, and return the fault it causes."""
        executor = self.executor
        values = protocol.value_format([joint.channel for joint in executor.joints] if executor.configured else [])
        size = struct.calcsize("<" + values)
        if kind == Message.CONFIG:
            right = len(payload) >= 2 + protocol.RECORD_BYTES and (len(payload) - 2) % protocol.RECORD_BYTES == 0
        elif kind == Message.WAYPOINTS:
            right = len(payload) > 3
        else:
            right = len(payload) == (size if kind == Message.SETPOINT else _PAYLOAD_BYTES.get(kind, -1))
        if not right:
            return executor.set_fault(Fault.LENGTH)
        match kind:
            case Message.STOP:
                executor.stop()
            case Message.HOLD:
                executor.hold()
            case Message.RELEASE:
                executor.release()
            case Message.CONFIG:
                return executor.config(payload[0], payload[1], payload[2:])
            case Message.COMMIT:
                return executor.commit(*struct.unpack("<HHHH", payload))
            case Message.ENABLE:
                return executor.enable(*struct.unpack("<H", payload))
            case Message.WAYPOINTS:
                if executor.fault is not Fault.NONE or executor.state is State.DETACHED:
                    return executor.waypoints(0, False, [])  # refused whatever it says
                if (len(payload) - 3) % (4 + size):
                    return executor.set_fault(Fault.LENGTH)
                entries = [Entry(row[0], row[1:]) for row in struct.iter_unpack("<I" + values, payload[3:])]
                return executor.waypoints(int.from_bytes(payload[:2], "little"), bool(payload[2]), entries)
            case Message.START:
                return executor.start(int.from_bytes(payload, "little"), self._time_us)
            case Message.SETPOINT:
                return executor.setpoint(struct.unpack("<" + values, payload))
            case Message.LIMP:
                return executor.set_limp(*struct.unpack("<H", payload))
            case Message.CLEAR:
                executor.clear()
        return Fault.NONE
