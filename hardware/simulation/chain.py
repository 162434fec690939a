"""The firmware's ``chain.c`` in Python, and modeled Meccano smart modules at its other end."""

from dataclasses import dataclass

from hardware.executor import Executor
from hardware.protocol import PLACES, SMART

EMPTY, CLAIMED, SERVO, OTHER = range(4)  # known of a place
REPORT_POSITION, REPORT_TYPE, NO_ID, LIGHTS_OFF = 0xFA, 0xFC, 0xFE, 0x00
IS_SERVO, IS_LIGHT = 0x01, 0x02
POSITION_LOW, POSITION_HIGH = 0x18, 0xE8
_MISSES = 3  # in a row


def check_byte(data: bytes, place: int) -> int:
    """Return the check byte of a packet.

    Args:
        data: The packet's four data bytes.
        place: Place of the module that must answer.
    """
    total = sum(data)
    total += total >> 8
    total += total << 4
    return total & 0xF0 | place


class Chain:
    """The board's end of a chain: knowledge of its modules, and the next packet.

    Args:
        executor: Source of goals, and receiver of positions.
        number: Number of the chain.
    """

    def __init__(self, executor: Executor, number: int) -> None:
        self._executor, self._first = executor, SMART + PLACES * number
        self._modules, self._misses, self._asked = [EMPTY] * PLACES, [0] * PLACES, 0
        self._driven, self._talks = False, [False] * PLACES

    def packet(self) -> bytes:
        """Return the next packet: FF, four data bytes, check byte."""
        self._asked = (self._asked + 1) % PLACES
        data = bytes(self._data(place) for place in range(PLACES))
        self._driven = self._modules[self._asked] == SERVO and data[self._asked] != REPORT_POSITION
        return b"\xff" + data + bytes((check_byte(data, self._asked),))

    def _data(self, place: int) -> int:
        kind = self._modules[place]
        if kind == SERVO:
            return self._executor.goal(self._first + place) or REPORT_POSITION
        return {EMPTY: NO_ID, CLAIMED: REPORT_TYPE, OTHER: LIGHTS_OFF}[kind]

    def answer(self, byte: int) -> None:
        """Take the answer to the last packet; 0 for silence."""
        place = self._asked
        kind = self._modules[place]
        if byte == 0:
            if self._driven and not self._talks[place]:
                return  # not every servo may answer while it is driven
            if kind != EMPTY:
                self._misses[place] += 1
                if self._misses[place] >= _MISSES:
                    self._lose(place)
            return
        self._misses[place] = 0
        if byte == NO_ID:
            if kind == SERVO:
                self._lose(place)
            if place == 0 or self._modules[place - 1] != EMPTY:
                self._modules[place] = CLAIMED
        elif kind == CLAIMED and byte in (IS_SERVO, IS_LIGHT):
            self._modules[place] = SERVO if byte == IS_SERVO else OTHER
        elif kind == SERVO and POSITION_LOW <= byte <= POSITION_HIGH:
            self._talks[place] |= self._driven
            self._executor.set_measured(self._first + place, byte)

    def _lose(self, first: int) -> None:
        """Forget a module that is gone, and those behind it."""
        for place in range(first, PLACES):
            if self._modules[place] == SERVO:
                self._executor.set_measured(self._first + place, 0)
            self._modules[place], self._misses[place], self._talks[place] = EMPTY, 0, False


@dataclass
class Module:
    """Modeled smart servo.

    Attributes:
        position: Present position, a raw value.
        hand: Raw value at which a hand holds it while limp; None for no hand.
        present: False once it is unplugged.
        claimed: True once it has taken its place on the chain.
        stuck: True if it does not move.
        mute: True if it answers only while limp.
        step: Greatest change of position per packet.
    """

    position: float = 128.0
    hand: int | None = None
    present: bool = True
    claimed: bool = False
    stuck: bool = False
    mute: bool = False
    step: float = 9.0


class Modules:
    """Up to four smart servos on a chain.

    Args:
        modules: Servos, the one nearest the board first.
    """

    def __init__(self, modules: list[Module]) -> None:
        self.modules = modules

    def unplug(self, place: int) -> None:
        """Unplug a module: it and those behind it stop answering and forget their places."""
        self.modules[place].present = False
        for module in self.modules[place:]:
            module.claimed = False

    def answer(self, packet: bytes) -> int:
        """Execute a packet and return the answer to it; 0 for silence."""
        asked = packet[5] & 3
        for place, module in enumerate(self.modules):
            if not (module.present and module.claimed):
                break  # those behind hear nothing yet
            self._move(module, packet[1 + place])
        reached = all(module.present and module.claimed for module in self.modules[:asked])
        module, data = self.modules[asked], packet[1 + asked]
        if not (reached and module.present):
            return 0
        if data == NO_ID:
            module.claimed = True
            return NO_ID
        if not module.claimed:
            return 0
        if data == REPORT_TYPE:
            return IS_SERVO
        return 0 if module.mute and data != REPORT_POSITION else int(module.position + 0.5)

    @staticmethod
    def _move(module: Module, data: int) -> None:
        """Follow a goal, or the hand while limp."""
        if data == REPORT_POSITION:
            if module.hand is not None:
                module.position = module.hand
        elif POSITION_LOW <= data <= POSITION_HIGH and not module.stuck:
            module.position += min(max(data - module.position, -module.step), module.step)
