"""The firmware's main loop and ``link.c`` in Python: frames in; answers, pulses and packets out, in its own time."""

import math
import struct
from collections.abc import Callable

import numpy as np

from hardware import protocol
from hardware.device import Fault
from hardware.executor import DETACHED, PACKET_US, PLAYING, POOL_BYTES, SLOT_US, Entry, Motion
from hardware.frames import Decoder, Frame, encode
from hardware.protocol import CHAINS, IDEAL, PLACES, PULSES, SMART, Message
from hardware.simulation.chain import Chain, Module, Modules
from hardware.simulation.servos import Pulse, Servos

PACKET_PERIOD_US = 45_312  # 66 bits of 416 us for the packet, 15360 us to listen, and six bits of rest
_RESET_CAUSE, _VCC_MV = 1, 5000
_FIXED: dict[int, int] = {
    Message.STOP: 0,
    Message.HOLD: 0,
    Message.RELEASE: 0,
    Message.COMMIT: 8,
    Message.ENABLE: 2,
    Message.LIM: 2,
    Message.START: 4,
}
MAX_PAYLOAD = 240  # ideal servos, any number of them, have longer messages than the firmware's


class BoardModel:
    """A board and its servos.

    Args:
        stand: Raw values the servos stand at, given their configuration; None for their safe values.
        stuck: Which servos do not move, by place in the configuration.
        keep_pulses: Whether to keep a list of all single pulses, for tests.
    """

    def __init__(
        self,
        stand: Callable[[int], list[float]] | None = None,
        stuck: Callable[[int], list[bool]] | None = None,
        keep_pulses: bool = False,
    ) -> None:
        self.now_us = 0
        self.log: list[Pulse] = []
        self.pulses: list[tuple[int, int, int]] = []
        self.packets: list[tuple[int, int, bytes]] = []
        self.modules = [Modules([Module() for _ in range(PLACES)]) for _ in range(CHAINS)]
        self._stand, self._stuck, self._keep = stand, stuck, keep_pulses
        self._servos: Servos | None = None
        self._boots = 0
        self.reset()

    def reset(self) -> None:
        """Starts the firmware anew, as a power failure or the watchdog does."""
        self._boots += 1
        self._began_us = self.now_us
        self.motion = Motion()
        self._chains = [Chain(self.motion, i) for i in range(CHAINS)]
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
        """Lets the board live until a time."""
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
        if slot == 0 and self.motion.configured:
            self._frame()
        self._slot = (slot + 1) % PULSES
        self._slot_us += SLOT_US
        self.motion.slot(self._slot, (self._slot_us - self._began_us) % 2**32)
        if self.motion.state == DETACHED:
            self._widths = [0] * PULSES
        else:
            self._widths[self._slot] = self.motion.pulse(self._slot)

    def _frame(self) -> None:
        """The servos' part of a frame of 20 ms."""
        motion = self.motion
        if self._servos is None:
            self._attach()
        servos = self._servos
        assert servos is not None
        if motion.state != DETACHED:
            servos.follow([command / 16 for command in motion.command])
        for j, joint in enumerate(motion.joints):
            if joint.channel >= IDEAL:
                motion.set_measured(joint.channel, max(1, round(servos.positions[j])))
            elif joint.channel >= SMART:
                servos.positions[j] = self._module(joint.channel).position
        if motion.state != DETACHED:
            commanded = np.array([(command + 8) >> 4 for command in motion.command])
            self.log.append(Pulse(self._time_us, commanded, np.array(servos.positions)))

    def _attach(self) -> None:
        """Puts the servos where they stand once it is known which there are."""
        joints = self.motion.joints
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
        """Takes the answers to the packets that have been out, and sends the next."""
        for chain, answer in zip(self._chains, self._answers, strict=True):
            chain.answer(answer)
        self.motion.packet()
        self._sent = [chain.packet() for chain in self._chains]
        self._heard_us = self._packet_us + PACKET_US
        self._packet_us += PACKET_PERIOD_US

    def _hear_packet(self) -> None:
        """The packets have reached their modules."""
        self._heard_us = math.inf
        self._answers = [0] * CHAINS
        for i in self._used:
            self._answers[i] = self.modules[i].answer(self._sent[i])
            self.packets.append((self.now_us, i, self._sent[i]))

    def _mind_bus(self) -> None:
        """Starts talking on the chains of a new configuration."""
        smart = [joint.channel - SMART for joint in self.motion.joints if SMART <= joint.channel < IDEAL]
        used = sorted({place // PLACES for place in smart}) if self.motion.configured else []
        if used != self._used:
            self._used, self._answers = used, [0] * CHAINS
            self._packet_us, self._heard_us = self.now_us if used else math.inf, math.inf

    # ---- messages ----

    def receive(self, data: bytes) -> None:
        """Takes bytes from the host, now."""
        for frame in self._decoder.feed(data):
            self.motion.heard_us = self._time_us
            self._handle(frame)
            self._mind_bus()

    def take(self) -> bytes:
        """Bytes for the host since the last call."""
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
            calibration = self.motion.calibration if self.motion.configured else 0
            hello = protocol.Hello(1, self._boots, _RESET_CAUSE, 14, POOL_BYTES, calibration)
            self._answer(Message.HELLO_REPLY, protocol.pack_hello(hello))
        elif frame.type == Message.PING and len(frame.payload) == 4:
            self._answer(Message.STATUS, self._status(frame.payload))
        elif frame.type < protocol.ANY_ORDER_BELOW or frame.type >= 0x80:
            return
        elif ahead > 0 and not fresh:
            self._answer(Message.NAK)
        else:
            code = self.motion.fault
            if fresh:
                self._expected = (frame.sequence + 1) % 256
                code = self._execute(frame.type, frame.payload)
            self._answer(Message.ACK, bytes((code.code,)))

    def _status(self, echo: bytes) -> bytes:
        motion = self.motion
        since = self._time_us - motion.start_us if motion.state == PLAYING else motion.time_us
        status = protocol.BoardStatus(
            echo=int.from_bytes(echo, "little"),
            time_us=self._time_us,
            motion_us=(since + 2**31) % 2**32 - 2**31,
            flags=motion.state | motion.done << 2 | motion.configured << 3 | motion.braking << 4,
            fault=motion.fault.code,
            fault_joint=motion.fault_joint,
            free=motion.depth - len(motion.queue) if motion.configured else 0,
            next_index=motion.next_index % 2**16,
            calibration=motion.calibration if motion.configured else 0,
            vcc_mv=_VCC_MV,
        )
        values = []
        joints = motion.joints if motion.configured else []
        for joint, command, measured in zip(joints, motion.command, motion.measured, strict=False):
            values += [(command + 8) >> 4, measured] if joint.channel >= SMART else [(command + 8) >> 4]
        return protocol.pack_status(status) + protocol.status_values([joint.channel for joint in joints]).pack(*values)

    def _execute(self, kind: int, payload: bytes) -> Fault:
        """A message whose turn it is; the fault it causes."""
        motion = self.motion
        values = protocol.value_format([joint.channel for joint in motion.joints] if motion.configured else [])
        size = struct.calcsize("<" + values)
        if kind == Message.CONFIG:
            right = len(payload) >= 2 + protocol.RECORD_BYTES and (len(payload) - 2) % protocol.RECORD_BYTES == 0
        elif kind == Message.WAYPOINTS:
            right = len(payload) > 3
        else:
            right = len(payload) == (size if kind == Message.SETPOINT else _FIXED.get(kind, -1))
        if not right:
            return motion.set_fault(Fault.LENGTH)
        match kind:
            case Message.STOP:
                motion.stop()
            case Message.HOLD:
                motion.hold()
            case Message.RELEASE:
                motion.release()
            case Message.CONFIG:
                return motion.config(payload[0], payload[1], payload[2:])
            case Message.COMMIT:
                return motion.commit(*struct.unpack("<HHHH", payload))
            case Message.ENABLE:
                return motion.enable(*struct.unpack("<H", payload))
            case Message.WAYPOINTS:
                if motion.fault is not Fault.NONE or motion.state == DETACHED:
                    return motion.waypoints(0, False, [])  # refused whatever it says
                if (len(payload) - 3) % (4 + size):
                    return motion.set_fault(Fault.LENGTH)
                entries = [Entry(row[0], row[1:]) for row in struct.iter_unpack("<I" + values, payload[3:])]
                return motion.waypoints(int.from_bytes(payload[:2], "little"), bool(payload[2]), entries)
            case Message.START:
                return motion.start(int.from_bytes(payload, "little"), self._time_us)
            case Message.SETPOINT:
                return motion.setpoint(struct.unpack("<" + values, payload))
            case Message.LIM:
                return motion.lim(*struct.unpack("<H", payload))
        return Fault.NONE
