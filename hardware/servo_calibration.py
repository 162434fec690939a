"""Guided calibration of servos: joint by joint, move it, say where it stands, set its limits.

Questions and answers go through two functions, so that the same dialogue runs in a terminal and in a test. What has
been measured is handed over after every answer, so that nothing is lost however the dialogue ends.
"""

import enum
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import numpy as np

from hardware.board import Board, BoardStatus, Fault
from hardware.errors import BoardError, CalibrationError
from hardware.joint_map import JointCalibration, JointMap
from hardware.measured_joint import PLACES, consistent, fitted, opposite, referred, reversed_joint, whole_range
from hardware.terminal_question import ask_in_terminal

if TYPE_CHECKING:
    from typing import Self

_HELP = """\
  120      go to raw value 120            +5, -5   go up, down by 5
  n        zero degrees is here           a 90     90 degrees are here: two angles give scale and sign
  l, u     lower, upper limit is here     s        reverse the sign
  r        safe pose is here              t        go limp, to be moved by hand; t again to hold
  ok       next joint                     quit     end; what was measured is kept"""

Ask = Callable[[str], str]
Say = Callable[[str], None]
Keep = Callable[[JointMap], None]


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
    CalibrationStatus.ENDED_EARLY: "ended before the last joint; what was measured is kept, calibrate the others",
}


