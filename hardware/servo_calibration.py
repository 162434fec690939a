"""Guided calibration of servos: joint by joint, move it, say where it stands, set its limits.

Questions and answers go through two functions, so that the same dialogue runs in a terminal and in a test.
"""

import enum
import math
import queue
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hardware.board import Board
from hardware.errors import CalibrationError
from hardware.joint_map import JointCalibration, JointMap

if TYPE_CHECKING:
    from typing import Self

_JOG_RATE = math.radians(30)  # slow enough to let go of a key in time
_KEEP_ALIVE_S = 0.1  # a board that hears nothing for two seconds releases the arm
_HELP = """\
  120      go to raw value 120            +5, -5   go up, down by 5
  n        zero degrees is here           a 90     90 degrees are here: two angles give scale and sign
  l, u     lower, upper limit is here     s        reverse the sign
  r        safe pose is here              t        go limp, to be moved by hand; t again to hold
  ok       next joint                     quit     end without writing"""

Ask = Callable[[str], str]
Say = Callable[[str], None]


class CalibrationStatus(enum.IntEnum):
    """Outcome of a guided calibration."""

    OK = 0
    ENDED_EARLY = 1

    @property
    def message(self) -> str:
        """One sentence: what it means and what to do."""
        return _MESSAGES[self]


_MESSAGES = {
    CalibrationStatus.OK: "every joint is calibrated",
    CalibrationStatus.ENDED_EARLY: "ended before the last joint; calibrate the others, or select those that are done",
}


@dataclass(frozen=True)
class ServoCalibrationResult:
    """Result of :func:`calibrate_servos`.

    Attributes:
        status: Outcome.
        joints: Calibration of every joint; joints that were not reached are as in the template.
        calibrated: Names of the joints that were calibrated, in order.
    """

    status: CalibrationStatus
    joints: JointMap
    calibrated: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """True if every joint is calibrated."""
        return self.status is CalibrationStatus.OK

    def raise_if_invalid(self) -> "Self":
        """Return the result itself, so that calls chain.

        Raises:
            CalibrationError: The dialogue ended early; with how far it came.
        """
        if not self.ok:
            raise CalibrationError(
                f"{len(self.calibrated)} of {len(self.joints.joints)} joints of {self.joints.robot!r} were calibrated: "
                f"{self.status.message}"
            )
        return self


def calibrate_servos(
    board: Board, template: JointMap, *, ask: Ask | None = None, say: Say = print
) -> ServoCalibrationResult:
    """Calibrate servos in a dialogue about every joint; the servos are released at the end, whatever happens.

    Args:
        board: A board from :func:`hardware.connect`.
        template: Calibration to start from: names, channels, raw ranges, and first guesses of the numbers.
        ask: Function that shows a prompt and returns a line; None for the terminal.
        say: Function that shows a line.

    Returns:
        The calibration so found; save it with :func:`hardware.save_joint_map`.

    Raises:
        BoardError: The board refuses.
        LinkError: The board stopped answering.
    """
    return _Dialogue(board, template, ask_in_terminal(board) if ask is None else ask, say).run()


