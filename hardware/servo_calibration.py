"""Guided calibration of servos: joint by joint, move it, say where it stands, set its limits.

What is asked and shown goes through two functions, so that the same dialogue runs in a terminal and in a test.
"""

import math
import queue
import sys
import threading
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hardware.device import Device
from hardware.errors import CalibrationError
from hardware.joint_map import JointCalibration, JointMap

_JOG_RATE = math.radians(30)  # slow enough to let go of a key in time
_ALIVE_S = 0.1  # a board that hears nothing for two seconds lets go of the arm
HELP = """\
  120      go to raw value 120            +5, -5   go on by so much
  n        zero degrees is here           a 90     90 degrees are here: two angles give scale and sign
  l, u     lower, upper limit is here     s        turn the sign round
  r        rest here (safe pose)          t        limp: move it by hand, t again to hold
  ok       next joint                     quit     end without writing"""

Ask = Callable[[str], str]
Say = Callable[[str], None]


class ServoCalibration:
    """A dialogue about every joint.

    Args:
        robot: A board from :func:`hardware.connect`.
        template: What is known: names, channels, raw ranges, and numbers to start from.
        ask: Shows a prompt and returns a line.
        say: Shows a line.
    """

    def __init__(self, robot: Device, template: JointMap, ask: Ask, say: Say) -> None:
        self._robot, self._ask, self._say = robot, ask, say
        self._joints = list(template.joints)
        self._name = template.robot
        self._raw = np.zeros(0)
        self._limp = False
        self._angles: list[tuple[float, float]] = []

    def run(self) -> JointMap | None:
        """Goes through the joints; None if ended early. The servos are let go of in any case.

        Raises:
            BoardError: The board refuses.
            LinkError: It stopped answering.
        """
        wide = JointMap(self._name, tuple(map(_whole_range, self._joints)))
        try:
            self._robot.configure(wide)
            self._robot.enable()
            self._raw = self._robot.status().commanded.copy()
            self._say(HELP)
            for j in range(len(self._joints)):
                if not self._joint(j):
                    return None
            return JointMap(self._name, tuple(self._joints))
        finally:
            self._robot.stop()
            self._robot.release()

    def _joint(self, j: int) -> bool:
        """The dialogue about one joint; False to end."""
        self._angles, self._limp = [], False
        while True:
            joint = self._joints[j]
            at = self._where(j)
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
                    self._do(j, self._where(j), words)  # a hand may have moved it since it was shown
                except (CalibrationError, ValueError) as error:
                    self._say(f"  {error}")

    def _do(self, j: int, at: float, words: list[str]) -> None:
        """One command."""
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
                raise ValueError(f"no such command: {' '.join(words)}; the commands are\n{HELP}")

    def _go(self, j: int, wanted: float) -> None:
        """Moves a joint and waits until its command is there."""
        if self._limp:
            raise ValueError("it is limp; t makes it hold first")
        self._raw[j] = wanted
        self._robot.move([round(raw) for raw in self._raw])
        while abs(self._robot.status().commanded[j] - round(wanted)) > 0.5:
            self._robot.clock.sleep(self._robot.poll_s)

    def _toggle_limp(self, j: int) -> None:
        if self._limp:
            self._hold_all(j)
        else:
            if not self._joints[j].readback:
                raise ValueError("it has no read-back, so it cannot say where a hand has put it")
            self._robot.limp([j])
            self._limp = True

    def _hold_all(self, j: int) -> None:
        self._robot.limp([])
        self._limp = False
        self._raw = self._robot.status().commanded.copy()

    def _where(self, j: int) -> float:
        """Where a joint is: measured while limp, else commanded."""
        status = self._robot.status()
        return float(status.measured[j] if self._limp else status.commanded[j])


def _number(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise ValueError(f"{text!r} is neither a number nor a command; the commands are\n{HELP}")
    return number


def _whole_range(joint: JointCalibration) -> JointCalibration:
    """A joint that may go wherever its servo can, slowly: limits are what is to be found out."""
    ends = sorted(joint.sign * (raw - joint.neutral) / joint.raw_per_rad for raw in (joint.raw_low, joint.raw_high))
    safe = min(max(joint.safe, ends[0]), ends[1])
    return replace(joint, lower=ends[0], upper=ends[1], safe=safe, max_rate=min(joint.max_rate, _JOG_RATE))


def _fitted(joint: JointCalibration, angles: list[tuple[float, float]]) -> JointCalibration:
    """Zero, scale and sign from raw values with known angles; with one angle only zero."""
    raw, angle = np.array(angles).T
    if len(angles) == 1:
        return replace(joint, neutral=float(raw[0] - joint.sign * joint.raw_per_rad * angle[0]))
    if np.ptp(raw) == 0 or np.ptp(angle) == 0:
        raise CalibrationError("two angles need two different places")
    slope, neutral = np.polyfit(angle, raw, 1)
    return replace(joint, neutral=float(neutral), raw_per_rad=abs(float(slope)), sign=1 if slope > 0 else -1)


def ask_in_terminal(robot: Device) -> Ask:
    """Reads lines from the terminal while the board keeps hearing from us."""
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
                return lines.get(timeout=_ALIVE_S)
            except queue.Empty:
                robot.status()

    return ask
