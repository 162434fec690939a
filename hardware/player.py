"""Plays a trajectory on a board.

1. Check the whole trajectory: joints, limits, rates. Nothing moves if anything is wrong.
2. Read the present posture; refuse if it is too far, else ease in on a minimum-jerk curve.
3. Play: keep the board's queue filled, log, watch tolerances.
4. Hold until the goal is reached, ease out to the safe pose, and release, whatever happened before.
"""

import math
import os
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from hardware import schedule
from hardware.device import Device, DeviceStatus, Fault, State, Waypoint
from hardware.errors import BoardError, LinkError
from hardware.joint_map import JointMap, ideal_joint_map, load_joint_map
from hardware.report import PlayLog, PlayReport, PlayResult, tracking
from jaxik.trajectories import Trajectory

_STEPS = 1.0  # raw steps that a measurement may be off by rounding
_MOVE_IN_S = 3.0
_LEAD_US = 100_000  # from the start command to the first waypoint
_FAULTS = {
    Fault.LATE: PlayResult.UNDERRUN,
    Fault.UNDERRUN: PlayResult.UNDERRUN,
    Fault.SILENCE: PlayResult.LINK_LOST,
    Fault.LENGTH: PlayResult.LINK_LOST,
    Fault.SERVO: PlayResult.LINK_LOST,
    Fault.RANGE: PlayResult.LIMIT,
    Fault.RATE: PlayResult.LIMIT,
}  # any other fault: ABORTED


class Tolerances(NamedTuple):
    """When a playback has failed; only joints that report where they are count.

    Attributes:
        path: Farthest a joint may be from its command [rad]; 20 degrees, three times what a hobby servo's lag makes.
        goal: Farthest it may rest from the goal [rad]; three steps of a Meccano servo.
        goal_time_s: Time to settle [s].
        ease: Farthest the arm may stand from the first posture [rad].
    """

    path: float = math.radians(20)
    goal: float = math.radians(3)
    goal_time_s: float = 1.0
    ease: float = math.pi


DEFAULT_TOLERANCES = Tolerances()


class _Ended(Exception):
    """The playback ended early."""

    def __init__(self, result: PlayResult, message: str) -> None:
        super().__init__(message)
        self.result = result


def play(
    trajectory: Trajectory,
    robot: Device,
    calibration: JointMap | str | os.PathLike[str] | None = None,
    *,
    speed: float = 1.0,
    tolerances: Tolerances = DEFAULT_TOLERANCES,
    park: bool = True,
    progress: Callable[[float], None] | None = None,
) -> PlayReport:
    """Plays a trajectory and reports how it went.

    Ctrl-C stops the arm within a servo frame and ends the playback with ABORTED.

    Args:
        trajectory: What to play; joints are matched to the calibration by name.
        robot: A board from :func:`hardware.connect`.
        calibration: A :class:`hardware.JointMap`, its TOML file, or None for ideal servos.
        speed: Time scale: 0.5 plays at half speed.
        tolerances: When the playback has failed.
        park: Whether to ease to the calibration's safe pose after a success.
        progress: Called with the share done, 0 to 1.

    Returns:
        The report; its result says how it ended. A trajectory that the calibration forbids moves nothing: LIMIT.

    Raises:
        CalibrationError: The calibration is none, or lacks a joint.
        BoardError: The board refuses.
        ValueError: Speed is not a positive number.
    """
    if not (speed > 0 and math.isfinite(speed)):
        raise ValueError(f"speed needs to be a number above 0; got {speed!r}")
    joints = _joint_map(calibration, trajectory)
    run = _Run(robot, joints, tolerances, progress or (lambda share: None))
    try:
        run.all(trajectory, speed, park)
        result, message = PlayResult.SUCCESS, PlayResult.SUCCESS.value
    except _Ended as end:
        result, message = end.result, str(end)
    except LinkError as error:
        result, message = PlayResult.LINK_LOST, str(error)
    except KeyboardInterrupt:
        result, message = PlayResult.ABORTED, "stopped on request"
    finally:
        run.release()
    log = run.log()
    return PlayReport(
        result, message, log, tracking(log), robot.name, speed, robot.clock.now() - run.began, tuple(run.warnings)
    )


