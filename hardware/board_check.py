"""A look at a board before anything is played: who answers, at which voltage, and which joint moves which servo."""

import enum
import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hardware.board import Board, Fault
from hardware.boards.servo_reading import ReportsServos, ServoReading
from hardware.errors import BoardError, HardwareError, LinkError
from hardware.joint_map import JointCalibration, JointMap

if TYPE_CHECKING:
    from typing import Self

_WIGGLE = math.radians(4)  # seen by eye, and several steps of every servo
_WIGGLE_RATE = math.radians(10)
_MOVED = 0.4  # of the wiggle: less is a joint that stands still
_PAUSE_S, _LOOK_S = 0.4, 1.0
_LONGEST_S = 10.0


class CheckStatus(enum.IntEnum):
    """Outcome of a check."""

    OK = 0
    PROBLEMS = 1

    @property
    def message(self) -> str:
        """One sentence: what it means and what to do."""
        return _MESSAGES[self]


_MESSAGES = {
    CheckStatus.OK: "everything that can be asked is as it should be",
    CheckStatus.PROBLEMS: "something is not as it should be; see the problems, and check again",
}


@dataclass(frozen=True)
class JointCheck:
    """State of a joint's servo.

    Attributes:
        name: Name of the joint.
        channel: Channel of its servo.
        answers: True if the servo answers; None if it reports nothing.
        angle: Joint angle [rad]; nan if unknown.
        reading: State of the servo, from boards that can ask for it.
        moved: Angle by which it moved when it was wiggled [rad]; nan if it was not, or reports nothing.
    """

    name: str
    channel: str
    answers: bool | None
    angle: float
    reading: ServoReading | None
    moved: float


@dataclass(frozen=True)
class CheckResult:
    """Result of :func:`check`.

    Attributes:
        board: Name of the board.
        supply_v: Supply voltage, the lowest of those measured [V]; nan if none is.
        joints: One entry per joint.
        problems: One sentence per thing that is not as it should be.
    """

    board: str
    supply_v: float
    joints: tuple[JointCheck, ...]
    problems: tuple[str, ...]

    @property
    def status(self) -> CheckStatus:
        """Outcome of the check."""
        return CheckStatus.PROBLEMS if self.problems else CheckStatus.OK

    @property
    def ok(self) -> bool:
        """True if there is no problem."""
        return not self.problems

    def raise_if_invalid(self) -> "Self":
        """Return the result itself, so that calls chain.

        Raises:
            BoardError: There are problems; with all of them.
        """
        if not self.ok:
            raise BoardError(f"{self.board}: {'; '.join(self.problems)}")
        return self


def check(
    board: Board, joints: JointMap, *, wiggle: Collection[str] = (), say: Callable[[str], None] = lambda line: None
) -> CheckResult:
    """Ask a board and its servos for their state, and wiggle joints on request, one after the other.

    A wiggle goes 4 degrees away and back at 10 degrees per second, within the limits, so that swapped channels are
    seen. Without one nothing is driven.

    Args:
        board: A board from :func:`hardware.connect`.
        joints: Calibration of the robot.
        wiggle: Names of the joints to wiggle.
        say: Function that shows a line, before every motion.

    Returns:
        The state of every joint, and the problems.

    Raises:
        CalibrationError: The calibration lacks a joint to wiggle, or the board cannot take it.
    """
    joints.select(list(wiggle))
    problems: list[str] = []
    supply_v, raw = math.nan, np.full(len(joints.joints), math.nan)
    slow = JointMap(joints.robot, tuple(replace(j, max_rate=min(j.max_rate, _WIGGLE_RATE)) for j in joints.joints))
    try:
        board.configure(slow)
        status = board.status()
        supply_v, raw = status.supply_v, status.measured
    except HardwareError as error:
        problems.append(str(error))
    readings = _readings(board, problems)
    answers = [_answers(joint, raw[j], readings.get(j)) for j, joint in enumerate(joints.joints)]
    raw = np.array([readings[j].position if j in readings else x for j, x in enumerate(raw)], float)
    angles = joints.to_rad(raw)
    if not problems:
        problems += [
            f"{joint.name} ({joint.channel}) does not answer; is its plug in, and is the supply on?"
            for joint, there in zip(joints.joints, answers, strict=True)
            if there is False
        ]
        problems += _outside(joints, angles)
    moved = np.full(len(joints.joints), math.nan)
    if wiggle and not problems:
        try:
            moved = _wiggle_all(board, joints, [joints.names.index(name) for name in wiggle], say, problems)
        except HardwareError as error:
            problems.append(str(error))
    volts = [reading.voltage_v for reading in readings.values()]
    return CheckResult(
        board=board.name,
        supply_v=min(volts, default=supply_v),
        joints=tuple(
            JointCheck(joint.name, joint.channel, answers[j], float(angles[j]), readings.get(j), float(moved[j]))
            for j, joint in enumerate(joints.joints)
        ),
        problems=tuple(problems),
    )


