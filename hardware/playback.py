"""One playback: phases, tolerances and log."""

import math
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from hardware import schedule
from hardware.board import Board, BoardStatus, Fault, State, Waypoint
from hardware.errors import BoardError, LinkError
from hardware.joint_map import JointMap
from hardware.report import PlayLog, PlayResult
from jaxik.trajectories import Trajectory

_RAW_TOLERANCE = 1.0  # raw steps: a measurement may be off by rounding
_MOVE_IN_S = 3.0
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
        progress: Function that is called with the fraction done, 0 to 1.

    Attributes:
        began_s: Time of the clock at the begin [s].
        warnings: Things to know, one sentence each.
    """

    def __init__(
        self, board: Board, joints: JointMap, tolerances: Tolerances, progress: Callable[[float], None]
    ) -> None:
        self.began_s = board.clock.now()
        self.warnings: list[str] = []
        self._board, self._joints, self._tolerances, self._progress = board, joints, tolerances, progress
        self._rows: list[tuple[float, str, np.ndarray, np.ndarray]] = []
        self._recent: deque[tuple[float, np.ndarray]] = deque()

    def run(self, trajectory: Trajectory, speed: float, park: bool) -> None:
        """Run through all phases.

        Args:
            trajectory: Motion to play.
            speed: Time scale.
            park: True to ease out to the safe pose in the end.

        Raises:
            EndedEarly: The playback did not succeed.
            BoardError: The board refuses.
            LinkError: The board stopped answering.
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
        self._board.enable()
        ease_in = schedule.ease(self._move_inside(present), first, self._joints)
        body = schedule.frames(trajectory, speed)
        self._move([ease_in, body], ("ease in", "play"), round(1e6 * float(ease_in[0][-1])), (0.0, 0.9))
        self._reach_goal(last)
        if park:
            ease_out = schedule.ease(last, self._joints.column("safe"), self._joints)
            self._move([ease_out], ("ease out", "ease out"), 0, (0.9, 1.0))
        self._progress(1.0)

    def release(self) -> None:
        """Stop and release the servos; over a dead link that fails, and the board then releases by itself."""
        try:
            self._board.stop()
            self._board.release()
        except LinkError as error:
            self.warnings.append(f"the servos could not be released: {error}")

    def log(self) -> PlayLog:
        """Return the log so far."""
        joints = len(self._joints.names)
        times, phases, commanded, measured = zip(*self._rows, strict=True) if self._rows else ((), (), (), ())
        return PlayLog(
            np.array(times, float),
            tuple(phases),
            np.array(commanded, float).reshape(-1, joints),
            np.array(measured, float).reshape(-1, joints),
            self._joints.names,
        )

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

    def _move(
        self,
        pieces: list[tuple[np.ndarray, np.ndarray]],
        phases: tuple[str, str],
        boundary_us: int,
        fractions: tuple[float, float],
    ) -> None:
        """Stream one motion and wait for its end.

        Args:
            pieces: Times [s] and postures [rad] of motions that follow one another.
            phases: Names of the phases before and after the boundary.
            boundary_us: Motion time at which the second phase begins [µs].
            fractions: Progress at the start and at the end of this motion.
        """
        points = schedule.waypoints(pieces, self._joints)
        self._board.stop()  # clears the previous motion
        sent = self._feed(points, 0)
        try:
            self._board.start(_LEAD_US)
        except BoardError:
            self._poll(phases, boundary_us)  # if the reason is a fault, it is the result
            raise
        while True:
            polled_s = self._board.clock.now()
            status = self._poll(phases, boundary_us)
            if status.done and status.state is State.HOLDING:
                return
            sent = self._feed(points, sent, status)
            done = min(max(status.motion_us, 0) / max(points[-1].time_us, 1), 1.0)
            self._progress(fractions[0] + (fractions[1] - fractions[0]) * done)
            self._board.clock.sleep(max(0.0, polled_s + self._board.poll_s - self._board.clock.now()))

    def _feed(self, points: list[Waypoint], sent: int, status: BoardStatus | None = None) -> int:
        """Fill the board's queue; return the number of waypoints sent so far."""
        free = (status or self._board.status()).free
        batch = points[sent : sent + free]
        if batch:
            self._board.send(batch)
        return sent + len(batch)

    def _poll(self, phases: tuple[str, str], boundary_us: int) -> BoardStatus:
        """Read the status, log it, and end the playback at a fault or a deviation beyond tolerance."""
        status = self._board.status()
        phase = phases[status.motion_us > boundary_us]
        commanded, measured = self._record(status, phase)
        if status.fault is not Fault.NONE:
            reason = status.fault.describe(status.joint, self._joints.names)
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
        self._rows.append((self._board.clock.now() - self.began_s, phase, commanded, measured))
        return commanded, measured
