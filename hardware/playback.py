"""One playback: phases, tolerances, and what becomes of the arm in the end."""

import itertools
import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np

from hardware import schedule
from hardware.board import Board, BoardStatus, Fault, State, Waypoint
from hardware.errors import BoardError, HardwareError, LinkError, ServoError
from hardware.joint_map import JointMap
from hardware.report import LogRow, PlayResult, Recorder
from hardware.schedule import Segment
from hardware.stopping import LOWER_SPEED, OnStop
from hardware.waypoint_queue import signed_us
from jaxik.trajectories import Trajectory

_RAW_TOLERANCE = 1.0  # raw steps: a measurement may be off by rounding
_MOVE_IN_S = 3.0
_AWAY_S = 0.12  # the longest silence of the host that needs no explanation: three of its usual ones
_LEAD_US = 100_000  # from the start command to the first waypoint
_FAULT_RESULTS = {
    Fault.LATE: PlayResult.UNDERRUN,
    Fault.UNDERRUN: PlayResult.UNDERRUN,
    Fault.SILENCE: PlayResult.LINK_LOST,
    Fault.LENGTH: PlayResult.LINK_LOST,
    Fault.SERVO: PlayResult.LINK_LOST,
    Fault.RANGE: PlayResult.LIMIT,
    Fault.RATE: PlayResult.LIMIT,
}  # any other fault: ABORTED


class Tolerances(NamedTuple):
    """Deviations that end a playback; only joints with read-back count.

    Attributes:
        path: Greatest deviation of a joint from its command [rad]; 20 degrees, three times a hobby servo's lag.
        goal: Greatest deviation of a joint from the goal in the end [rad]; three steps of a Meccano servo.
        goal_time_s: Time to reach the goal after the last waypoint [s].
        ease: Greatest distance of a joint from the first posture before the start [rad].
    """

    path: float = math.radians(20)
    goal: float = math.radians(3)
    goal_time_s: float = 1.0
    ease: float = math.pi


DEFAULT_TOLERANCES = Tolerances()


class EndedEarly(Exception):
    """Early end of a playback, for :func:`hardware.play` to report.

    Args:
        result: Outcome.
        message: One sentence with numbers.
    """

    def __init__(self, result: PlayResult, message: str) -> None:
        super().__init__(message)
        self.result = result