class _Dialogue:
    """The dialogue of one calibration."""

    def __init__(self, board: Board, template: JointMap, ask: Ask, say: Say) -> None:
        self._board, self._template, self._ask, self._say = board, template, ask, say
        self._joints = list(template.joints)
        self._raw = np.zeros(0)
        self._limp = False
        self._angles: list[tuple[float, float]] = []

    def run(self) -> ServoCalibrationResult:
        """See :func:`calibrate_servos`."""
        count = len(self._joints)
        try:
            self._board.configure(JointMap(self._template.robot, tuple(map(_whole_range, self._joints))))
            self._board.enable()
            self._raw = self._board.status().commanded.copy()
            self._say(_HELP)
            done = next((j for j in range(count) if not self._joint(j)), count)
        finally:
            self._board.stop()
            self._board.release()
        joints = JointMap(self._template.robot, (*self._joints[:done], *self._template.joints[done:]))
        status = CalibrationStatus.OK if done == count else CalibrationStatus.ENDED_EARLY
        return ServoCalibrationResult(status, joints, joints.names[:done])

    def _joint(self, j: int) -> bool:
        """Calibrate one joint; return False to end the dialogue."""
        self._angles, self._limp = [], False
        while True:
            joint = self._joints[j]
            at = self._position(j)
            angle = math.degrees(joint.sign * (at - joint.neutral) / joint.raw_per_rad)
            words = self._ask(f"{joint.name} [{j + 1} of {len(self._joints)}] raw {at:.0f}, {angle:.1f}°> ").split()
            if words == ["quit"]:
                return False
            if words == ["ok"]:
                found = joint.problems()
                if not found:
                    if self._limp:
                        self._hold_all(j)
                    return True
                self._say(f"  not yet: {found[0]}")
            elif words:
                try:
                    self._do(j, self._position(j), words)  # read again: a hand may have moved the joint meanwhile
                except (CalibrationError, ValueError) as error:
                    self._say(f"  {error}")

    def _do(self, j: int, at: float, words: list[str]) -> None:
        """Execute one command about a joint that is at a raw position."""
        joint = self._joints[j]
        angle = joint.sign * (at - joint.neutral) / joint.raw_per_rad
        match words:
            case ["n"]:
                self._angles = [(at, 0.0)]
                self._joints[j] = replace(joint, neutral=at)
            case ["a", degrees]:
                self._angles.append((at, math.radians(_number(degrees))))
                self._joints[j] = _fitted(joint, self._angles)
            case ["l"]:
                self._joints[j] = replace(joint, lower=angle)
            case ["u"]:
                self._joints[j] = replace(joint, upper=angle)
            case ["r"]:
                self._joints[j] = replace(joint, safe=angle)
            case ["s"]:
                self._joints[j] = replace(
                    joint, sign=-joint.sign, lower=-joint.upper, upper=-joint.lower, safe=-joint.safe
                )
            case ["t"]:
                self._toggle_limp(j)
            case [number]:
                wanted = _number(number) + (self._raw[j] if number[0] in "+-" else 0)
                if not joint.raw_low <= wanted <= joint.raw_high:
                    raise ValueError(f"{joint.name} takes raw {joint.raw_low} to {joint.raw_high}; got {wanted:g}")
                self._go(j, wanted)
            case _:
                raise ValueError(f"no such command: {' '.join(words)}; the commands are\n{_HELP}")

    def _go(self, j: int, wanted: float) -> None:
        """Move a joint and wait until its command is there."""
        if self._limp:
            raise ValueError("the joint is limp; t makes it hold first")
        self._raw[j] = wanted
        self._board.move([round(raw) for raw in self._raw])
        while abs(self._board.status().commanded[j] - round(wanted)) > 0.5:
            self._board.clock.sleep(self._board.poll_s)

    def _toggle_limp(self, j: int) -> None:
        if self._limp:
            self._hold_all(j)
        else:
            if not self._joints[j].readback:
                raise ValueError("the joint has no read-back: its position by hand is unknown; move it by raw values")
            self._board.limp([j])
            self._limp = True

    def _hold_all(self, j: int) -> None:
        self._board.limp([])
        self._limp = False
        self._raw = self._board.status().commanded.copy()

    def _position(self, j: int) -> float:
        """Return a joint's raw position: measured while limp, else commanded."""
        status = self._board.status()
        return float(status.measured[j] if self._limp else status.commanded[j])


def _number(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"{text!r} is neither a number nor a command; the commands are\n{_HELP}")
    return number


def _whole_range(joint: JointCalibration) -> JointCalibration:
    """Return a joint that may go slowly wherever its servo can: its limits are yet to be found."""
    ends = sorted(joint.sign * (raw - joint.neutral) / joint.raw_per_rad for raw in (joint.raw_low, joint.raw_high))
    safe = min(max(joint.safe, ends[0]), ends[1])
    return replace(joint, lower=ends[0], upper=ends[1], safe=safe, max_rate=min(joint.max_rate, _JOG_RATE))


def _fitted(joint: JointCalibration, angles: list[tuple[float, float]]) -> JointCalibration:
    """Return the joint with zero, scale and sign fitted to raw values at known angles; one angle fits only zero."""
    raw, angle = np.array(angles).T
    if len(angles) == 1:
        return replace(joint, neutral=float(raw[0] - joint.sign * joint.raw_per_rad * angle[0]))
    if np.ptp(raw) == 0 or np.ptp(angle) == 0:
        raise CalibrationError("two angles need two different positions")
    slope, neutral = np.polyfit(angle, raw, 1)
    return replace(joint, neutral=float(neutral), raw_per_rad=abs(float(slope)), sign=1 if slope > 0 else -1)


def ask_in_terminal(board: Board) -> Ask:
    """Return a function that reads a line from the terminal; meanwhile it polls the board, which would stop else."""
    lines: queue.Queue[str] = queue.Queue()
    wanted = threading.Semaphore(0)

    def read() -> None:
        while wanted.acquire():
            line = sys.stdin.readline()
            lines.put(line or "quit")

    threading.Thread(target=read, daemon=True).start()

    def ask(prompt: str) -> str:
        print(prompt, end="", flush=True)
        wanted.release()
        while True:
            try:
                return lines.get(timeout=_KEEP_ALIVE_S)
            except queue.Empty:
                board.status()

    return ask
