"""``jaxik scan`` and ``jaxik check``: what is on a port, and whether a board is ready to play."""

import dataclasses
import math
import re
from collections.abc import Sequence
from typing import Annotated, Any

import tyro

from hardware.board_check import CheckResult
from hardware.board_check import check as check_board
from hardware.boards import connect, parse_addresses
from hardware.boards.servo_reading import ServoReading
from hardware.bus_scan import SERIES, FoundServo
from hardware.bus_scan import scan as scan_port
from hardware.cli import board_options, stoppable
from hardware.errors import BoardError
from hardware.joint_map_file import load_joint_map
from hardware.stop_signals import stop_signals
from jaxik.cli import Screen

_COLUMNS = ("model", "position [raw]", "mode", "driven", "voltage [V]", "temperature [°C]", "alerts")


@stoppable
def scan(
    port: Annotated[str, tyro.conf.Positional],
    baud: tuple[int, ...] = (),
    ids: str = "1-20",
    json: bool = False,
) -> int:
    """Look for bus servos on a serial port: kinds, rates, numbers, models, positions, voltages and alerts.

    Nothing is written to the servos, and nothing moves.

    Args:
        port: Serial port, e.g. /dev/ttyUSB0, or feetech:/dev/ttyUSB0 for one kind of servo only.
        baud: Rates to try in bits per second; default all that the servos can be set to.
        ids: Numbers to call one by one besides a call to all, e.g. 1-20 or 3,7 or 0-253.
        json: Print one JSON document instead of the table.

    Returns:
        0 if a servo answers, else 1.
    """
    return _scan(port, baud, _numbers(ids), json)


def _scan(port: str, bauds: Sequence[int], numbers: list[int], json: bool, note: str = "") -> int:
    """Scan and print what was found; return the exit code."""
    screen = Screen(json)

    def tell(servo: FoundServo) -> None:
        screen.say(f"{servo.kind} servo {servo.reading.servo} answers at {servo.baud} baud")

    with screen.step(f"looking for servos on {port}") as bar:
        result = scan_port(port, bauds=bauds, ids=numbers, progress=bar, tell=tell)
    if result.found:
        rows = [
            (f"{servo.kind} {servo.reading.servo}", str(servo.baud), *_cells(servo.reading)) for servo in result.found
        ]
        screen.table(f"servos on {result.port}", ("servo", "baud", *_COLUMNS), rows)
        for address in result.addresses():
            screen.say(f"their address: {address}; a joint's channel in the calibration is its servo's number")
    else:
        rates = "; ".join(f"{kind} at {', '.join(str(b) for k, b in result.tried if k == kind)}" for kind in SERIES)
        screen.say(f"{result.port}: {result.status.message}; tried: {rates} baud")
    for line in (*result.notes, *([note] if note else [])):
        screen.say(f"note: {line}")
    found = [{"kind": s.kind, "baud": s.baud, **dataclasses.asdict(s.reading)} for s in result.found]
    screen.result({"port": result.port, "servos": found, "tried": result.tried, "notes": result.notes})
    return 0 if result.ok else 1


@stoppable
def check(
    board: Annotated[str, tyro.conf.Positional] = "simulated",
    calibration: str | None = None,
    wiggle: bool = False,
    joint: tuple[str, ...] = (),
    baud: int | None = None,
    bluetooth: bool = False,
    json: bool = False,
) -> int:
    """Check a board before playing: its port, supply voltage, which servos answer, and which joint moves which servo.

    Args:
        board: Address of the board, e.g. arduino:/dev/ttyUSB0.
        calibration: TOML file that maps joints to servos; default meccanoid.toml on an Arduino.
        wiggle: Move each joint by 4 degrees and back, slowly, one after the other, so that swapped channels are seen.
        joint: Wiggle only these joints.
        baud: Rate of the port in bits per second, if it is not the board's usual one; `jaxik scan` finds it.
        bluetooth: The link is a radio: 57600 baud, and silence is tolerated for longer.
        json: Print one JSON document instead of the table.

    Returns:
        0 if everything is as it should be, else 1.
    """
    kinds = list(parse_addresses(board))
    if calibration is None and len(kinds) == 1 and kinds[0] in SERIES and not wiggle and not joint:
        rate = (baud,) if baud else () if "@" in board else SERIES[kinds[0]].bauds[:1]
        note = "which servo moves which joint is said by a calibration: --calibration FILE"
        return _scan(board, rate, list(SERIES[kinds[0]].ids), json, note)
    if calibration is None and not set(kinds) <= {"arduino", "simulated"}:
        raise BoardError(f"checking {board} needs --calibration FILE, which says which servo moves which joint")
    joints, screen = load_joint_map(calibration or "meccanoid.toml"), Screen(json)
    with stop_signals() as signals, signals.raising(), connect(board, **board_options(board, baud, bluetooth)) as link:
        screen.say(f"{link.name}: the port is open")
        names = (joint or joints.names) if wiggle or joint else ()
        result = check_board(link, joints, wiggle=names, say=screen.say)
    _print(screen, result)
    return 0 if result.ok else 1


def _print(screen: Screen, result: CheckResult) -> None:
    """Print the state of every joint, and the problems."""
    told = any(entry.reading for entry in result.joints)
    rows = []
    for entry in result.joints:
        answers = {True: "yes", False: "no", None: "cannot tell"}[entry.answers]
        moved = "-" if math.isnan(entry.moved) else f"{math.degrees(entry.moved):.1f}"
        angle = "-" if math.isnan(entry.angle) else f"{math.degrees(entry.angle):.1f}"
        cells = (_cells(entry.reading) if entry.reading else ("-",) * len(_COLUMNS)) if told else ()
        rows.append((entry.name, entry.channel or "-", answers, angle, moved, *cells))
    columns = ("joint", "channel", "answers", "angle [°]", "moved [°]", *(_COLUMNS if told else ()))
    screen.table(result.board, columns, rows)
    if not math.isnan(result.supply_v):
        screen.say(f"supply {result.supply_v:.1f} V")
    for problem in result.problems:
        screen.say(f"problem: {problem}")
    screen.say(result.status.message)
    plain = lambda x: None if isinstance(x, float) and math.isnan(x) else x  # noqa: E731
    rows_for_json: list[dict[str, Any]] = [
        {key: plain(value) for key, value in dataclasses.asdict(entry).items()} for entry in result.joints
    ]
    screen.result(
        {
            "board": result.board,
            "status": result.status.name,
            "supply_v": plain(result.supply_v),
            "joints": rows_for_json,
            "problems": list(result.problems),
        }
    )


def _cells(reading: ServoReading) -> tuple[str, ...]:
    """Return the state of a servo as cells of a table."""
    return (
        reading.model,
        str(reading.position),
        reading.mode,
        "yes" if reading.driven else "no",
        f"{reading.voltage_v:.1f}",
        str(reading.temperature_c),
        ", ".join(reading.alerts) or "none",
    )


def _numbers(text: str) -> list[int]:
    """Return numbers from text such as 1-20 or 3,7."""
    if not re.fullmatch(r"\d+(-\d+)?(,\d+(-\d+)?)*", text):
        raise ValueError(f"--ids needs numbers such as 1-20 or 3,7; got {text!r}")
    numbers = []
    for part in text.split(","):
        first, _, last = part.partition("-")
        numbers += range(int(first), int(last or first) + 1)
    return numbers
