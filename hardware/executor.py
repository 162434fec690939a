"""The firmware's ``motion.c`` in Python, number for number: configuration, queue, interpolation, braking.

Values are raw; commands are kept in sixteenths. Motion time runs with the board's clock, or slower while braking: the
arm then stays on its path and comes to rest on it.
"""

from typing import NamedTuple

from hardware.device import Fault
from hardware.frames import crc16
from hardware.protocol import IDEAL, MAX_GAP_US, PULSES, SMART, STOP_MARGIN_MS, Record, unpack_records

SLOT_US, FRAME_US, PACKET_US = 3333, 20_000, 27_456
BRAKE_SLOTS, BRAKE_US, MIN_GAP_US, MAX_LEAD_US, POOL_BYTES = 16, 28_000, 1000, 10_000_000, 768
DETACHED, HOLDING, PLAYING = range(3)
_MAX_JOINTS = 14


class Entry(NamedTuple):
    """A waypoint in the queue."""

    time: int
    values: tuple[int, ...]


class Motion:
    """What the servos are told."""

    def __init__(self) -> None:
        self.joints: list[Record] = []
        self.total = 0
        self.records_crc = self.calibration = 0
        self.stop_within_ms = self.release_after_ms = 0
        self.configured = False
        self.state, self.fault, self.fault_joint = DETACHED, Fault.NONE, 0
        self.done = self.braking = self.have_last = False
        self.pace, self.limp, self.depth = BRAKE_SLOTS, 0, 0
        self.heard_us = self.start_us = self.time_us = self.next_index = 0
        self.command: list[int] = []
        self.target: list[int] = []
        self.measured: list[int] = []
        self.last_pulse: dict[int, int] = {}
        self.queue: list[Entry] = []
        self.before = Entry(0, ())

    def set_fault(self, fault: Fault, joint: int = 0) -> Fault:
        """The first fault stays until the next configuration; the arm brakes."""
        if self.fault is Fault.NONE:
            self.fault, self.fault_joint = fault, joint
        self.hold()
        return fault

    def _rest(self) -> None:
        self.target = list(self.command)
        if self.state == PLAYING:
            self.state = HOLDING

    def _drop(self) -> None:
        self.queue.clear()
        self.next_index = self.time_us = 0
        self.have_last = self.braking = self.done = False
        self.pace = BRAKE_SLOTS

    def hold(self) -> None:
        """Brakes along the path."""
        if self.state != PLAYING:
            self._rest()
        elif self.time_us == 0:
            self.stop()
        else:
            self.braking = True

    def stop(self) -> None:
        """Freezes."""
        self._rest()
        self._drop()

    def release(self) -> None:
        """Stops driving."""
        self.stop()
        self.state, self.limp = DETACHED, 0

    def config(self, first: int, total: int, data: bytes) -> Fault:
        """Takes packed records, from the first on."""
        if self.state == PLAYING:
            return self.set_fault(Fault.STATE)
        if first == 0:
            self.release()
            self.configured = False
            self.joints, self.total = [], 0
            self.command, self.target, self.measured = [], [], []
            self.records_crc = 0xFFFF
        records = unpack_records(data)
        most = 60 if records and records[0].channel >= IDEAL else _MAX_JOINTS
        if first != len(self.joints) or not 0 < total <= most:
            return self.set_fault(Fault.CONFIG, first)
        self.records_crc = crc16(data, self.records_crc)
        for record in records:
            twice = any(joint.channel == record.channel for joint in self.joints)
            if len(self.joints) == total or twice or not _plausible(record):
                return self.set_fault(Fault.CONFIG, len(self.joints))
            self.joints.append(record)
        self.total = total
        return Fault.NONE

    def commit(self, calibration: int, records_crc: int, stop_within_ms: int, release_after_ms: int) -> Fault:
        """Makes the records the configuration, and clears a fault."""
        if self.state == PLAYING:
            return self.set_fault(Fault.STATE)
        complete = 0 < len(self.joints) == self.total
        fits = STOP_MARGIN_MS < stop_within_ms <= release_after_ms
        if not complete or records_crc != self.records_crc or not fits:
            return self.set_fault(Fault.CONFIG, len(self.joints) if complete else 0)
        self.release()
        self.calibration, self.stop_within_ms, self.release_after_ms = calibration, stop_within_ms, release_after_ms
        bytes_each = 4 + sum(1 if SMART <= joint.channel < IDEAL else 2 for joint in self.joints)
        self.depth = min(POOL_BYTES // bytes_each, 127) if self.joints[0].channel < IDEAL else 32
        self.fault, self.configured = Fault.NONE, True
        self.command = []
        for joint in self.joints:
            left = self.last_pulse.get(joint.channel, 0)
            self.command.append(left if joint.low * 16 <= left <= joint.high * 16 else joint.safe * 16)
        self.target = list(self.command)
        self.measured = [0] * len(self.joints)
        return Fault.NONE

    def enable(self, calibration: int) -> Fault:
        """Drives the servos where they are."""
        if not self.configured or calibration != self.calibration:
            return self.set_fault(Fault.CONFIG)
        if self.fault is not Fault.NONE:
            return self.fault
        if self.state != DETACHED:
            return Fault.NONE
        for j, joint in enumerate(self.joints):
            if joint.channel < SMART:
                continue
            if self.measured[j] == 0:
                return self.set_fault(Fault.SERVO, j)
            self.command[j] = self.measured[j] * 16
            self.target[j] = min(max(self.measured[j], joint.low), joint.high) * 16
        self.state = HOLDING
        return Fault.NONE

    def _check(self, entry: Entry, before: Entry) -> Fault:
        gap_us = entry.time - before.time
        for j, (joint, wanted, present) in enumerate(zip(self.joints, entry.values, before.values, strict=True)):
            if not joint.low <= wanted <= joint.high:
                return self.set_fault(Fault.RANGE, j)
            way = abs(wanted - present)
            if way > 1 and (way - 1) * FRAME_US > joint.step * (gap_us >> 4):
                return self.set_fault(Fault.RATE, j)
        return Fault.NONE

    def waypoints(self, first: int, last: bool, entries: list[Entry]) -> Fault:
        """Queues waypoints."""
        if self.fault is not Fault.NONE:
            return self.fault
        if self.state == DETACHED:
            return self.set_fault(Fault.STATE)
        if first != self.next_index or self.have_last or self.done:
            return self.set_fault(Fault.ORDER)
        if first == 0:
            self.before = Entry(0, tuple((command + 8) >> 4 for command in self.command))
        for entry in entries:
            before = self.queue[-1] if self.queue else self.before
            gap = (entry.time - before.time) % 2**32
            if self.time_us and _signed(entry.time - self.time_us) <= SLOT_US:
                return self.set_fault(Fault.LATE)
            if not (gap >= MIN_GAP_US or self.next_index == 0) or gap > MAX_GAP_US or len(self.queue) == self.depth:
                return self.set_fault(Fault.ORDER)
            fault = self._check(entry, before)
            if fault is not Fault.NONE:
                return fault
            self.queue.append(entry)
            self.next_index += 1
        self.have_last = last
        return Fault.NONE

    def start(self, start_us: int, now_us: int) -> Fault:
        """Starts the queued motion at a time."""
        if self.fault is not Fault.NONE:
            return self.fault
        if self.state != HOLDING or not self.queue:
            return self.set_fault(Fault.STATE)
        if (start_us - now_us) % 2**32 > MAX_LEAD_US:
            return self.set_fault(Fault.LATE)
        self.start_us, self.time_us, self.state = start_us, 0, PLAYING
        return Fault.NONE

    def setpoint(self, values: tuple[int, ...]) -> Fault:
        """Goes to a posture as fast as the rates allow."""
        if self.fault is not Fault.NONE:
            return self.fault
        if self.state != HOLDING:
            return self.set_fault(Fault.STATE)
        for j, (joint, wanted) in enumerate(zip(self.joints, values, strict=True)):
            if not joint.low <= wanted <= joint.high:
                return self.set_fault(Fault.RANGE, j)
        self.target = [wanted * 16 for wanted in values]
        return Fault.NONE

    def lim(self, mask: int) -> Fault:
        """Lets some smart servos go limp."""
        if self.state == PLAYING:
            return self.set_fault(Fault.STATE)
        self.limp = mask
        return Fault.NONE

    def at_time(self, j: int, time: int) -> int:
        """A joint's command at a motion time, in sixteenths."""
        before = self.before
        for entry in self.queue:
            if time < entry.time:
                part, whole = (time - before.time) >> 4, (entry.time - before.time) >> 4
                if part == whole:
                    return entry.values[j] * 16
                share = (part << 16) // whole
                start = before.values[j]
                return start * 16 + ((entry.values[j] - start) * share >> 12)
            before = entry
        return before.values[j] * 16

    def _advance(self, slot_us: int) -> None:
        if _signed(slot_us - self.start_us) < 0:
            return
        if not self.braking:
            self.time_us = (slot_us - self.start_us) % 2**32
        else:
            self.pace -= 1
            if self.pace == 0:
                self.stop()
                return
            self.time_us += SLOT_US * self.pace // BRAKE_SLOTS
        while self.queue and self.queue[0].time <= self.time_us:
            self.before = self.queue.pop(0)
        if self.have_last:
            if not self.queue:
                self.target = [value * 16 for value in self.before.values]
                self.state, self.done = HOLDING, True
        elif not self.queue or self.queue[-1].time - self.time_us < BRAKE_US:
            self.set_fault(Fault.UNDERRUN)

    def _mind_silence(self, now_us: int) -> None:
        silent_us = _signed(now_us - self.heard_us)
        silent_ms = silent_us // 1000 if silent_us >= 0 else -(-silent_us // 1000)
        if silent_ms > self.stop_within_ms - STOP_MARGIN_MS:
            if self.state == PLAYING:
                self.set_fault(Fault.SILENCE)
            else:
                self._rest()
        if silent_ms > self.release_after_ms:
            self.release()

    def slot(self, slot: int, slot_us: int) -> None:
        """Moves on to a slot, and commands its pulse output; ideal servos have theirs with the first."""
        if self.state == DETACHED:
            return
        self._mind_silence(slot_us)
        if self.state == PLAYING:
            self._advance(slot_us)
        if self.state == DETACHED:
            return
        for j, joint in enumerate(self.joints):
            ideal = joint.channel >= IDEAL and slot == 0
            if not ideal and joint.channel != slot:
                continue
            if self.state != PLAYING:
                self.command[j] = _towards(self.command[j], self.target[j], joint.step)
            elif self.time_us:
                self.command[j] = self.target[j] = self.at_time(j, self.time_us)
            if not ideal:
                self.last_pulse[slot] = self.command[j]

    def packet(self) -> None:
        """Commands the smart servos for a packet that leaves now."""
        ahead = self.time_us + PACKET_US // BRAKE_SLOTS * self.pace
        for j, joint in enumerate(self.joints):
            if not SMART <= joint.channel < IDEAL or self.state == DETACHED or self.limp >> j & 1:
                continue
            if self.state != PLAYING:
                self.command[j] = _towards(self.command[j], self.target[j], joint.step * 2)
            elif self.time_us:
                self.command[j] = self.target[j] = self.at_time(j, ahead)

    def joint_at(self, channel: int) -> int | None:
        """Which joint a channel drives."""
        return next((j for j, joint in enumerate(self.joints) if joint.channel == channel), None)

    def pulse(self, slot: int) -> int:
        """Width of a pulse in sixteenths of a microsecond; 0 for none."""
        j = self.joint_at(slot) if slot < PULSES and self.state != DETACHED else None
        return 0 if j is None else self.command[j]

    def goal(self, channel: int) -> int:
        """Goal of a smart servo; 0 if it shall be limp."""
        j = self.joint_at(channel)
        return 0 if j is None or self.state == DETACHED or self.limp >> j & 1 else (self.command[j] + 8) >> 4

    def set_measured(self, channel: int, position: int) -> None:
        """What a servo says; 0 for a servo that is gone."""
        j = self.joint_at(channel)
        if j is None:
            return
        self.measured[j] = position
        if position == 0 and self.state != DETACHED:
            self.set_fault(Fault.SERVO, j)
        elif self.limp >> j & 1:
            self.command[j] = self.target[j] = position * 16


def _plausible(record: Record) -> bool:
    lowest, highest = (0, 0xFFFF) if record.channel >= IDEAL else (24, 232) if record.channel >= SMART else (400, 2600)
    there = record.channel < PULSES or SMART <= record.channel < SMART + 8 or record.channel >= IDEAL
    ordered = lowest <= record.low < record.high <= highest and record.low <= record.safe <= record.high
    return there and ordered and record.step > 0


def _towards(start: int, goal: int, step: int) -> int:
    return min(start + step, goal) if goal > start else max(start - step, goal)


def _signed(x: int) -> int:
    """A 32-bit difference of times, as the board computes it."""
    return (x + 2**31) % 2**32 - 2**31
