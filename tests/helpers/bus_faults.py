"""Playbacks on servo buses with faults drawn at random: of the line, of servos, and by another program on the port."""

import random
import sys
from collections import Counter
from dataclasses import dataclass

import numpy as np

import hardware
from hardware import PlayResult
from hardware.boards.dynamixel import DynamixelBoard
from hardware.boards.feetech import FeetechBoard
from jaxik import Trajectory
from tests.helpers.servo_bus import DynamixelBus, FeetechBus

KINDS = {"dynamixel": (DynamixelBus, DynamixelBoard, 57_600), "feetech": (FeetechBus, FeetechBoard, 1_000_000)}
NAMES = ("lift", "turn", "elbow")
TIMES = np.linspace(0.0, 0.4, 11)
TRAJECTORY = Trajectory(TIMES, 0.3 * np.sin(3 * TIMES)[:, None] * np.array([1.0, -0.6, 0.8]), NAMES)
JOINTS = hardware.JointMap(
    "three",
    tuple(
        hardware.JointCalibration(
            name, 0, 4095, 2048.0, 4096 / (2 * np.pi), sign, -1.5, 1.5, 4.0, 0.0, readback=True, channel=str(i)
        )
        for i, (name, sign) in enumerate(zip(NAMES, (1, 1, -1), strict=True), 1)
    ),
)
EVENTS = (
    *(["none"] * 3),
    "alert",
    "off",
    "restart",
    "swap",
    "unplug",
    "loose plug",
    "port gone",
    "other reads",
    "other switches off",
    "other clears watchdog",
    "other moves",
)
_NOTICED_S = 0.8  # two rounds of looking at torque and watchdog, with lost answers
_LAST_LOOK_S = 0.08  # what happens after the last look, and before the release that follows it, is not seen

_BAD_LINE = 0.02  # one packet in fifty disturbed

# Results that tell of an event; SUCCESS must also pass the checks of the state at the end.
_CAUSES = {
    "none": {PlayResult.SUCCESS},
    "alert": {PlayResult.SUCCESS, PlayResult.SERVO_FAULT},
    "off": {PlayResult.SUCCESS, PlayResult.SERVO_FAULT},
    "restart": {PlayResult.SUCCESS, PlayResult.SERVO_FAULT},
    "swap": {PlayResult.SUCCESS, PlayResult.SERVO_FAULT, PlayResult.PATH_TOLERANCE},
    "unplug": {PlayResult.SUCCESS, PlayResult.LINK_LOST},
    "loose plug": {PlayResult.SUCCESS, PlayResult.LINK_LOST},
    "port gone": {PlayResult.SUCCESS, PlayResult.LINK_LOST},
    "other reads": {PlayResult.SUCCESS},
    "other switches off": {PlayResult.SUCCESS, PlayResult.SERVO_FAULT},
    "other clears watchdog": {PlayResult.SUCCESS, PlayResult.SERVO_FAULT},
    "other moves": {PlayResult.SUCCESS, PlayResult.PATH_TOLERANCE},
}


@dataclass
class Run:
    """One playback.

    Attributes:
        kind: Kind of the board.
        event: What happens, besides the noise of the line.
        servo: To which servo.
        at_s: When [s].
        noise: Probability that a packet is lost or garbled.
        report: Report of the playback.
        wrong: Sentences about what should not have been.
    """

    kind: str
    event: str
    servo: int
    at_s: float
    noise: float
    report: hardware.PlayReport
    wrong: list[str]


def run(seed):
    """Play once with faults drawn from a seed, and judge the result by the true state of the servos."""
    draw = random.Random(seed)
    kind, event, servo = draw.choice(list(KINDS)), draw.choice(EVENTS), draw.randint(1, 3)
    noise, at_s = 10 ** draw.uniform(-3, np.log10(0.05)), draw.uniform(0.0, 2.2)
    fake, board_class, baud = KINDS[kind]
    start = draw.randint(1700, 2400)
    bus = fake(range(1, 4), start=start, baud=baud, lose=noise / 2, garble=noise / 2, seed=seed)
    bit = draw.choice(list(range(6)) if kind == "feetech" else [0, 2, 3, 4, 5])
    bus.events += _actions(bus, event, servo, at_s, bit, draw)
    with board_class("PORT", transport=bus, clock=bus.clock) as board:
        report = hardware.play(TRAJECTORY, board, JOINTS, park=False)
    bus.step()
    found = Run(kind, event, servo, at_s, noise, report, [])
    found.wrong = list(_judge(found, bus, board._series.alert_names[bit]))
    return found