class Playback:
    """One playback on a board.

    Args:
        board: Board to play on.
        joints: Calibration of the trajectory's joints, in its order.
        tolerances: Deviations that end the playback.
        progress: Function that is called with the fraction done, 0 to 1; of the present round if it goes on for ever.
        watch: Function that is called with every row of the log; both functions must return soon.

    Attributes:
        began_s: Time of the clock at the begin [s].
        warnings: Things to know, one sentence each.
        recorder: Log and tracking error so far.
        held: True once the arm is left driven in the end.
    """

    def __init__(
        self,
        board: Board,
        joints: JointMap,
        tolerances: Tolerances,
        progress: Callable[[float], None],
        watch: Callable[[LogRow], None],
    ) -> None:
        self.began_s = board.clock.now()
        self.warnings: list[str] = []
        self.recorder = Recorder(joints.names)
        self.held = False
        self._board, self._joints, self._tolerances = board, joints, tolerances
        self._progress, self._watch = progress, watch
        self._recent: deque[tuple[float, np.ndarray]] = deque()
        self._polled_s = self.began_s
        self._driven = False
        self._motion_us = self._last_us = 0
        self._phases: deque[tuple[int, str]] = deque()  # start of each phase [µs], from the present one on
        self._told: Callable[[], bool] = lambda: False

    def run(self, trajectory: Trajectory, speed: float, park: bool, loops: int | None) -> None:
        """Run through all phases.

        Args:
            trajectory: Motion to play.
            speed: Time scale.
            park: True to ease out to the safe pose in the end.
            loops: Number of times to play; None to go on for ever.

        Raises:
            EndedEarly: The playback did not succeed.
            BoardError: The board refuses.
            LinkError: The board stopped answering.
            ServoError: A servo reports a fault of its own.
        """
        problems = schedule.problems(trajectory, self._joints, speed)
        if problems:
            more = f"; and {len(problems) - 1} more" if len(problems) > 1 else ""
            raise EndedEarly(PlayResult.LIMIT, problems[0] + more)
        echoed = self._board.configure(self._joints)
        if echoed != self._joints.crc:
            raise BoardError(
                f"the board holds another calibration: its CRC is {echoed:04x}, ours {self._joints.crc:04x}"
            )
        present, first, last = self._present(), trajectory.q[0], trajectory.q[-1]
        self._check_distance(present, first)
        self._driven = True
        self._board.enable()
        ease_in = schedule.eased("ease in", self._move_inside(present), first, self._joints)
        closed = np.array_equal(self._joints.to_raw(first), self._joints.to_raw(last))
        back = None if closed else schedule.eased("ease in", last, first, self._joints)
        round_s = trajectory.duration / speed + (0.0 if back is None else back.duration)
        total_s = ease_in.duration + round_s * (1 if loops is None else loops)
        turns, endless = (itertools.count(), True) if loops is None else (range(loops), False)

        def rounds() -> Iterator[Segment]:
            yield ease_in
            for count in turns:
                if count and back is not None:
                    yield back
                yield schedule.played(trajectory, speed)

        self._move(rounds(), lambda time: 0.9 * (time / total_s % 1 if endless else min(time / total_s, 1.0)))
        self._reach_goal(last)
        if park:
            ease_out = schedule.eased("ease out", last, self._joints.column("safe"), self._joints)
            self._move([ease_out], lambda time: 0.9 + 0.1 * min(time / ease_out.duration, 1.0))
        self._progress(1.0)

    def finish(self, on_stop: OnStop, told: Callable[[], bool]) -> None:
        """Stop, and then release, hold or lower the arm; over a dead link the board does what it does by itself.

        Args:
            on_stop: Fate of the arm.
            told: Function that returns True to release it at once.
        """
        self._told, self._progress = told, lambda fraction: None
        try:
            self._board.stop()
            if self._driven and on_stop is OnStop.LOWER:
                self._lower()
            if self._driven and on_stop is OnStop.HOLD:
                self.held = self._is_driven()
            if not self.held:
                self._board.release()
        except HardwareError as error:
            self.warnings.append(f"the servos could not be released: {error}")
        except BaseException:  # of a function that watches
            self._board.release()
            raise

    def _is_driven(self) -> bool:
        try:
            return self._board.status().state is not State.DETACHED
        except ServoError:  # of one servo; the others hold
            return True

    def _lower(self) -> None:
        """Go slowly to the safe pose; whatever prevents it is a warning."""
        try:
            self._board.clear_fault()
            status = self._board.status()
            if status.state is State.DETACHED:
                return
            commanded, safe = self._joints.to_rad(status.commanded), self._joints.column("safe")
            self._move([schedule.eased("lower", commanded, safe, self._joints, LOWER_SPEED)], lambda time: 1.0)
        except (EndedEarly, HardwareError) as error:
            self.warnings.append(f"the arm was released before it was down: {error}")
            if isinstance(error, LinkError):
                raise
            self._board.stop()

    # ---- before the motion ----

    def _present(self) -> np.ndarray:
        """Return the present posture [rad]; joints without read-back count as being where they are commanded."""
        status = self._board.status()
        measured = self._joints.to_rad(status.measured)
        silent = np.isnan(measured)
        if silent.any():
            names = ", ".join(name for name, s in zip(self._joints.names, silent, strict=True) if s)
            self.warnings.append(
                f"no read-back from {names}: taken to stand where last commanded, tolerances not checked"
            )
        return np.where(silent, self._joints.to_rad(status.commanded), measured)

    def _check_distance(self, present: np.ndarray, first: np.ndarray) -> None:
        """Refuse to ease in from too far away."""
        distance = np.abs(first - present)
        if distance.max() > self._tolerances.ease:
            j = int(np.argmax(distance))
            raise EndedEarly(
                PlayResult.LIMIT,
                f"{self._joints.names[j]} stands {math.degrees(distance[j]):.0f}° from the first posture, more than "
                f"the {math.degrees(self._tolerances.ease):.0f}° it may ease in; move the arm nearer and play again",
            )

    def _move_inside(self, present: np.ndarray) -> np.ndarray:
        """Wait until joints that stood outside their limits have been moved inside; return the new posture [rad]."""
        joints = self._joints
        inside = np.clip(present, joints.column("lower"), joints.column("upper"))
        outside = np.flatnonzero(np.abs(inside - present) * joints.column("raw_per_rad") > _RAW_TOLERANCE)
        for j in outside:
            self.warnings.append(
                f"{joints.names[j]} stood at {math.degrees(present[j]):.1f}°, outside its range: moved to "
                f"{math.degrees(inside[j]):.1f}° first"
            )
        end = self._board.clock.now() + _MOVE_IN_S
        while len(outside) and self._board.clock.now() < end:
            commanded, _ = self._record(self._board.status(), "ease in")
            if (np.abs(commanded - inside)[outside] * joints.column("raw_per_rad")[outside] <= _RAW_TOLERANCE).all():
                break
            self._board.clock.sleep(self._board.poll_s)
        return inside

    # ---- during the motion ----

    def _move(self, segments: Iterable[Segment], fraction: Callable[[float], float]) -> None:
        """Stream one motion and wait for its end.

        Args:
            segments: Its parts.
            fraction: Progress at a time since the motion's start [s].
        """
        points = schedule.waypoints(segments, self._joints)
        self._board.stop()  # clears the previous motion
        self._motion_us = self._last_us = 0
        self._polled_s = self._board.clock.now()
        self._phases.clear()
        self._feed(points)
        try:
            self._board.start(_LEAD_US)
        except BoardError:
            self._poll()  # if the reason is a fault, it is the result
            raise
        while True:
            polled_s = self._board.clock.now()
            status = self._poll()
            if status.done and status.state is State.HOLDING:
                return
            if self._told():
                raise EndedEarly(PlayResult.ABORTED, "stopped on request")
            self._feed(points, status)
            self._progress(fraction(max(0.0, 1e-6 * self._motion_us)))
            self._board.clock.sleep(max(0.0, polled_s + self._board.poll_s - self._board.clock.now()))

    def _feed(self, points: Iterator[tuple[Waypoint, str]], status: BoardStatus | None = None) -> None:
        """Fill the board's queue."""
        batch = []
        for point, phase in itertools.islice(points, (status or self._board.status()).free):
            batch.append(point)
            if not self._phases or self._phases[-1][1] != phase:
                self._phases.append((self._last_us, phase))
            self._last_us = point.time_us
        if batch:
            self._board.send(batch)

    def _poll(self) -> BoardStatus:
        """Read the status, log it, and end the playback at a fault or a deviation beyond tolerance."""
        before_s = self._polled_s
        status, self._polled_s = self._board.status(), self._board.clock.now()
        self._motion_us += signed_us(status.motion_us - self._motion_us)
        while len(self._phases) > 1 and self._motion_us > self._phases[1][0]:
            self._phases.popleft()
        commanded, measured = self._record(status, self._phases[0][1])
        if status.fault is not Fault.NONE:
            reason = status.fault.describe(status.joint, self._joints.names)
            away_s = self._polled_s - before_s
            if status.fault in (Fault.SILENCE, Fault.UNDERRUN, Fault.LATE) and away_s > _AWAY_S:
                reason += f"; the program, or its link, stood still for {away_s:.2f} s: close other programs"
            raise EndedEarly(_FAULT_RESULTS.get(status.fault, PlayResult.ABORTED), f"the board stopped: {reason}")
        deviation = self._deviation(measured, commanded)
        if deviation.max() > self._tolerances.path:
            j = int(np.argmax(deviation))
            self._board.stop()
            raise EndedEarly(
                PlayResult.PATH_TOLERANCE,
                f"{self._joints.names[j]} is {math.degrees(deviation[j]):.1f}° from its command, more than "
                f"{math.degrees(self._tolerances.path):.1f}°; is it blocked, overloaded or without power?",
            )
        return status

    def _deviation(self, measured: np.ndarray, commanded: np.ndarray) -> np.ndarray:
        """Return each joint's distance [rad] from the range of its commands over the possible age of a measurement."""
        now = self._board.clock.now()
        self._recent.append((now, commanded))
        while self._recent[0][0] < now - self._board.readback_s:
            self._recent.popleft()
        recent = np.array([row for _, row in self._recent])
        deviation = np.maximum(recent.min(0) - measured, measured - recent.max(0))
        return np.fmax(deviation, 0.0)  # also turns nan, a joint without read-back, to zero

    def _reach_goal(self, goal: np.ndarray) -> None:
        """Hold until every joint with read-back is at the goal."""
        end = self._board.clock.now() + self._tolerances.goal_time_s
        while True:
            _, measured = self._record(self._board.status(), "hold")
            deviation = np.fmax(np.abs(measured - goal), 0.0)  # also turns nan to zero
            if deviation.max() <= self._tolerances.goal:
                return
            if self._board.clock.now() >= end:
                j = int(np.argmax(deviation))
                raise EndedEarly(
                    PlayResult.GOAL_TOLERANCE,
                    f"{self._joints.names[j]} rests {math.degrees(deviation[j]):.1f}° from the goal after "
                    f"{self._tolerances.goal_time_s:g} s, more than {math.degrees(self._tolerances.goal):.1f}°",
                )
            self._board.clock.sleep(self._board.poll_s)

    def _record(self, status: BoardStatus, phase: str) -> tuple[np.ndarray, np.ndarray]:
        """Add a row to the log; return commanded and measured joint angles [rad]."""
        commanded, measured = self._joints.to_rad(status.commanded), self._joints.to_rad(status.measured)
        row = LogRow(self._board.clock.now() - self.began_s, phase, commanded, measured)
        self.recorder.add(row)
        self._watch(row)
        return commanded, measured
