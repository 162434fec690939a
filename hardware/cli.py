"""``jaxik play``, ``teach`` and ``calibrate servos``, and the player that ``jaxik demo`` finds by its entry point."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from hardware.boards import connect
from hardware.clock import WallClock
from hardware.default_calibration import default_joint_map
from hardware.errors import CalibrationError
from hardware.joint_map import JointMap
from hardware.joint_map_file import load_joint_map, save_joint_map
from hardware.player import play as play_trajectory
from hardware.report import PlayReport
from hardware.servo_calibration import ask_in_terminal
from hardware.servo_calibration import calibrate_servos as calibrate_in_dialogue
from hardware.teaching import record
from jaxik.cli import Screen
from jaxik.trajectories import Trajectory, load_trajectory


def play_simulated(trajectory: Trajectory, progress: Callable[[float], None]) -> PlayReport:
    """Play on the simulated board in virtual time, with ideal servos: entry point of the group ``jaxik.players``."""
    with connect("simulated") as board:
        return play_trajectory(trajectory, board, progress=progress)


def play(
    trajectory: Annotated[Path, tyro.conf.Positional],
    board: str = "simulated",
    calibration: str | None = None,
    uncalibrated: bool = False,
    speed: float = 1.0,
    bluetooth: bool = False,
    realtime: bool = False,
    json: bool = False,
) -> int:
    """Play a trajectory on a board, or as a dry run on the simulated one.

    Args:
        trajectory: Trajectory file: .npz, .csv or .json.
        board: Address of the board, e.g. arduino:/dev/ttyUSB0; simulated is the dry run.
        calibration: TOML file that maps joints to servos, e.g. meccanoid.toml; without one the dry run has ideal
            servos.
        uncalibrated: Play on a real board with a calibration by data sheet.
        speed: Time scale: 0.5 plays at half speed.
        bluetooth: The link is a radio: 57600 baud, and silence is tolerated for longer.
        realtime: Let the simulated board take as long as a real one would.
        json: Print one JSON document instead of the table.

    Returns:
        0 after a success, else 1.
    """
    screen = Screen(json)
    motion = load_trajectory(trajectory)
    joints = _calibration(board, calibration, uncalibrated, motion.joint_names)
    with (
        connect(board, **_options(board, bluetooth, realtime)) as connected,
        screen.step(f"playing {motion.duration / speed:.1f} s on {board}") as bar,
    ):
        report = play_trajectory(motion, connected, joints, speed=speed, progress=bar)
    rows = [
        (name, "-" if np.isnan(w) else f"{np.degrees(w):.2f}", "-" if np.isnan(r) else f"{np.degrees(r):.2f}")
        for name, w, r in zip(motion.joint_names, report.tracking.worst, report.tracking.rms, strict=True)
    ]
    screen.table("tracking", ("joint", "worst [°]", "rms [°]"), rows)
    for warning in report.warnings:
        screen.say(f"note: {warning}")
    screen.say(f"{report.result.name}: {report.message}")
    screen.result(report.summary())
    return 0 if report.ok else 1


def teach(
    out: Annotated[Path, tyro.conf.Positional],
    board: str = "simulated",
    calibration: str = "meccanoid.toml",
    seconds: float = 10.0,
    bluetooth: bool = False,
    json: bool = False,
) -> int:
    """Record a motion made by hand with servos that have read-back; replay it with `jaxik play`.

    Args:
        out: Trajectory file to write: .npz, .csv or .json.
        board: Address of the board, e.g. arduino:/dev/ttyUSB0.
        calibration: TOML file that maps joints to servos.
        seconds: Duration of the recording.
        bluetooth: The link is a radio: 57600 baud, and silence is tolerated for longer.
        json: Print one JSON document instead of text.

    Returns:
        0.
    """
    screen = Screen(json)
    joints = load_joint_map(calibration)
    with connect(board, **_options(board, bluetooth)) as connected, screen.step(f"recording {seconds:g} s") as bar:
        motion = record(connected, joints, seconds, progress=bar)
    motion.save(out)
    screen.say(f"{len(motion)} waypoints, {motion.duration:.1f} s, in {out}")
    screen.say(f"replay it: jaxik play {out} --board {board} --calibration {calibration}")
    screen.result({"file": str(out), "waypoints": len(motion), "duration": motion.duration})
    return 0


def calibrate_servos(
    out: Annotated[Path, tyro.conf.Positional],
    board: str = "simulated",
    template: str = "meccanoid.toml",
    joint: tuple[str, ...] = (),
    bluetooth: bool = False,
) -> int:
    """Calibrate servos joint by joint (jog, set neutral, angles, limits and sign) and write the file.

    Args:
        out: TOML file to write.
        board: Address of the board, e.g. arduino:/dev/ttyUSB0; simulated is for practice.
        template: Calibration to start from: names, channels, raw ranges.
        joint: Only these joints; default all.
        bluetooth: The link is a radio: 57600 baud, and silence is tolerated for longer.

    Returns:
        0 if the file was written, 1 if the dialogue was ended early.
    """
    known = load_joint_map(template)
    chosen = known.select(joint or known.names)
    options = _options(board, bluetooth, realtime=True)
    with connect(board, **options) as connected:
        done = calibrate_in_dialogue(connected, chosen, ask=ask_in_terminal(connected))
    if not done.ok:
        print("ended; nothing was written")
        return 1
    new = {row.name: row for row in done.joints.joints}
    save_joint_map(JointMap(known.robot, tuple(new.get(row.name, row) for row in known.joints)), out)
    print(f"written: {out}; play with --calibration {out}")
    return 0


def _calibration(board: str, file: str | None, uncalibrated: bool, names: tuple[str, ...]) -> JointMap | None:
    """Return the calibration to play with; a real board needs a file, or explicit consent to do without."""
    if file is not None:
        return load_joint_map(file)
    kind = board.partition(":")[0]
    if kind == "simulated" or uncalibrated:
        return default_joint_map(kind, names)
    raise CalibrationError(
        f"playing on {board} needs --calibration FILE: make one with `jaxik calibrate servos FILE --board {board}`; "
        "--uncalibrated plays with the numbers of data sheets, at your own risk"
    )


def _options(board: str, bluetooth: bool, realtime: bool = False) -> dict[str, Any]:
    """Return the keyword arguments to open a board with."""
    kind = board.partition(":")[0]
    if kind == "arduino" and bluetooth:
        return {"bluetooth": True, "baud": 57_600}
    return {"clock": WallClock()} if kind == "simulated" and realtime else {}
