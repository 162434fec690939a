"""Boards that know nothing of trajectories: the host interpolates, and sends goals whenever it is asked for status.

What the firmware does on the board is done here by the same model of it (:mod:`hardware.executor`): checks of
ranges, rates and order, interpolation, braking before an underrun. Between a computer's hiccup and the servos stands
nothing, though: a real board with its own clock plays smoother.
"""

from abc import ABC, abstractmethod
from collections.abc import Collection, Sequence
from types import TracebackType

import numpy as np

from hardware.boards.wire_records import record_of
from hardware.clock import Clock, WallClock
from hardware.device import DeviceStatus, Fault, State, Waypoint
from hardware.errors import BoardError, LinkError
from hardware.executor import SLOT_US, Entry, Motion
from hardware.frames import crc16
from hardware.joint_map import JointCalibration, JointMap
from hardware.protocol import IDEAL, PULSES

_STATES = list(State)
_TRIES = 5  # the servos' SDKs do not retry, and a disturbed reply is nothing unusual
_BLIND_S = 0.5  # without any good answer for so long, the line is lost


class StreamedBoard(ABC):
    """A bus of servos driven by the host.

    Args:
        name: What reports call it.
        clock: Whose time; None for the computer's.
    """

    queue_depth = 32
    readback_s = 0.1
    poll_s = 0.02  # goals go out with every status
    hiccup_us = 150_000  # a host that was away longer than this has left the servos without goals for too long

    def __init__(self, name: str, clock: Clock | None = None) -> None:
        self.name = name
        self.clock: Clock = WallClock() if clock is None else clock
        self.retries = 0
        self._motion = Motion()
        self._joints: JointMap | None = None
        self._ids: list[int] = []
        self._began_s = self._good_s = self.clock.now()
        self._slot_us = 0
        self._sent: list[int] = []
        self._open = True

    # ---- what a kind of board says for itself ----

    @abstractmethod
    def _id(self, joint: JointCalibration) -> int:
        """A joint's number on the bus."""

    @abstractmethod
    def _prepare(self, ids: Sequence[int]) -> None:
        """Makes sure that the servos are there, and limp."""

    @abstractmethod
    def _write(self, ids: Sequence[int], raw: Sequence[int]) -> None:
        """Sends goals, all at once."""

    @abstractmethod
    def _read(self, ids: Sequence[int]) -> list[int] | None:
        """Where the servos are; None where an answer was disturbed."""

    @abstractmethod
    def _drive(self, ids: Sequence[int], on: bool) -> bool:
        """Lets servos hold, or go limp; whether it is sure to have worked."""

    @abstractmethod
    def _hang_up(self) -> None:
        """Ends the link."""

    # ---- Device ----

    def configure(self, joints: JointMap) -> int:
        """See :class:`hardware.device.Device`."""
        self._ids = [self._id(joint) for joint in joints.joints]
        twice = [i for i in self._ids if self._ids.count(i) > 1]
        if twice:
            raise BoardError(f"two joints have channel {twice[0]}; every servo needs a number of its own")
        self._prepare(self._ids)
        self._motion = motion = Motion()
        records = [record_of(joint, IDEAL + j, 0xFFFF) for j, joint in enumerate(joints.joints)]
        packed = b"".join(record.pack() for record in records)
        fault = motion.config(0, len(records), packed)
        if fault is Fault.NONE:
            fault = motion.commit(joints.crc, crc16(packed), 0xFFFE, 0xFFFF)
        if fault is not Fault.NONE:
            raise BoardError(f"the calibration does not fit: {joints.names[motion.fault_joint]}: {fault.value}")
        self._joints, self._sent = joints, []
        self._measure(patient=True)
        return motion.calibration

    def enable(self) -> None:
        """See :class:`hardware.device.Device`."""
        self._catch_up()
        fault = self._motion.enable(self._configured().crc)
        if fault is not Fault.NONE:
            raise BoardError(f"the servos are not driven: {fault.value}")
        self._send_goals()
        self._surely(self._ids, True)

    def send(self, waypoints: Sequence[Waypoint]) -> None:
        """See :class:`hardware.device.Device`."""
        self._catch_up()
        for point in waypoints:
            self._motion.waypoints(point.index, point.last, [Entry(point.time_us, point.raw)])

    def start(self, delay_us: int) -> None:
        """See :class:`hardware.device.Device`."""
        self.start_at(self.clock.now() + 1e-6 * delay_us)

    def start_at(self, host_s: float) -> None:
        """See :class:`hardware.device.Device`."""
        self._catch_up()
        now_us = self._now_us()
        fault = self._motion.start(max(round(1e6 * (host_s - self._began_s)), now_us), now_us)
        if fault is not Fault.NONE:
            state = _STATES[self._motion.state]
            raise BoardError(f"the board cannot start: it is {state.value}, fault {fault.name}")

    @property
    def start_lead_s(self) -> float:
        """See :class:`hardware.device.Device`."""
        return 0.0

    def status(self) -> DeviceStatus:
        """See :class:`hardware.device.Device`; also moves the servos on."""
        joints = self._configured()
        self._catch_up()
        self._send_goals()
        self._measure()
        motion = self._motion
        measured = np.where(joints.column("readback"), np.array(motion.measured, float), np.nan)
        playing = _STATES[motion.state] is State.PLAYING
        return DeviceStatus(
            time_us=self._now_us(),
            motion_us=motion.time_us,
            state=_STATES[motion.state],
            fault=motion.fault,
            free=self.queue_depth - len(motion.queue),
            commanded=np.array([(command + 8) >> 4 for command in motion.command], float),
            measured=np.where(measured == 0, np.nan, measured),
            done=motion.done and not playing,
            joint=motion.fault_joint,
        )

    def stop(self) -> None:
        """See :class:`hardware.device.Device`."""
        self._motion.stop()
        if self._joints is not None and self._motion.state:
            self._send_goals()

    def move(self, raw: Sequence[int]) -> None:
        """See :class:`hardware.device.Device`."""
        fault = self._motion.setpoint(tuple(int(x) for x in raw))
        if fault is not Fault.NONE:
            raise BoardError(f"the board does not move there: {fault.value}")

    def limp(self, joints: Collection[int]) -> None:
        """See :class:`hardware.device.Device`."""
        names, deaf = self._configured().names, ~self._configured().column("readback")
        if any(deaf[j] for j in joints):
            raise BoardError(f"{', '.join(names[j] for j in joints if deaf[j])} cannot be taught by hand: no read-back")
        self._motion.lim(sum(1 << j for j in joints))
        self._measure(patient=True)
        self._send_goals()  # those that hold again hold where the hand left them
        self._surely([i for j, i in enumerate(self._ids) if j in joints], False)
        self._surely([i for j, i in enumerate(self._ids) if j not in joints], True)

    def release(self) -> None:
        """See :class:`hardware.device.Device`."""
        self._motion.release()
        if self._joints is not None:
            self._surely(self._ids, False)

    def close(self) -> None:
        """See :class:`hardware.device.Device`."""
        if not self._open:
            return
        self._open = False
        try:
            self.release()
        except LinkError:
            pass  # nobody hears it
        finally:
            self._hang_up()

    def __enter__(self) -> "StreamedBoard":
        """The board itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Closes."""
        self.close()

    # ---- inside ----

    def _configured(self) -> JointMap:
        if self._joints is None:
            raise BoardError("the board moves nothing before it has been configured")
        return self._joints

    def _now_us(self) -> int:
        return round(1e6 * (self.clock.now() - self._began_s))

    def _catch_up(self) -> None:
        """Moves on to now, in the steps that braking counts in."""
        now = self._motion.heard_us = self._now_us()
        if self._motion.state == _STATES.index(State.PLAYING) and now - self._slot_us > self.hiccup_us:
            self._motion.stop()  # the servos rest at their last goals, and a leap to where they should be is no way on
            self._motion.set_fault(Fault.UNDERRUN)
        while self._slot_us + SLOT_US <= now:
            self._slot_us += SLOT_US
            self._motion.slot(self._slot_us // SLOT_US % PULSES, self._slot_us)

    def _send_goals(self) -> None:
        goals = [(command + 8) >> 4 for command in self._motion.command]
        if self._motion.state and goals != self._sent:
            self._write(self._ids, goals)
            self._sent = goals

    def _measure(self, patient: bool = False) -> None:
        """Reads where the servos are; keeps what was known where an answer is disturbed."""
        for _ in range(_TRIES):
            positions = self._read(self._ids)
            if positions is not None:
                self._good_s = self.clock.now()
                for j, position in enumerate(positions):
                    self._motion.set_measured(IDEAL + j, max(1, position))
                return
            self.retries += 1
        if patient or self.clock.now() - self._good_s > _BLIND_S:
            raise LinkError(f"{self.name}: the servos do not answer; are they powered, and is the bus plugged in?")

    def _surely(self, ids: Sequence[int], on: bool) -> None:
        """Switches torque, again where the answer is disturbed."""
        for _ in range(2 * _TRIES):
            if not ids or self._drive(ids, on):
                return
            self.retries += 1
        raise LinkError(f"{self.name}: a servo could not be switched {'on' if on else 'off'}: it does not answer")


def bus_id(joint: JointCalibration, lowest: int, highest: int) -> int:
    """A joint's number on a bus, from its channel.

    Raises:
        BoardError: The channel is no number in this range.
    """
    if joint.channel.isdecimal() and lowest <= int(joint.channel) <= highest:
        return int(joint.channel)
    raise BoardError(
        f"{joint.name} needs a channel {lowest} to {highest}, its servo's number; got {joint.channel!r}: "
        "say in the calibration which servo drives it"
    )
