"""The firmware's ``motion.c`` in Python, number for number: configuration, queue, interpolation, braking.

The host runs it for boards that have no clock of their own, and the simulated board runs it in place of the firmware.
Values are raw; commands are in sixteenths of a raw step. Motion time runs with the board's clock, or slower while
braking: the arm then stays on its path and comes to rest on it. Times and waypoint indices wrap; only their differences
are compared, so that a motion may last for days.
"""

from hardware.board import Fault, State
from hardware.frames import crc16
from hardware.protocol import (
    CHAINS,
    FRAME_US,
    IDEAL,
    MAX_GAP_US,
    PLACES,
    PULSES,
    SMART,
    STOP_MARGIN_MS,
    Record,
    unpack_records,
)
from hardware.waypoint_queue import TIMES, Entry, WaypointQueue, signed_us

SLOT_US, PACKET_US = 3333, 27_456
BRAKE_SLOTS, BRAKE_US, MIN_GAP_US, MAX_LEAD_US, POOL_BYTES = 16, 28_000, 1000, 10_000_000, 768
MAX_JOINTS = PULSES + CHAINS * PLACES
INDICES = 2**16  # of waypoints
_MAX_IDEAL_JOINTS, _IDEAL_DEPTH = 60, 32


class Executor:
    """Execution of a motion: turns messages and the passing of time into servo commands.

    Attributes:
        joints: Configured joints.
        configured: True while a committed configuration is held.
        calibration: CRC of the calibration.
        state: Present activity.
        fault: First fault since the configuration.
        fault_joint: Place of the joint that the fault is about.
        done: True once the last waypoint has been reached.
        braking: True while braking along the path.
        depth: Places in the waypoint queue.
        limp: Bit mask of limp joints.
        heard_us: Board time of the last message [µs].
        start_us: Board time of the motion's zero [µs].
        time_us: Motion time [µs].
        next_index: Index of the waypoint expected next.
        queue: Waypoints ahead.
        command: Command per joint, in sixteenths.
        target: Value per joint that commands approach while no motion plays, in sixteenths.
        measured: Reported raw value per joint; 0 if unknown.
    """

    def __init__(self) -> None:
        self.joints: list[Record] = []
        self.configured = False
        self.calibration = 0
        self.state, self.fault, self.fault_joint = State.DETACHED, Fault.NONE, 0
        self.done = self.braking = False
        self.limp = self.depth = 0
        self.heard_us = self.start_us = self.time_us = self.next_index = 0
        self.queue = WaypointQueue()
        self.command: list[int] = []
        self.target: list[int] = []
        self.measured: list[int] = []
        self._total = self._records_crc = 0
        self._stop_within_ms = self._release_after_ms = 0
        self._have_last = False
        self._pace = BRAKE_SLOTS  # full speed
        self._last_pulse: dict[int, int] = {}  # last command per pulse output: a servo without read-back is there

    # ---- messages; each returns a fault, and one other than NONE has become the board's ----

    def config(self, first: int, total: int, data: bytes) -> Fault:
        """Take packed records of joints.

        Args:
            first: Place of the first of them; 0 begins a new configuration.
            total: Number of joints in the configuration.
            data: Packed records.
        """
        if self.state is State.PLAYING:
            return self.set_fault(Fault.STATE)
        if first == 0:
            self.release()
            self.configured = False
            self.joints, self._total = [], 0
            self.command, self.target, self.measured = [], [], []
            self._records_crc = 0xFFFF
        records = unpack_records(data)
        most = _MAX_IDEAL_JOINTS if records and records[0].channel >= IDEAL else MAX_JOINTS
        if first != len(self.joints) or not 0 < total <= most:
            return self.set_fault(Fault.CONFIG, first)
        self._records_crc = crc16(data, self._records_crc)
        for record in records:
            repeated = any(joint.channel == record.channel for joint in self.joints)
            if len(self.joints) == total or repeated or not record.plausible:
                return self.set_fault(Fault.CONFIG, len(self.joints))
            self.joints.append(record)
        self._total = total
        return Fault.NONE

    def commit(self, calibration: int, records_crc: int, stop_within_ms: int, release_after_ms: int) -> Fault:
        """Make the records the configuration, and clear a fault; see :func:`hardware.protocol.commit_payload`."""
        if self.state is State.PLAYING:
            return self.set_fault(Fault.STATE)
        complete = 0 < len(self.joints) == self._total
        ordered = STOP_MARGIN_MS < stop_within_ms <= release_after_ms
        if not complete or records_crc != self._records_crc or not ordered:
            return self.set_fault(Fault.CONFIG, len(self.joints) if complete else 0)
        self.release()
        self.calibration, self._stop_within_ms, self._release_after_ms = calibration, stop_within_ms, release_after_ms
        entry_bytes = 4 + sum(1 if SMART <= joint.channel < IDEAL else 2 for joint in self.joints)
        self.depth = min(POOL_BYTES // entry_bytes, 127) if self.joints[0].channel < IDEAL else _IDEAL_DEPTH
        self.fault, self.configured = Fault.NONE, True
        self.command = []
        for joint in self.joints:
            last = self._last_pulse.get(joint.channel, 0)
            self.command.append(last if joint.low * 16 <= last <= joint.high * 16 else joint.safe * 16)
        self.target = list(self.command)
        self.measured = [0] * len(self.joints)
        return Fault.NONE

    def enable(self, calibration: int) -> Fault:
        """Drive the servos where they are, if this is the calibration that is held."""
        if not self.configured or calibration != self.calibration:
            return self.set_fault(Fault.CONFIG)
        if self.fault is not Fault.NONE:
            return self.fault
        if self.state is not State.DETACHED:
            return Fault.NONE
        for j, joint in enumerate(self.joints):
            if joint.channel < SMART:
                continue
            if self.measured[j] == 0:
                return self.set_fault(Fault.SERVO, j)
            self.command[j] = self.measured[j] * 16
            self.target[j] = min(max(self.measured[j], joint.low), joint.high) * 16
        self.state = State.HOLDING
        return Fault.NONE

    def waypoints(self, first: int, last: bool, entries: list[Entry]) -> Fault:
        """Queue waypoints.

        Args:
            first: Index of the first of them.
            last: True if the motion ends with them.
            entries: Waypoints in order.
        """
        if self.fault is not Fault.NONE:
            return self.fault
        if self.state is State.DETACHED:
            return self.set_fault(Fault.STATE)
        if first % INDICES != self.next_index or self._have_last or self.done:
            return self.set_fault(Fault.ORDER)
        begins = self.next_index == 0 and not self.queue  # the index wraps in mid-motion, when waypoints are queued
        if begins:
            self.queue.begin([(command + 8) >> 4 for command in self.command])
        for entry in entries:
            before = self.queue.newest
            gap = (entry.time - before.time) % TIMES
            if self.time_us and signed_us(entry.time - self.time_us) <= SLOT_US:
                return self.set_fault(Fault.LATE)
            if not (gap >= MIN_GAP_US or begins) or gap > MAX_GAP_US or len(self.queue) == self.depth:
                return self.set_fault(Fault.ORDER)
            begins = False
            fault = self._check(entry, before, gap)
            if fault is not Fault.NONE:
                return fault
            self.queue.append(Entry(entry.time % TIMES, entry.values))
            self.next_index = (self.next_index + 1) % INDICES
        self._have_last = last
        return Fault.NONE

    def _check(self, entry: Entry, before: Entry, gap_us: int) -> Fault:
        """Check a waypoint against ranges, and against rates from the one before."""
        for j, (joint, wanted, present) in enumerate(zip(self.joints, entry.values, before.values, strict=True)):
            if not joint.low <= wanted <= joint.high:
                return self.set_fault(Fault.RANGE, j)
            distance = abs(wanted - present)
            if distance > 1 and (distance - 1) * FRAME_US > joint.step * (gap_us >> 4):
                return self.set_fault(Fault.RATE, j)
        return Fault.NONE

    def start(self, start_us: int, now_us: int) -> Fault:
        """Start the queued motion.

        Args:
            start_us: Board time of the motion's zero [µs].
            now_us: Present board time [µs].
        """
        if self.fault is not Fault.NONE:
            return self.fault
        if self.state is not State.HOLDING or not self.queue:
            return self.set_fault(Fault.STATE)
        if (start_us - now_us) % TIMES > MAX_LEAD_US:
            return self.set_fault(Fault.LATE)
        self.start_us, self.time_us, self.state = start_us, 0, State.PLAYING
        return Fault.NONE

    def setpoint(self, values: tuple[int, ...]) -> Fault:
        """Go to a posture, in raw values, as fast as the rates allow."""
        if self.fault is not Fault.NONE:
            return self.fault
        if self.state is not State.HOLDING:
            return self.set_fault(Fault.STATE)
        for j, (joint, wanted) in enumerate(zip(self.joints, values, strict=True)):
            if not joint.low <= wanted <= joint.high:
                return self.set_fault(Fault.RANGE, j)
        self.target = [wanted * 16 for wanted in values]
        return Fault.NONE

    def set_limp(self, mask: int) -> Fault:
        """Let the joints of a bit mask go limp, and all others hold."""
        if self.state is State.PLAYING:
            return self.set_fault(Fault.STATE)
        self.limp = mask
        return Fault.NONE

    def hold(self) -> None:
        """Brake along the path."""
        if self.state is not State.PLAYING:
            self._rest()
        elif self.time_us == 0:
            self.stop()
        else:
            self.braking = True

    def stop(self) -> None:
        """Stop at once and drop the queue."""
        self._rest()
        self.queue.clear()
        self.next_index = self.time_us = 0
        self._have_last = self.braking = self.done = False
        self._pace = BRAKE_SLOTS

    def clear(self) -> None:
        """Stop, and forget a fault without releasing the servos."""
        self.stop()
        self.fault = Fault.NONE

    def release(self) -> None:
        """Stop driving the servos."""
        self.stop()
        self.state, self.limp = State.DETACHED, 0

    def set_fault(self, fault: Fault, joint: int = 0) -> Fault:
        """Record a fault and brake; the first one stays until the next configuration.

        Args:
            fault: The fault.
            joint: Place of the joint that it is about.

        Returns:
            The fault.
        """
        if self.fault is Fault.NONE:
            self.fault, self.fault_joint = fault, joint
        self.hold()
        return fault

    def _rest(self) -> None:
        self.target = list(self.command)
        if self.state is State.PLAYING:
            self.state = State.HOLDING

    # ---- time ----

    def _advance(self, slot_us: int) -> None:
        """Advance motion time to a slot, and end the motion that is over."""
        if self.time_us == 0 and signed_us(slot_us - self.start_us) < 0:
            return
        if not self.braking:
            self.time_us = (slot_us - self.start_us) % TIMES
        else:
            self._pace -= 1
            if self._pace == 0:
                self.stop()
                return
            self.time_us = (self.time_us + SLOT_US * self._pace // BRAKE_SLOTS) % TIMES
        self.queue.advance(self.time_us)
        if self._have_last:
            if not self.queue:
                self.target = [value * 16 for value in self.queue.passed.values]
                self.state, self.done = State.HOLDING, True
        elif not self.queue or (self.queue.newest.time - self.time_us) % TIMES < BRAKE_US:
            self.set_fault(Fault.UNDERRUN)

    def _check_silence(self, now_us: int) -> None:
        """Stop, and later release, when the host has been silent for too long."""
        silent_us = signed_us(now_us - self.heard_us)
        silent_ms = silent_us // 1000 if silent_us >= 0 else -(-silent_us // 1000)
        if silent_ms > self._stop_within_ms - STOP_MARGIN_MS:
            if self.state is State.PLAYING:
                self.set_fault(Fault.SILENCE)
            else:
                self._rest()
        if silent_ms > self._release_after_ms:
            self.release()

    def slot(self, slot: int, slot_us: int) -> None:
        """Advance to a slot and command its pulse output; ideal servos are all commanded in slot 0.

        Args:
            slot: Number of the pulse output.
            slot_us: Board time at which the slot starts [µs].
        """
        if self.state is State.DETACHED:
            return
        self._check_silence(slot_us)
        if self.state is State.PLAYING:
            self._advance(slot_us)
        if self.state is State.DETACHED:
            return
        for j, joint in enumerate(self.joints):
            ideal = joint.channel >= IDEAL and slot == 0
            if not ideal and joint.channel != slot:
                continue
            if self.state is not State.PLAYING:
                self.command[j] = _approach(self.command[j], self.target[j], joint.step)
            elif self.time_us:
                self.command[j] = self.target[j] = self.queue.at_time(j, self.time_us)
            if not ideal:
                self._last_pulse[slot] = self.command[j]

    def packet(self) -> None:
        """Command the smart servos for a packet that leaves now."""
        arrival_us = self.time_us + PACKET_US // BRAKE_SLOTS * self._pace
        for j, joint in enumerate(self.joints):
            if not SMART <= joint.channel < IDEAL or self.state is State.DETACHED or self.limp >> j & 1:
                continue
            if self.state is not State.PLAYING:
                self.command[j] = _approach(self.command[j], self.target[j], joint.step * 2)
            elif self.time_us:
                self.command[j] = self.target[j] = self.queue.at_time(j, arrival_us)

    # ---- servos ----

    def pulse(self, slot: int) -> int:
        """Return the width of a slot's pulse in sixteenths of a microsecond; 0 for no pulse."""
        j = self._joint_on(slot) if slot < PULSES and self.state is not State.DETACHED else None
        return 0 if j is None else self.command[j]

    def goal(self, channel: int) -> int:
        """Return the goal of a smart servo; 0 if it must be limp."""
        j = self._joint_on(channel)
        return 0 if j is None or self.state is State.DETACHED or self.limp >> j & 1 else (self.command[j] + 8) >> 4

    def set_measured(self, channel: int, position: int) -> None:
        """Take the position that a servo reports; 0 for a servo that does not answer any more."""
        j = self._joint_on(channel)
        if j is None:
            return
        self.measured[j] = position
        if position == 0 and self.state is not State.DETACHED:
            self.set_fault(Fault.SERVO, j)
        elif self.limp >> j & 1:
            self.command[j] = self.target[j] = position * 16

    def _joint_on(self, channel: int) -> int | None:
        """Return the place of the joint that a channel drives."""
        return next((j for j, joint in enumerate(self.joints) if joint.channel == channel), None)


def _approach(start: int, goal: int, step: int) -> int:
    return min(start + step, goal) if goal > start else max(start - step, goal)