def _joint_map(calibration: JointMap | str | os.PathLike[str] | None, trajectory: Trajectory) -> JointMap:
    """The trajectory's joints with their servos."""
    if calibration is None:
        return ideal_joint_map(trajectory.joint_names)
    whole = calibration if isinstance(calibration, JointMap) else load_joint_map(calibration)
    return whole.select(trajectory.joint_names)


class _Run:
    """One playback: the board, the log, and what to watch."""

    def __init__(self, robot: Device, joints: JointMap, limits: Tolerances, progress: Callable[[float], None]) -> None:
        self.robot, self.joints, self.limits, self.progress = robot, joints, limits, progress
        self.began = robot.clock.now()
        self.warnings: list[str] = []
        self._rows: list[tuple[float, str, np.ndarray, np.ndarray]] = []
        self._recent: deque[tuple[float, np.ndarray]] = deque()

    def all(self, trajectory: Trajectory, speed: float, park: bool) -> None:
        """The phases in order; an early end is an exception."""
        found = schedule.problems(trajectory, self.joints, speed)
        if found:
            more = f"; and {len(found) - 1} more" if len(found) > 1 else ""
            raise _Ended(PlayResult.LIMIT, found[0] + more)
        echoed = self.robot.configure(self.joints)
        if echoed != self.joints.crc:
            raise BoardError(
                f"the board holds another calibration: its CRC is {echoed:04x}, ours {self.joints.crc:04x}"
            )
        present = self._present()
        first = trajectory.q[0]
        far = np.abs(first - present)
        if far.max() > self.limits.ease:
            j = int(np.argmax(far))
            raise _Ended(
                PlayResult.LIMIT,
                f"{self.joints.names[j]} stands {math.degrees(far[j]):.0f}° from the first posture, more than the "
                f"{math.degrees(self.limits.ease):.0f}° it may ease in; move the arm nearer and play again",
            )
        self.robot.enable()
        present = self._brought_inside(present)
        ease_in = schedule.ease(present, first, self.joints)
        body = schedule.frames(trajectory, speed)
        self._motion([ease_in, body], ("ease in", "play"), round(1e6 * float(ease_in[0][-1])), (0.0, 0.9))
        self._settle(trajectory.q[-1])
        if park:
            ease_out = schedule.ease(trajectory.q[-1], self.joints.column("safe"), self.joints)
            self._motion([ease_out], ("ease out", "ease out"), 0, (0.9, 1.0))
        self.progress(1.0)

    def _about(self, status: DeviceStatus) -> str:
        """A fault in words, with the joint it is about."""
        fault, names = status.fault, self.joints.names
        about = fault in (Fault.RANGE, Fault.RATE, Fault.SERVO) and status.joint < len(names)
        return f"{names[status.joint]}: {fault.value}" if about else fault.value

    def _present(self) -> np.ndarray:
        """Where the joints are; for servos that do not say, where the board left them, or will put them first."""
        status = self.robot.status()
        measured = self.joints.to_rad(status.measured)
        silent = np.isnan(measured)
        if silent.any():
            names = ", ".join(name for name, s in zip(self.joints.names, silent, strict=True) if s)
            self.warnings.append(
                f"no read-back from {names}: taken to stand where last commanded, tolerances not checked"
            )
        return np.where(silent, self.joints.to_rad(status.commanded), measured)

    def _brought_inside(self, present: np.ndarray) -> np.ndarray:
        """Where the joints are once the board has moved those that stood outside their limits to them, and noted so."""
        inside = np.clip(present, self.joints.column("lower"), self.joints.column("upper"))
        outside = np.flatnonzero(np.abs(inside - present) * self.joints.column("raw_per_rad") > _STEPS)
        for j in outside:
            self.warnings.append(
                f"{self.joints.names[j]} stood at {math.degrees(present[j]):.1f}°, outside its range: moved to "
                f"{math.degrees(inside[j]):.1f}° first"
            )
        end = self.robot.clock.now() + _MOVE_IN_S
        while len(outside) and self.robot.clock.now() < end:
            commanded, _ = self._record(self.robot.status(), "ease in")
            if (np.abs(commanded - inside)[outside] * self.joints.column("raw_per_rad")[outside] <= _STEPS).all():
                break
            self.robot.clock.sleep(self.robot.poll_s)
        return inside

    def _motion(
        self,
        pieces: list[tuple[np.ndarray, np.ndarray]],
        phases: tuple[str, str],
        boundary_us: int,
        shares: tuple[float, float],
    ) -> None:
        """Streams one motion and waits for its end."""
        points = schedule.waypoints(pieces, self.joints)
        self.robot.stop()  # forgets a motion before this one
        sent = self._feed(points, 0)
        try:
            self.robot.start(_LEAD_US)
        except BoardError:
            self._look(phases, boundary_us)  # a fault says more, and is a result
            raise
        while True:
            polled = self.robot.clock.now()
            status = self._look(phases, boundary_us)
            if status.done and status.state is State.HOLDING:
                return
            sent = self._feed(points, sent, status)
            done = min(max(status.motion_us, 0) / max(points[-1].time_us, 1), 1.0)
            self.progress(shares[0] + (shares[1] - shares[0]) * done)
            self.robot.clock.sleep(max(0.0, polled + self.robot.poll_s - self.robot.clock.now()))

    def _feed(self, points: list[Waypoint], sent: int, status: DeviceStatus | None = None) -> int:
        """Fills the board's queue; returns how many have been sent in all."""
        free = (status or self.robot.status()).free
        batch = points[sent : sent + free]
        if batch:
            self.robot.send(batch)
        return sent + len(batch)

    def _look(self, phases: tuple[str, str], boundary_us: int) -> DeviceStatus:
        """Reads the board, logs, and ends the playback at a fault or a joint astray."""
        status = self.robot.status()
        phase = phases[status.motion_us > boundary_us]
        commanded, measured = self._record(status, phase)
        if status.fault is not Fault.NONE:
            raise _Ended(_FAULTS.get(status.fault, PlayResult.ABORTED), f"the board stopped: {self._about(status)}")
        astray = self._astray(measured, commanded)
        if astray.max() > self.limits.path:
            j = int(np.argmax(astray))
            self.robot.stop()
            raise _Ended(
                PlayResult.PATH_TOLERANCE,
                f"{self.joints.names[j]} is {math.degrees(astray[j]):.1f}° from its command, more than "
                f"{math.degrees(self.limits.path):.1f}°; is it blocked, overloaded or without power?",
            )
        return status

    def _astray(self, measured: np.ndarray, commanded: np.ndarray) -> np.ndarray:
        """How far joints are from where they were told to be in the time their measurements may be from."""
        now = self.robot.clock.now()
        self._recent.append((now, commanded))
        while self._recent[0][0] < now - self.robot.readback_s:
            self._recent.popleft()
        told = np.array([row for _, row in self._recent])
        away = np.maximum(told.min(0) - measured, measured - told.max(0))
        return np.fmax(away, 0.0)  # what is not measured, nan, is not astray

    def _settle(self, goal: np.ndarray) -> None:
        """Holds until every joint that reports is at the goal."""
        end = self.robot.clock.now() + self.limits.goal_time_s
        while True:
            _, measured = self._record(self.robot.status(), "hold")
            off = np.fmax(np.abs(measured - goal), 0.0)  # nan where not measured
            if off.max() <= self.limits.goal:
                return
            if self.robot.clock.now() >= end:
                j = int(np.argmax(off))
                raise _Ended(
                    PlayResult.GOAL_TOLERANCE,
                    f"{self.joints.names[j]} rests {math.degrees(off[j]):.1f}° from the goal after "
                    f"{self.limits.goal_time_s:g} s, more than {math.degrees(self.limits.goal):.1f}°",
                )
            self.robot.clock.sleep(self.robot.poll_s)

    def _record(self, status: DeviceStatus, phase: str) -> tuple[np.ndarray, np.ndarray]:
        """Adds a row to the log."""
        commanded, measured = self.joints.to_rad(status.commanded), self.joints.to_rad(status.measured)
        self._rows.append((self.robot.clock.now() - self.began, phase, commanded, measured))
        return commanded, measured

    def release(self) -> None:
        """Lets go of the servos; a dead link cannot be told, and the board then lets go by itself."""
        try:
            self.robot.stop()
            self.robot.release()
        except LinkError as error:
            self.warnings.append(f"the servos could not be released: {error}")

    def log(self) -> PlayLog:
        """The log so far."""
        joints = len(self.joints.names)
        times, phases, commanded, measured = zip(*self._rows, strict=True) if self._rows else ((), (), (), ())
        return PlayLog(
            np.array(times, float),
            tuple(phases),
            np.array(commanded, float).reshape(-1, joints),
            np.array(measured, float).reshape(-1, joints),
            self.joints.names,
        )
