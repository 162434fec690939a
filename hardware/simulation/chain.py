"""The firmware's ``chain.c`` in Python, and modelled Meccano smart modules to talk to."""

from dataclasses import dataclass

from hardware.executor import Motion
from hardware.protocol import PLACES, SMART

EMPTY, CLAIMED, SERVO, OTHER = range(4)
REPORT_POSITION, REPORT_TYPE, NOBODY, LIGHTS_OFF = 0xFA, 0xFC, 0xFE, 0x00
IS_SERVO, IS_LIGHT = 0x01, 0x02
POSITION_LOW, POSITION_HIGH = 0x18, 0xE8
_MISSES = 3


def check_byte(data: bytes, place: int) -> int:
    """Check byte of a packet's four data bytes, with the place that must answer."""
    total = sum(data)
    total += total >> 8
    total += total << 4
    return total & 0xF0 | place


class Chain:
    """What the controller knows of a chain and asks it next."""

    def __init__(self, motion: Motion, number: int) -> None:
        self._motion, self._first = motion, SMART + PLACES * number
        self._modules, self._misses, self._asked = [EMPTY] * PLACES, [0] * PLACES, 0
        self._driven, self._talks = False, [False] * PLACES

    def packet(self) -> bytes:
        """The next packet: FF, four data bytes, check byte."""
        self._asked = (self._asked + 1) % PLACES
        data = bytes(self._data(place) for place in range(PLACES))
        self._driven = self._modules[self._asked] == SERVO and data[self._asked] != REPORT_POSITION
        return b"\xff" + data + bytes((check_byte(data, self._asked),))

    def _data(self, place: int) -> int:
        kind = self._modules[place]
        if kind == SERVO:
            return self._motion.goal(self._first + place) or REPORT_POSITION
        return {EMPTY: NOBODY, CLAIMED: REPORT_TYPE, OTHER: LIGHTS_OFF}[kind]

    def answer(self, byte: int) -> None:
        """Takes the answer; 0 for silence."""
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
        if byte == NOBODY:
            if kind == SERVO:
                self._lose(place)
            if place == 0 or self._modules[place - 1] != EMPTY:
                self._modules[place] = CLAIMED
        elif kind == CLAIMED and byte in (IS_SERVO, IS_LIGHT):
            self._modules[place] = SERVO if byte == IS_SERVO else OTHER
        elif kind == SERVO and POSITION_LOW <= byte <= POSITION_HIGH:
            self._talks[place] |= self._driven
            self._motion.set_measured(self._first + place, byte)

    def _lose(self, first: int) -> None:
        """A module that is gone takes those behind it along."""
        for place in range(first, PLACES):
            if self._modules[place] == SERVO:
                self._motion.set_measured(self._first + place, 0)
            self._modules[place], self._misses[place], self._talks[place] = EMPTY, 0, False


@dataclass
class Module:
    """A smart servo: where it is and a hand holds it while limp, whether it answers only then, its way per packet."""

    position: float = 128.0
    hand: int | None = None
    present: bool = True
    claimed: bool = False
    stuck: bool = False
    mute: bool = False
    step: float = 9.0


class Modules:
    """Up to four smart servos in a row, as they answer."""

    def __init__(self, modules: list[Module]) -> None:
        self.modules = modules

    def unplug(self, place: int) -> None:
        """From this place on nobody answers any more, and everybody forgets its place."""
        self.modules[place].present = False
        for module in self.modules[place:]:
            module.claimed = False

    def answer(self, packet: bytes) -> int:
        """What comes back to a packet; 0 for silence."""
        asked = packet[5] & 3
        for place, module in enumerate(self.modules):
            if not (module.present and module.claimed):
                break  # those behind hear nothing yet
            self._move(module, packet[1 + place])
        ahead = all(module.present and module.claimed for module in self.modules[:asked])
        module, data = self.modules[asked], packet[1 + asked]
        if not (ahead and module.present):
            return 0
        if data == NOBODY:
            module.claimed = True
            return NOBODY
        if not module.claimed:
            return 0
        if data == REPORT_TYPE:
            return IS_SERVO
        return 0 if module.mute and data != REPORT_POSITION else int(module.position + 0.5)

    @staticmethod
    def _move(module: Module, data: int) -> None:
        """Follows a goal, or the hand while limp."""
        if data == REPORT_POSITION:
            if module.hand is not None:
                module.position = module.hand
        elif POSITION_LOW <= data <= POSITION_HIGH and not module.stuck:
            module.position += min(max(data - module.position, -module.step), module.step)
