"""A simulated board with servos: a model of what a real one does with waypoints, limits and time.

It lives in the time of its clock. Whenever it is spoken to it first catches up, one servo frame of 20 ms after the
other, so with a :class:`hardware.clock.VirtualClock` a minute of motion takes milliseconds and always gives the same
log.
"""

from collections import deque
from collections.abc import Sequence
from types import TracebackType
from typing import NamedTuple

import numpy as np

from hardware.clock import Clock, VirtualClock
from hardware.device import DeviceStatus, Fault, State, Waypoint
from hardware.errors import BoardError, LinkError
from hardware.joint_map import JointMap

FRAME_US = 20_000  # period of a hobby servo's pulse
_LAG_S = 0.04  # a small servo follows its command with about two frames of delay
_ROUNDING = 2.0  # raw steps by which a frame may exceed its rate: command and waypoints are whole numbers
_STOP_FRAMES = 5  # an underrun is braked to rest in so many frames: 0.1 s


class Pulse(NamedTuple):
    """One servo frame of the board's log."""

    time_us: int
    commanded: np.ndarray
    measured: np.ndarray


class SimulatedBoard:
    """A board that checks like the firmware: range, rate per frame, order, lateness, underrun, silence.

    Args:
        clock: Whose time it lives in; None for a :class:`hardware.clock.VirtualClock` of its own.
        pose: Joint angles the servos stand at, ``(joint,)`` [rad]; None for their safe pose.
        queue_depth: Places for waypoints.
        hold_after_s: Silence after which it holds.
        release_after_s: Silence after which it stops driving the servos.
        stuck: Names of joints that do not move, as a fault to test with.
        unplugged_at_s: Time at which the link dies, as a fault to test with; None for never.
    """

    name = "simulated"

    def __init__(
        self,
        *,
        clock: Clock | None = None,
        pose: Sequence[float] | None = None,
        queue_depth: int = 32,
        hold_after_s: float = 0.3,
        release_after_s: float = 2.0,
        stuck: Sequence[str] = (),
        unplugged_at_s: float | None = None,
    ) -> None:
        self.clock: Clock = VirtualClock() if clock is None else clock
        self.queue_depth = queue_depth
        self.log: list[Pulse] = []
        self._pose = None if pose is None else np.array(pose, float)
        self._hold_after_us, self._release_after_us = int(hold_after_s * 1e6), int(release_after_s * 1e6)
        self._stuck_names, self._unplugged_at_s = tuple(stuck), unplugged_at_s
        self._joints: JointMap | None = None
        self._boot_s = self.clock.now()
        self._frame_us = self._heard_us = 0
        self._queue: deque[Waypoint] = deque()
        self._state, self._fault = State.DETACHED, Fault.NONE
        self._start_us: int | None = None
        self._next_index, self._done = 0, False
        self._from: tuple[int, np.ndarray] | None = None
        self._brake = np.zeros(0)
        self._brake_frames = 0

    def configure(self, joints: JointMap) -> int:
        """See :class:`hardware.device.Device`; clears a fault."""
        self._hear()
        pose = self._pose if self._pose is not None else joints.column("safe")
        if self._joints is None or self._joints.names != joints.names:
            if pose.shape != (len(joints.names),):
                raise BoardError(f"the simulated servos stand at {len(pose)} angles; the robot has {len(joints.names)}")
            self._measured = joints.to_raw(pose).astype(float)
        self._joints = joints
        self._commanded = np.rint(self._measured)
        self._step = joints.column("max_rate") * joints.column("raw_per_rad") * FRAME_US * 1e-6
        self._low, self._high = joints.column("raw_low"), joints.column("raw_high")
        self._stuck = np.array([name in self._stuck_names for name in joints.names])
        self._drop()
        self._state, self._fault = State.DETACHED, Fault.NONE
        return joints.crc

    def enable(self) -> None:
        """See :class:`hardware.device.Device`."""
        self._hear()
        if self._joints is None:
            raise BoardError("the board moves nothing before it has been configured")
        self._commanded = np.clip(np.rint(self._measured), self._low, self._high)
        self._state = State.HOLDING

    def send(self, waypoints: Sequence[Waypoint]) -> None:
        """See :class:`hardware.device.Device`; a bad waypoint is a fault, and nothing after it is taken."""
        self._hear()
        for point in waypoints:
            if self._fault is not Fault.NONE:
                return
            raw = np.array(point.raw, float)
            if point.index != self._next_index or len(self._queue) >= self.queue_depth:
                self._stop_with(Fault.ORDER)
            elif (raw < self._low).any() or (raw > self._high).any():
                self._stop_with(Fault.RANGE)
            elif self._start_us is not None and self._start_us + point.time_us <= self._frame_us:
                self._stop_with(Fault.LATE)
            else:
                self._queue.append(point)
                self._next_index += 1

    def start(self, delay_us: int) -> None:
        """See :class:`hardware.device.Device`."""
        self._hear()
        if self._state is not State.HOLDING or self._fault is not Fault.NONE or not self._queue:
            raise BoardError(f"the board cannot start: it is {self._state.value}, fault {self._fault.name}")
        self._start_us = self._now_us() + delay_us
        self._from = (0, self._commanded.copy())
        self._state = State.PLAYING

    def status(self) -> DeviceStatus:
        """See :class:`hardware.device.Device`."""
        self._hear()
        if self._joints is None:
            raise BoardError("the board has no servos before it has been configured")
        return DeviceStatus(
            time_us=self._now_us(),
            motion_us=-1 if self._start_us is None else self._frame_us - self._start_us,
            state=self._state,
            fault=self._fault,
            free=self.queue_depth - len(self._queue),
            commanded=self._commanded.copy(),
            measured=np.where(self._joints.column("readback"), np.rint(self._measured), np.nan),
            done=self._done,
        )

    def stop(self) -> None:
        """See :class:`hardware.device.Device`."""
        self._hear()
        self._drop()
        if self._state is State.PLAYING:
            self._state = State.HOLDING

    def release(self) -> None:
        """See :class:`hardware.device.Device`."""
        self._hear()
        self._drop()
        self._state = State.DETACHED

    def close(self) -> None:
        """See :class:`hardware.device.Device`."""
        self._drop()
        self._state = State.DETACHED

    def __enter__(self) -> "SimulatedBoard":
        """The board itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Closes."""
        self.close()

    def _now_us(self) -> int:
        return round((self.clock.now() - self._boot_s) * 1e6)

    def _hear(self) -> None:
        """Catches up with the clock; then the host has been heard."""
        dead = self._unplugged_at_s is not None and self.clock.now() - self._boot_s >= self._unplugged_at_s
        self._catch_up()
        if dead:
            raise LinkError("the board does not answer; is it powered, and is the cable or radio link still there?")
        self._heard_us = self._now_us()

    def _catch_up(self) -> None:
        """All frames until now."""
        now = self._now_us()
        while self._frame_us + FRAME_US <= now:
            self._frame_us += FRAME_US
            if self._joints is not None:
                self._frame()

    def _frame(self) -> None:
        """One servo frame."""
        silent = self._frame_us - self._heard_us
        if self._state is State.PLAYING and silent > self._hold_after_us:
            self._stop_with(Fault.SILENCE)
        if silent > self._release_after_us:
            self._state = State.DETACHED
        if self._brake_frames:
            self._brake_frames -= 1
            self._commanded = self._commanded + self._brake * self._brake_frames / _STOP_FRAMES
            self._commanded = np.rint(np.clip(self._commanded, self._low, self._high))
        elif self._state is State.PLAYING:
            self._follow()
        if self._state is not State.DETACHED:
            follow = 1.0 - np.exp(-FRAME_US * 1e-6 / _LAG_S)
            move = np.clip((self._commanded - self._measured) * follow, -self._step, self._step)
            self._measured = self._measured + np.where(self._stuck, 0.0, move)
        self.log.append(Pulse(self._frame_us, self._commanded.copy(), self._measured.copy()))

    def _follow(self) -> None:
        """Commands the servos to where the motion is at this frame."""
        assert self._start_us is not None
        assert self._from is not None
        t = self._frame_us - self._start_us
        if t < 0:
            return
        while self._queue and self._queue[0].time_us <= t:
            point = self._queue.popleft()
            self._from = (point.time_us, np.array(point.raw, float))
            self._done = point.last
        before_us, before = self._from
        if self._queue:
            after = self._queue[0]
            share = (t - before_us) / (after.time_us - before_us)
            wanted = before + share * (np.array(after.raw, float) - before)
        else:
            wanted = before
        step = wanted - self._commanded
        if (np.abs(step) > self._step + _ROUNDING).any():
            self._stop_with(Fault.RATE)
            return
        if not self._queue and not self._done:
            self._stop_with(Fault.UNDERRUN)
            return
        self._commanded = np.rint(wanted)
        if self._done and not self._queue:
            self._state = State.HOLDING

    def _stop_with(self, fault: Fault) -> None:
        """Faults, and holds; from a motion, braking over a few frames."""
        self._fault = fault
        self._queue.clear()
        if self._state is State.PLAYING:
            self._state = State.HOLDING
            last = self.log[-2:]
            moved = last[1].commanded - last[0].commanded if len(last) == 2 else np.zeros_like(self._commanded)
            self._brake, self._brake_frames = moved, _STOP_FRAMES

    def _drop(self) -> None:
        """Forgets the motion."""
        self._queue.clear()
        self._start_us, self._next_index, self._done, self._from = None, 0, False, None
        self._brake_frames = 0
