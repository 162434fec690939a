"""``jaxik play``, and the player that ``jaxik demo`` finds by its entry point."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from hardware.boards import connect
from hardware.clock import WallClock
from hardware.player import play as play_trajectory
from hardware.report import PlayReport
from jaxik.cli.console import Screen
from jaxik.trajectory import Trajectory, load_trajectory


def play_simulated(trajectory: Trajectory, progress: Callable[[float], None]) -> PlayReport:
    """Plays on the simulated board in virtual time, with ideal servos: entry point of the group ``jaxik.players``."""
    with connect("simulated") as robot:
        return play_trajectory(trajectory, robot, progress=progress)


def play(
    trajectory: Annotated[Path, tyro.conf.Positional],
    board: str = "simulated",
    calibration: str | None = None,
    speed: float = 1.0,
    realtime: bool = False,
    json: bool = False,
) -> int:
    """Play a trajectory on a board; without a board named it is a dry run on the simulated one.

    Args:
        trajectory: Trajectory file: .npz, .csv or .json.
        board: Where to play; simulated is the dry run.
        calibration: TOML file that maps joints to servos, e.g. meccanoid.toml; default ideal servos.
        speed: Time scale: 0.5 plays at half speed.
        realtime: Let the simulated board take as long as a real one would.
        json: Print one JSON document instead of the table.

    Returns:
        0 if it succeeded, else 1.
    """
    screen = Screen(json)
    motion = load_trajectory(trajectory)
    options = {"clock": WallClock()} if realtime and board == "simulated" else {}
    with (
        connect(board, **options) as robot,
        screen.step(f"playing {motion.duration_s / speed:.1f} s on {board}") as bar,
    ):
        report = play_trajectory(motion, robot, calibration, speed=speed, progress=bar)
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
