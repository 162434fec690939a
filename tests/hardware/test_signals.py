"""Programs that are stopped by a signal while they move servos on boards that live on, in real time."""

import math
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import hardware
from jaxik import Trajectory, load_trajectory
from tests.helpers.board_process import BoardProcess

NAMES = ("a", "b", "c")
TIME = np.linspace(0, 20, 1001)
TRAJECTORY = Trajectory(TIME, 0.8 + 0.5 * np.sin(TIME)[:, None] * np.linspace(0.5, 1, 3), NAMES)
# Under nohup, and in the background of a shell, signals are ignored, and so they are in what is started there.
PROGRAM = """\
import signal, sys
signal.signal(signal.SIGHUP, signal.SIG_DFL)
signal.signal(signal.SIGINT, signal.default_int_handler)
from jaxik.cli import main
sys.argv[0] = "jaxik"
sys.exit(main())
"""


def joints(kind):
    bus = kind in ("feetech", "dynamixel")
    scale = 4096 / (2 * math.pi) if bus else 600.0
    raw = {"raw_low": 0, "raw_high": 4095, "neutral": 2048.0} if bus else {"raw_low": 500, "raw_high": 2500}
    common = {"neutral": 1500.0, "raw_per_rad": scale, "sign": 1, "lower": -1.5, "upper": 1.5, "max_rate": 4.0}
    common |= {"safe": 0.0, "readback": bus} | raw
    channels = ("D2", "D3", "D4") if kind == "arduino" else ("1", "2", "3")
    rows = [hardware.JointCalibration(name=n, channel=c, **common) for n, c in zip(NAMES, channels, strict=True)]
    return hardware.JointMap("three", tuple(rows))


def end(kind, folder, words, said, number, seconds=3.0, after=0.3, again_s=None):
    """Run a program, send a signal some time after it has said something, and return code, output and what it did.

    The rows of each servo are times since the signal [s] and values, 0 when released.
    """
    board = BoardProcess(kind)
    hardware.save_joint_map(joints(kind), folder / "three.toml")
    TRAJECTORY.save(folder / "motion.npz")
    with open(folder / "out.txt", "w") as out:
        program = subprocess.Popen(
            [sys.executable, "-c", PROGRAM, *words, "--board", f"{kind}:{board.port}"],
            stdin=subprocess.PIPE,
            stdout=out,
            stderr=subprocess.STDOUT,
            cwd=folder,
            start_new_session=True,
        )
        for _ in range(600):
            time.sleep(0.05)
            if said in (folder / "out.txt").read_text() or program.poll() is not None:
                break
        time.sleep(seconds)
        assert program.poll() is None, (folder / "out.txt").read_text()
        at = time.monotonic()
        os.kill(program.pid, number)
        while again_s is not None and program.poll() is None:
            time.sleep(again_s)
            program.send_signal(number)
        code = program.wait(20)
        program.stdin.close()
    time.sleep(after)
    rows = np.array(board.rows()).reshape(-1, 3) - [at, 0, 0]
    servos = {int(servo): rows[rows[:, 1] == servo][:, [0, 2]] for servo in set(rows[:, 1])}
    return code, " ".join((folder / "out.txt").read_text().split()), servos


def last_change(rows):
    """Return the time of the last change of a value that is driven."""
    driven = rows[rows[:, 1] > 0]
    changed = np.flatnonzero(np.diff(driven[:, 1])) + 1
    return driven[changed[-1], 0]


PLAY = ["play", "motion.npz", "--calibration", "three.toml", "--estimates"]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["arduino", "maestro"])
def test_sigterm_releases_at_once(kind, tmp_path):
    code, said, servos = end(kind, tmp_path, PLAY, "Ctrl-C stops", signal.SIGTERM, seconds=4.0)
    assert code == 143
    assert "ABORTED: stopped by SIGTERM" in said
    assert len(servos) == 3
    for rows in servos.values():
        assert -0.3 < last_change(rows) < 0.3
        assert rows[-1, 0] < 0.3
        assert kind == "arduino" or rows[-1, 1] == 0


@pytest.mark.slow
def test_an_impatient_user_gets_the_same_exit_code(tmp_path):
    code, said, servos = end(
        "arduino", tmp_path, [*PLAY, "--on-stop", "lower"], "Ctrl-C stops", signal.SIGINT, seconds=4.0, again_s=0.02
    )
    assert code == 130
    assert "released before it was down" in said
    assert all(rows[-1, 0] < 0.5 for rows in servos.values())


@pytest.mark.slow
def test_sighup_lowers(tmp_path):
    code, _, servos = end(
        "arduino", tmp_path, [*PLAY, "--on-stop", "lower"], "Ctrl-C stops", signal.SIGHUP, seconds=4.0
    )
    assert code == 129
    for rows in servos.values():
        assert rows[-1, 1] == 1500, "the safe pose"
        late = rows[rows[:, 0] > 0.1]
        assert np.abs(np.diff(late[:, 1])).max() <= 0.2 * 4 * 600 * 0.02 + 1


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "within_s"), [("arduino", 2.1), ("maestro", 0.3), ("feetech", 0.3)])
def test_sigkill_releases_by_watchdog_or_guardian(kind, within_s, tmp_path):
    code, _, servos = end(kind, tmp_path, PLAY, "Ctrl-C stops", signal.SIGKILL, seconds=4.0, after=3.0)
    assert code == -signal.SIGKILL
    for rows in servos.values():
        assert last_change(rows) < 0.3
        assert rows[-1, 0] < within_s
        assert kind == "arduino" or rows[-1, 1] == 0


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_recording_outlives_its_program(number, tmp_path):
    words = ["teach", "taught.npz", "--calibration", "three.toml", "--countdown", "0", "--seconds", "60"]
    code, _, servos = end("feetech", tmp_path, words, "all others hold", number)
    assert code == (143 if number == signal.SIGTERM else -9)
    kept = load_trajectory(tmp_path / ("taught.npz" if number == signal.SIGTERM else "taught.part.csv"))
    assert kept.duration > 1.0
    for rows in servos.values():
        assert rows[-1, 1] == 0
