"""Boards without a clock of their own: the host executes the motion and sends goals with every status it reads.

Checks of ranges, rates and order, interpolation, and braking before an underrun are the firmware's, run on the host by
:mod:`hardware.executor`. Nothing buffers a delay of the computer, though: a board with its own clock plays smoother.
"""

from abc import ABC, abstractmethod
from collections.abc import Collection, Sequence
from types import TracebackType

import numpy as np

from hardware.board import BoardStatus, Fault, State, Waypoint
from hardware.boards.plausible_positions import PlausiblePositions
from hardware.boards.wire_records import wire_record
from hardware.clock import Clock, WallClock
from hardware.errors import BoardError, HardwareError, LinkError
from hardware.executor import SLOT_US, Executor
from hardware.frames import crc16
from hardware.guardian import Guardian
from hardware.joint_map import JointCalibration, JointMap
from hardware.protocol import IDEAL, PULSES
from hardware.waypoint_queue import Entry

_TRIES = 5  # a disturbed reply is nothing unusual
_LOST_S = 0.5  # without a valid answer for this long, the line is lost
_REPEAT_S = 0.2  # goals go out again after this time: one that was lost arrives a little later
_NEVER_MS = 0xFFFE, 0xFFFF  # the host cannot fall silent to itself


class HostTimedBoard(ABC):
    """Base of boards that take goals and know nothing of time, such as a bus of servos.

    Args:
        name: Name in reports and errors.
        clock: Clock of the host; None for the computer's.

    Attributes:
        retries: Number of requests repeated because the answer was disturbed.
        hiccup_us: Longest absence of the host while playing [µs]; after a longer one the board stops with UNDERRUN.
        tries: Number of times that positions are asked for before the servos count as silent.
        zero: Raw value 0 in the executor's numbers, which are unsigned.
    """

    queue_depth = 32
    readback_s = 0.1
    poll_s = 0.02  # goals go out with every status
    hiccup_us = 150_000
    tries = _TRIES
    zero = 0

    def __init__(self, name: str, clock: Clock | None = None) -> None:
        self.name = name
        self.clock: Clock = WallClock() if clock is None else clock
        self.retries = 0
        self._executor = Executor()
        self._joints: JointMap | None = None
        self._ids: list[int] = []
        self._names: dict[int, str] = {}  # of joints, by their servos
        self._began_s = self._sent_s = self.clock.now()
        self._slot_us = self._left_us = 0
        self._silent_since_s: float | None = None
        self._sent: list[int] = []
        self._plausible = PlausiblePositions(JointMap("", ()))
        self._positions: list[float] = []
        self._jumped = False  # a reading was far from the one before
        self._guardian = Guardian()
        self._open = True

    # ---- to be written for each kind of board ----

    @abstractmethod
    def _servo_id(self, joint: JointCalibration) -> int:
        """Return the number of a joint's servo; raise BoardError if its channel is not one of this board."""

    @abstractmethod
    def _prepare(self, ids: Sequence[int]) -> None:
        """Make sure that the servos are there, and limp."""

    @abstractmethod
    def _write(self, ids: Sequence[int], raw: Sequence[int]) -> None:
        """Send goals to all servos."""

    @abstractmethod
    def _read(self, ids: Sequence[int]) -> list[int] | None:
        """Return the positions of the servos, or None if an answer was disturbed."""

    @abstractmethod
    def _drive(self, ids: Sequence[int], on: bool) -> bool:
        """Let servos hold (on) or go limp (off); return True if it is sure to have worked."""

    @abstractmethod
    def _disconnect(self) -> None:
        """Close the link."""

    def _farewell(self) -> tuple[int | None, bytes]:
        """Return the port's file descriptor and the bytes that release the servos, for a process that guards them."""
        return None, b""

    # ---- Board ----

    def configure(self, joints: JointMap) -> int:
        """See :class:`hardware.Board`."""
        self._ids = [self._servo_id(joint) for joint in joints.joints]
        joints.check(self.name.partition(":")[0])
        self._joints, self._names = joints, dict(zip(self._ids, joints.names, strict=True))
        self._executor = Executor()
        try:
            self._prepare(self._ids)
            return self._hand_over(joints)
        except HardwareError:
            self._joints = None
            raise

    def _hand_over(self, joints: JointMap) -> int:
        """Configure the executor and read the positions; return the calibration's CRC."""
        executor = self._executor
        records = [wire_record(joint.shifted(self.zero), IDEAL + j) for j, joint in enumerate(joints.joints)]
        packed = b"".join(record.pack() for record in records)
        fault = executor.config(0, len(records), packed)
        if fault is Fault.NONE:
            fault = executor.commit(joints.crc, crc16(packed), *_NEVER_MS)
        if fault is not Fault.NONE:
            raise BoardError(f"the calibration does not fit: {joints.names[executor.fault_joint]}: {fault.message}")
        self._sent, self._plausible = [], PlausiblePositions(joints)
        self._positions = [np.nan] * len(joints.joints)
        self._measure(required=True)
        return executor.calibration

    def enable(self) -> None:
        """See :class:`hardware.Board`."""
        self._catch_up()
        fault = self._executor.enable(self._configured().crc)
        if fault is not Fault.NONE:
            raise BoardError(f"the servos are not driven: {fault.message}")
        self._guardian.watch(*self._farewell())
        self._send_goals()
        self._drive_surely(self._ids, True)

    def send(self, waypoints: Sequence[Waypoint]) -> None:
        """See :class:`hardware.Board`."""
        self._catch_up()
        for point in waypoints:
            values = tuple(value + self.zero for value in point.raw)
            self._executor.waypoints(point.index, point.last, [Entry(point.time_us, values)])

    def start(self, delay_us: int) -> None:
        """See :class:`hardware.Board`."""
        self.start_at(self.clock.now() + 1e-6 * delay_us)

    def start_at(self, host_s: float) -> None:
        """See :class:`hardware.Board`."""
        self._catch_up()
        now_us = self._now_us()
        fault = self._executor.start(max(round(1e6 * (host_s - self._began_s)), now_us), now_us)
        if fault is not Fault.NONE:
            raise BoardError(f"the board cannot start: it is {self._executor.state.message}, fault {fault.name}")

    @property
    def start_lead_s(self) -> float:
        """See :class:`hardware.Board` [s]."""
        return 0.0

    def status(self) -> BoardStatus:
        """See :class:`hardware.Board`; also sends the goals that are due."""
        joints = self._configured()
        self._guardian.beat()
        try:
            self._catch_up()
            self._send_goals()
            done = self._executor.done  # then what is measured is the result: it must be true now
            self._measure(required=done)
            if not self._examine() and done and not self._examine():
                raise LinkError(self._describe_silence())
        except HardwareError:
            self._executor.stop()
            raise
        self._left_us = self._now_us()
        executor = self._executor
        return BoardStatus(
            time_us=self._now_us(),
            motion_us=executor.time_us,
            state=executor.state,
            fault=executor.fault,
            free=self.queue_depth - len(executor.queue),
            commanded=np.array(self._goals(), float),
            measured=np.where(joints.column("readback"), self._positions, np.nan),
            done=executor.done and executor.state is not State.PLAYING,
            joint=executor.fault_joint,
        )

    def stop(self) -> None:
        """See :class:`hardware.Board`."""
        self._executor.stop()
        if self._joints is not None and self._executor.state is not State.DETACHED:
            self._send_goals()

    def clear_fault(self) -> None:
        """See :class:`hardware.Board`."""
        self._executor.clear()

    @property
    def without_watchdog(self) -> tuple[str, ...]:
        """See :class:`hardware.Board`; a kind of board with a watchdog of its own returns nothing."""
        return (self.name,)

    def move(self, raw: Sequence[int]) -> None:
        """See :class:`hardware.Board`."""
        fault = self._executor.setpoint(tuple(int(x) + self.zero for x in raw))
        if fault is not Fault.NONE:
            raise BoardError(f"the board does not move there: {fault.message}")

    def limp(self, joints: Collection[int]) -> None:
        """See :class:`hardware.Board`."""
        names, silent = self._configured().names, ~self._configured().column("readback")
        if any(silent[j] for j in joints):
            without = ", ".join(names[j] for j in joints if silent[j])
            raise BoardError(f"{without} cannot be taught by hand: no read-back")
        self._executor.set_limp(sum(1 << j for j in joints))
        self._measure(required=True)
        self._send_goals()  # joints that hold again do so at their measured positions
        self._drive_surely([i for j, i in enumerate(self._ids) if j in joints], False)
        self._drive_surely([i for j, i in enumerate(self._ids) if j not in joints], True)

    def release(self) -> None:
        """See :class:`hardware.Board`."""
        self._executor.release()
        if self._ids:  # also after a configuration that failed
            self._drive_surely(self._ids, False)
        self._guardian.close()

    def close(self) -> None:
        """See :class:`hardware.Board`."""
        if not self._open:
            return
        self._open = False
        try:
            self.release()
        except LinkError:
            pass  # the servos cannot be reached
        finally:
            self._disconnect()
            self._guardian.close()

    def __enter__(self) -> "HostTimedBoard":
        """Return the board itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""
        self.close()

    # ---- inside ----

    def _configured(self) -> JointMap:
        if self._joints is None:
            raise BoardError("the board moves nothing before it has been configured")
        return self._joints

    def _now_us(self) -> int:
        return round(1e6 * (self.clock.now() - self._began_s))

    def _catch_up(self) -> None:
        """Advance the executor to now, slot by slot, as braking counts in slots."""
        now = self._executor.heard_us = self._now_us()
        if self._executor.state is State.PLAYING and now - self._slot_us > self.hiccup_us:
            self._executor.stop()  # the servos rest at their last goals, far from where the motion would be: no jump
            if now - self._left_us < self.hiccup_us // 2:  # the servos were waited for, not the host
                raise LinkError(self._describe_delay(1e-3 * (now - self._slot_us)))
            self._executor.set_fault(Fault.UNDERRUN)
        while self._slot_us + SLOT_US <= now:
            self._slot_us += SLOT_US
            self._executor.slot(self._slot_us // SLOT_US % PULSES, self._slot_us)

    def _goals(self) -> list[int]:
        """Return the raw values that the servos are to go to."""
        return [((command + 8) >> 4) - self.zero for command in self._executor.command]

    def _send_goals(self) -> None:
        goals, now = self._goals(), self.clock.now()
        if self._executor.state is not State.DETACHED and (goals != self._sent or now - self._sent_s > _REPEAT_S):
            self._write(self._ids, goals)
            self._sent, self._sent_s = goals, now

    def _measure(self, required: bool = False) -> None:
        """Read the positions; after a disturbed answer the previous ones stay, unless new ones are required."""
        began_s, left = self.clock.now(), self.tries + 2 * required
        plausible, doubts = self._plausible, self._plausible.doubts
        for _ in range(left + _TRIES):
            positions = self._read(self._ids)
            if positions is not None and plausible.believe(positions, self.clock.now()):
                self._silent_since_s = None
                self._jumped = plausible.doubts > doubts
                self.retries += plausible.doubts - doubts
                self._positions = list(map(float, positions))
                for j, position in enumerate(positions):
                    self._executor.set_measured(IDEAL + j, position + self.zero or 1)  # 0 would be a missing servo
                return
            if positions is None:
                self.retries, left = self.retries + 1, left - 1
                if not left:
                    break
        if self._silent_since_s is None:
            self._silent_since_s = began_s
        patience_s = 1e-6 * self.hiccup_us if self._executor.state is State.PLAYING else _LOST_S
        if required or self.clock.now() - self._silent_since_s > patience_s:
            raise LinkError(self._describe_silence())

    def _examine(self) -> bool:
        """Raise ServoError if a servo has a fault, or no longer does what it was told; may be overridden.

        Returns:
            False if a servo that was asked did not answer.
        """
        return True

    def _describe_delay(self, delay_ms: float) -> str:
        """Return a sentence about answers that came too late to go on."""
        if self._silent_since_s is not None:
            return self._describe_silence()
        return (
            f"{self.name}: the servos' answers kept the computer waiting for {delay_ms:.0f} ms; is the line disturbed, "
            "or its rate too low?"
        )

    def _describe_silence(self) -> str:
        """Return a sentence about servos that do not answer; may be overridden."""
        return f"{self.name}: the servos do not answer; are they powered, and is the bus plugged in?"

    def _drive_surely(self, ids: Sequence[int], on: bool) -> None:
        """Switch the servos on or off, again until it is sure to have worked."""
        for _ in range(2 * _TRIES):
            if not ids or self._drive(ids, on):
                return
            self.retries += 1
        raise LinkError(f"{self.name}: a servo could not be switched {'on' if on else 'off'}: it does not answer")


def bus_id(joint: JointCalibration, lowest: int, highest: int) -> int:
    """Return the number of a joint's servo on a bus, from its channel.

    Args:
        joint: Calibration of the joint.
        lowest: Lowest number that a servo can have.
        highest: Highest number that a servo can have.

    Raises:
        BoardError: The channel is not a number in this range.
    """
    if joint.channel.isdecimal() and lowest <= int(joint.channel) <= highest:
        return int(joint.channel)
    raise BoardError(
        f"{joint.name} needs a channel {lowest} to {highest}, its servo's number; got {joint.channel!r}: "
        "say in the calibration which servo drives it"
    )
