"""Text around a playback: what stopping does before it begins, signs of life, and how it went."""

import sys
import time
from collections.abc import Callable

import numpy as np

from hardware.board import Board
from hardware.errors import LinkError
from hardware.report import PlayReport
from hardware.stop_signals import StopSignals
from hardware.stopping import OnStop, keep_holding
from jaxik.cli import Screen

_SIGN_OF_LIFE_S = 60.0  # period of messages where no progress bar can be shown


def say_before(screen: Screen, board: Board, on_stop: OnStop) -> None:
    """Say what stopping will do, and which boards nothing stops if this program dies."""
    if board.name != "simulated":
        screen.say(f"Ctrl-C stops the arm at once; then {on_stop.message} (--on-stop)")
    for name in board.without_watchdog:
        screen.say(
            f"note: {name} has no watchdog: if the computer or the cable fails (on Windows and over Bluetooth also if "
            "this program is killed), its servos stay driven; keep the supply's switch within reach"
        )


def hold_until_told(screen: Screen, board: Board, report: PlayReport, signals: StopSignals) -> None:
    """Hold the arm until another signal comes."""
    screen.say(f"{report.result.name}: {report.message}; holding: Ctrl-C once more releases the arm")
    known = 0 if signals.first is None else 1
    try:
        keep_holding(board, lambda: signals.count > known)
    except LinkError as error:
        screen.say(f"note: no longer held: {error}")


def with_sign_of_life(screen: Screen, bar: Callable[[float], None]) -> Callable[[float], None]:
    """Return a progress function that also prints a line now and then where the bar cannot be seen."""
    began = told = time.monotonic()

    def report(fraction: float) -> None:
        nonlocal told
        bar(fraction)
        now = time.monotonic()
        if not sys.stdout.isatty() and now - told > _SIGN_OF_LIFE_S:
            told = now
            screen.say(f"{100 * fraction:.1f} % after {(now - began) / 60:.0f} min")

    return report


def exit_code(report: PlayReport) -> int:
    """Return the exit code of a playback: 0 after a success, 128 and the number of a signal, else 1."""
    return 128 + report.signal if report.signal is not None else 0 if report.ok else 1


def print_report(screen: Screen, report: PlayReport) -> None:
    """Print how a playback went."""
    rows = [
        (name, "-" if np.isnan(w) else f"{np.degrees(w):.2f}", "-" if np.isnan(r) else f"{np.degrees(r):.2f}")
        for name, w, r in zip(report.log.joint_names, report.tracking.worst, report.tracking.rms, strict=True)
    ]
    screen.table("tracking", ("joint", "worst [°]", "rms [°]"), rows)
    for warning in report.warnings:
        screen.say(f"note: {warning}")
    screen.say(f"{report.result.name}: {report.message}")
    screen.result(report.summary())