def campaign(seed, count, tell=lambda done: None):
    """Return how the playbacks ended, by event and result, and those with something wrong."""
    ends, wrong = Counter(), []
    for i in range(count):
        found = run(seed + i)
        ends[found.event, found.report.result.name] += 1
        if found.wrong:
            wrong.append((seed + i, found))
        tell(i)
    return ends, wrong


def _actions(bus, event, servo, at_s, bit, draw):
    """Return the event as times and functions for the bus."""
    memory = lambda: bus.memory[servo]  # noqa: E731
    position = draw.randint(500, 3500)
    once = {
        "alert": lambda: bus.alarm(servo, bit),
        "off": lambda: memory().__setitem__(bus.torque_at, 0),
        "other switches off": lambda: memory().__setitem__(bus.torque_at, 0),
        "restart": lambda: bus.plug_in(servo, round(bus.at[servo])),
        "swap": lambda: bus.plug_in(servo, position),
        "unplug": lambda: bus.gone.add(servo),
        "port gone": lambda: setattr(bus, "vanished", True),
        "other clears watchdog": lambda: bus.watchdog_at and memory().__setitem__(bus.watchdog_at, 0),
    }
    if event in once:
        return [(at_s, once[event])]
    if event == "loose plug":
        return [(at_s, lambda: bus.gone.add(servo)), (at_s + draw.uniform(0.01, 0.4), lambda: bus.gone.discard(servo))]
    times = sorted(draw.uniform(0.0, 2.2) for _ in range(10))
    if event == "other reads":  # answers to its questions: of registers, and of the very position
        places = [draw.choice([(bus.position_at, bus.position_bytes), (bus.torque_at, 1), (0, 7)]) for _ in times]
        tell = lambda place: bus.inject(bus.status(servo, bus.load(servo, *place)))  # noqa: E731
        return [(t, lambda place=place: tell(place)) for t, place in zip(times, places, strict=True)]
    if event == "other moves":
        goals = [draw.randint(1900, 2200) for _ in times]
        return [(t, lambda goal=goal: bus.put(servo, bus.goal_at, goal)) for t, goal in zip(times, goals, strict=True)]
    return []


def _judge(found, bus, alert):
    """Yield what is wrong about a run."""
    report, event, servo = found.report, found.event, found.servo
    name = NAMES[servo - 1]
    lost = report.result is PlayResult.LINK_LOST and found.noise > _BAD_LINE  # a cause of its own
    if report.result not in _CAUSES[event] and not lost:
        yield f"{report.result.name} does not tell of {event}: {report.message}"
    elif (
        not (report.ok or lost or event == "port gone")
        and name not in report.message
        and "none of the" not in report.message
    ):
        yield f"{name} is not named: {report.message}"
    if report.result is PlayResult.SERVO_FAULT and event == "alert" and alert not in report.message:
        yield f"{alert} is not named: {report.message}"
    at_release, released_s = bus.released_from or {}, bus.released_s
    if report.ok:
        goal = JOINTS.to_raw(TRAJECTORY.q[-1])
        for i, wanted in enumerate(goal, 1):
            torque, position = at_release.get(i, (0, 0))
            if i == servo and found.at_s > released_s - _LAST_LOOK_S:
                continue
            if not torque:
                yield f"servo {i} was off at the end of a success"
            if abs(position - wanted) > 40 and event != "other moves":
                yield f"servo {i} was {position - wanted} steps off at the end of a success"
        if event in ("alert", "unplug", "port gone") and found.at_s < released_s - _LAST_LOOK_S:
            yield f"{event} at {found.at_s:.2f} s went unnoticed until {released_s:.2f} s"
    grace_s = found.at_s + _NOTICED_S if event == "other clears watchdog" else -1.0
    late = [(t, i) for t, i in bus.unguarded if not (i == servo and found.at_s <= t <= grace_s)]
    if late:
        yield f"moved without its watchdog: {late[0]}"
    left = set(bus.driven()) - bus.gone
    if left and not bus.vanished:
        yield f"servos {sorted(left)} are driven after the end"


if __name__ == "__main__":
    first, number = int(sys.argv[1]), int(sys.argv[2])
    ends, wrong = campaign(first, number)
    for (event, result), times in sorted(ends.items()):
        print(f"{event:24} {result:16} {times}")
    print(sum(ends.values()), "runs,", len(wrong), "with something wrong")
    for seed, found in wrong[:40]:
        print(seed, found.kind, found.event, found.servo, f"{found.at_s:.3f}", f"{found.noise:.4f}", found.wrong)