@dataclass(frozen=True)
class ServoCalibrationResult:
    """Result of :func:`calibrate_servos`.

    Attributes:
        status: Outcome.
        joints: Calibration of every joint; joints that were not reached are as in the template, and the last one has
            what was measured of it.
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
    board: Board,
    template: JointMap,
    *,
    ask: Ask | None = None,
    say: Say = print,
    keep: Keep = lambda joints: None,
    practice: bool | None = None,
) -> ServoCalibrationResult:
    """Calibrate servos in a dialogue about every joint; the servos are released at the end, whatever happens.

    Ctrl-C ends the dialogue as ``quit`` does, and nothing measured is lost.

    Args:
        board: A board from :func:`hardware.connect`.
        template: Calibration to start from: names, channels, raw ranges, and first guesses of the numbers.
        ask: Function that shows a prompt and returns a line; None for the terminal.
        say: Function that shows a line.
        keep: Function that takes the calibration after every answer that changed it, such as one that saves it.
        practice: True to leave the numbers marked as estimates; None for True on a simulated board only.

    Returns:
        The calibration so found; save it with :func:`hardware.save_joint_map`.

    Raises:
        BoardError: The board refuses.
        LinkError: The board stopped answering.
    """
    practice = board.name == "simulated" if practice is None else practice
    return _Dialogue(board, template, ask_in_terminal(board) if ask is None else ask, say, keep, practice).run()


class _Dialogue:
    """The dialogue of one calibration."""

    def __init__(self, board: Board, template: JointMap, ask: Ask, say: Say, keep: Keep, practice: bool) -> None:
        self._board, self._template, self._ask, self._say, self._keep = board, template, ask, say, keep
        self._practice = practice
        self._joints = list(template.joints)
        self._raw = np.zeros(0)
        self._limp = False
        self._angles: list[tuple[float, float]] = []
        self._marked: set[str] = set()  # places that were measured, now or earlier

    def run(self) -> ServoCalibrationResult:
        """See :func:`calibrate_servos`."""
        count, done = len(self._joints), 0
        try:
            self._board.configure(JointMap(self._template.robot, tuple(map(whole_range, self._joints))))
            self._board.enable()
            self._raw = self._board.status().commanded.copy()
            self._say(_HELP)
            while done < count and self._joint(done):
                done += 1
        except KeyboardInterrupt:
            self._say("")
        finally:
            try:
                self._board.stop()
            finally:
                self._board.release()
        status = CalibrationStatus.OK if done == count else CalibrationStatus.ENDED_EARLY
        return ServoCalibrationResult(status, self._valid(), self._template.names[:done])

    def _valid(self) -> JointMap:
        """Return the calibration with all that was measured and is in itself consistent."""
        return JointMap(self._template.robot, tuple(map(consistent, self._joints, self._template.joints)))

    def _joint(self, j: int) -> bool:
        """Calibrate one joint; return False to end the dialogue."""
        self._angles, self._limp = [], False
        self._marked = {name for name in PLACES if getattr(self._joints[j].measured, name)}
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
                    if joint.estimates() and not self._practice:
                        self._say(f"  {joint.name}: still estimates: {', '.join(joint.estimates())}")
                    return True
                self._say(f"  not yet: {found[0]}")
            elif words:
                try:
                    self._do(j, self._position(j), words)  # read again: a hand may have moved the joint meanwhile
                except (CalibrationError, ValueError) as error:
                    self._say(f"  {error}")
                if self._joints[j] != joint:
                    self._hand_over()

    def _hand_over(self) -> None:
        """Hand over what has been measured so far; a full disk does not end the dialogue."""
        try:
            self._keep(self._valid())
        except OSError as error:
            self._say(f"  not saved: {error}; the next answer tries again")

    def _do(self, j: int, at: float, words: list[str]) -> None:
        """Execute one command about a joint that is at a raw position."""
        joint = self._joints[j]
        angle = joint.sign * (at - joint.neutral) / joint.raw_per_rad
        match words:
            case ["n"]:
                self._angles = [(at, 0.0)]
                self._refer(j, replace(joint, neutral=at), "zero")
            case ["a", degrees]:
                self._angles.append((at, math.radians(_number(degrees))))
                measured = ("zero", "scale") if len(self._angles) > 1 else ("zero",)
                self._refer(j, fitted(joint, self._angles), *measured)
            case ["l"]:
                self._place(j, "lower", angle)
            case ["u"]:
                self._place(j, "upper", angle)
            case ["r"]:
                self._place(j, "safe", angle)
            case ["s"]:
                self._joints[j] = reversed_joint(joint)
                self._marked = opposite(self._marked)
            case ["t"]:
                self._toggle_limp(j)
            case [number]:
                wanted = _number(number) + (self._raw[j] if number[0] in "+-" else 0)
                if not joint.raw_low <= wanted <= joint.raw_high:
                    raise ValueError(f"{joint.name} takes raw {joint.raw_low} to {joint.raw_high}; got {wanted:g}")
                self._go(j, wanted)
            case _:
                raise ValueError(f"no such command: {' '.join(words)}; the commands are\n{_HELP}")

    def _refer(self, j: int, new: JointCalibration, *measured: str) -> None:
        """Take another zero, scale or sign; places that were measured stay where they are."""
        old = self._joints[j]
        if new.sign != old.sign:
            old = reversed_joint(old)
            new = replace(new, measured=old.measured)
            self._marked = opposite(self._marked)
        self._joints[j] = self._stamped(referred(old, new, self._marked), *measured)

    def _place(self, j: int, name: str, angle: float) -> None:
        """Note that a joint is at its lower or upper limit, or in its safe pose."""
        self._marked.add(name)
        self._joints[j] = self._stamped(replace(self._joints[j], **{name: angle}), name)

    def _stamped(self, joint: JointCalibration, *names: str) -> JointCalibration:
        """Return the joint with some of its numbers marked as measured now, or as estimates in practice."""
        now = None if self._practice else datetime.now(UTC).replace(microsecond=0)
        return replace(joint, measured=replace(joint.measured, **dict.fromkeys(names, now)))

    def _go(self, j: int, wanted: float) -> None:
        """Move a joint and wait until its command is there."""
        if self._limp:
            raise ValueError("the joint is limp; t makes it hold first")
        self._raw[j] = wanted
        self._board.move([round(raw) for raw in self._raw])
        while abs(self._status().commanded[j] - round(wanted)) > 0.5:
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
        status = self._status()
        return float(status.measured[j] if self._limp else status.commanded[j])

    def _status(self) -> BoardStatus:
        """Return the status; a board with a fault moves nothing any more."""
        status = self._board.status()
        if status.fault is not Fault.NONE:
            reason = status.fault.describe(status.joint, self._template.names)
            raise BoardError(f"the board stopped while calibrating: {reason}; what was measured is kept")
        return status


def _number(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"{text!r} is neither a number nor a command; the commands are\n{_HELP}")
    return number