def _readings(board: Board, problems: list[str]) -> dict[int, ServoReading]:
    """Return what the servos tell of themselves, if the board can ask them."""
    try:
        return board.readings() if isinstance(board, ReportsServos) else {}
    except HardwareError as error:
        problems.append(str(error))
        return {}


def _answers(joint: JointCalibration, raw: float, reading: ServoReading | None) -> bool | None:
    return (reading is not None or not math.isnan(raw)) if joint.readback else None


def _outside(joints: JointMap, angles: np.ndarray) -> list[str]:
    """Return one sentence per joint that stands far outside its limits."""
    return [
        f"{joint.name} stands at {math.degrees(q):.1f}°, outside its range {math.degrees(joint.lower):.1f}° to "
        f"{math.degrees(joint.upper):.1f}°; move it inside by hand, or calibrate it"
        for joint, q in zip(joints.joints, angles, strict=True)
        if max(joint.lower - q, q - joint.upper) > _WIGGLE
    ]


def _wiggle_all(
    board: Board, joints: JointMap, places: list[int], say: Callable[[str], None], problems: list[str]
) -> np.ndarray:
    """Wiggle joints and return by how much each moved [rad]; the servos are released at the end, whatever happens."""
    moved = np.full(len(joints.joints), math.nan)
    silent = [joint.name for joint in joints.joints if not joint.readback]
    if silent:
        say(f"keep clear: {', '.join(silent)} report no position and go to their safe pose at once")
        board.clock.sleep(_LOOK_S)
    try:
        board.enable()
        start = board.status().commanded.copy()
        _go(board, start)
        start = board.status().commanded.copy()  # joints that stood a little outside are inside now
        for j in places:
            joint = joints.joints[j]
            say(f"{joint.name} ({joint.channel}) moves by {math.degrees(_WIGGLE):.0f}° and back: is it this one?")
            board.clock.sleep(_LOOK_S)
            steps = _wiggle(board, start, j, joint)
            by = np.abs(steps) / joints.column("raw_per_rad")
            moved[j] = by[j]
            problems += _misled(joints, j, by)
        _go(board, start)
    finally:
        _let_go(board, problems)
    return moved


def _wiggle(board: Board, start: np.ndarray, j: int, joint: JointCalibration) -> np.ndarray:
    """Move a joint away and back; return by how many raw steps each joint's servo moved, nan without read-back."""
    low, high = joint.raw_limits()
    away = min(joint.raw_per_rad * _WIGGLE, (high - low) / 2)
    there = start.copy()
    there[j] = np.rint(start[j] + (away if start[j] + away <= high else -away))
    before = board.status().measured
    _go(board, there)
    after = board.status().measured
    _go(board, start)
    return after - before


def _misled(joints: JointMap, j: int, by: np.ndarray) -> list[str]:
    """Return what is wrong if the joint stood still, or another one moved."""
    name = joints.names[j]
    if math.isnan(by[j]) or by[j] > _MOVED * _WIGGLE:
        return []
    others = [joints.names[i] for i in np.flatnonzero(by > _MOVED * _WIGGLE)]
    if others:
        return [f"{others[0]} moved in the place of {name}; are their channels swapped?"]
    return [f"{name} did not move; is it blocked, or is another servo at its channel?"]


def _go(board: Board, raw: np.ndarray) -> None:
    """Move to a posture and wait until it is reached."""
    board.move([round(value) for value in raw])
    end = board.clock.now() + _LONGEST_S
    while True:
        status = board.status()
        if status.fault is not Fault.NONE:
            raise BoardError(f"the board stopped: {status.fault.message}")
        if np.abs(status.commanded - np.rint(raw)).max() <= 0.5:
            break
        if board.clock.now() > end:
            raise BoardError(f"{board.name} did not get to a posture 4° away within {_LONGEST_S:.0f} s")
        board.clock.sleep(board.poll_s)
    end = board.clock.now() + max(_PAUSE_S, 2 * board.readback_s)
    while board.clock.now() < end:
        board.status()
        board.clock.sleep(board.poll_s)


def _let_go(board: Board, problems: list[str]) -> None:
    try:
        board.stop()
        board.release()
    except LinkError as error:
        problems.append(f"the servos could not be released: {error}")
