"""Long playbacks and slow helpers: rounds, log files, absurd durations, callbacks that take their time, priority."""

import csv
import gc
import os
import subprocess
import sys
import time

import numpy as np
import pytest

import hardware
from hardware import PlayResult, State, guardian, schedule
from hardware.priority import sending_first
from jaxik import Trajectory
from jaxik.errors import FileFormatError
from tests.helpers.firmware import run

TIME = np.linspace(0.0, 2.0, 51)
OPEN = Trajectory(TIME, np.stack([np.sin(TIME), 0.5 * TIME], -1), ("a", "b"))
CLOSED = Trajectory(TIME, np.stack([np.sin(np.pi * TIME), 0 * TIME], -1), ("a", "b"))


def play(trajectory, **options):
    with hardware.connect("simulated") as board:
        report = hardware.play(trajectory, board, **options)
        return report, np.array([frame.commanded for frame in board.log])


@pytest.mark.parametrize(("trajectory", "rounds_s"), [(CLOSED, 4.0), (OPEN, 5.0)], ids=["closed", "open"])
def test_rounds_follow_one_another_without_a_jump(trajectory, rounds_s):
    once, _ = play(trajectory, park=False)
    twice, commands = play(trajectory, park=False, loops=2)
    assert twice.ok
    assert abs(twice.duration - once.duration - (rounds_s - 2.0)) < 0.1, "an open one eases back in a second"
    assert np.abs(np.diff(commands, axis=0)).max() <= 5000 * 0.02 * 4, "at most 3.2 rad/s"
    peaks = (commands[:-1, 0] <= 32768 + 4000) & (commands[1:, 0] > 32768 + 4000)
    assert peaks.sum() == 2


def test_until_stopped():
    report, _ = play(CLOSED, loops=None, watch=lambda row: row.time > 6 and (_ for _ in ()).throw(KeyboardInterrupt))
    assert report.result is PlayResult.ABORTED
    assert 6 < report.duration < 6.2
    with pytest.raises(ValueError, match="loops needs to be 1 or more"):
        play(CLOSED, loops=0)


def test_a_log_file_has_every_row(tmp_path):
    for name in ("log.csv", "log.npz"):
        report, _ = play(OPEN, log_file=tmp_path / name)
    with open(tmp_path / "log.csv", newline="") as file:
        header, *rows = csv.reader(file)
    assert header == ["time", "phase", "commanded:a", "commanded:b", "measured:a", "measured:b"]
    assert [row[1] for row in rows] == list(report.log.phase)
    np.testing.assert_array_equal([[float(x) for x in row[2:4]] for row in rows], report.log.commanded)
    packed = np.load(tmp_path / "log.npz")
    for key in ("time", "commanded", "measured"):
        np.testing.assert_array_equal(packed[key], getattr(report.log, key))
    assert packed["phase"].tolist() == list(report.log.phase)
    assert packed["joint_names"].tolist() == ["a", "b"]
    assert sorted(os.listdir(tmp_path)) == ["log.csv", "log.npz"]


def test_a_log_that_cannot_be_written_is_refused_before_anything_moves(tmp_path):
    with hardware.connect("simulated") as board:
        with pytest.raises(FileFormatError, match=r"expected a log's name to end in .csv or .npz"):
            hardware.play(OPEN, board, log_file=tmp_path / "log.txt")
        with pytest.raises(OSError, match=r"No such file.*none.log\.csv"):
            hardware.play(OPEN, board, log_file=tmp_path / "none" / "log.csv")
        assert not board.log


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a device that is always full")
def test_a_full_disk_does_not_end_a_playback(tmp_path):
    (tmp_path / "log.csv.part").symlink_to("/dev/full")
    (tmp_path / "log.npz.part").symlink_to("/dev/full")
    for name in ("log.csv", "log.npz"):
        report, _ = play(OPEN, log_file=tmp_path / name)
        assert report.ok
        assert "No space left" in report.warnings[-1]


@pytest.mark.parametrize(
    ("trajectory", "speed", "said"),
    [
        (
            Trajectory(np.linspace(0, 2e9, 101), np.zeros((101, 2)), ("a", "b")),
            1.0,
            "would take 63.4 years at speed 1,",
        ),
        (OPEN, 1e-9, "of 2 s would take 63.4 years at speed 1e-09,"),
    ],
)
def test_absurd_durations_are_refused(trajectory, speed, said):
    report, commands = play(trajectory, speed=speed)
    assert report.result is PlayResult.LIMIT
    assert said in report.message
    assert "7 days at most" in report.message
    assert not len(commands)


def test_waypoints_are_made_while_they_are_sent():
    """Six days of them begin at once and take no memory."""
    days = Trajectory(np.array([0.0, 6 * 86_400.0]), np.array([[0.0, 0.0], [1.0, 1.0]]), ("a", "b"))
    assert not schedule.problems(days, hardware.ideal_joint_map(("a", "b")), 1.0)
    points = schedule.waypoints([schedule.played(days, 1.0)], hardware.ideal_joint_map(("a", "b")))
    first = [next(points)[0] for _ in range(5000)]
    np.testing.assert_array_equal(np.diff([point.time_us for point in first]), 500_000)
    assert not any(point.last for point in first)


def test_a_slow_callback_does_not_stop_the_arm():
    """Each call takes longer than the board tolerates silence."""
    with hardware.connect("simulated", clock=hardware.WallClock()) as board:
        calls = []
        report = hardware.play(
            Trajectory(TIME[:26], CLOSED.q[:26], ("a", "b")),
            board,
            park=False,
            progress=lambda fraction: (time.sleep(0.5), calls.append(fraction)),
        )
        assert report.ok, report.message
        assert len(calls) >= 2


def test_an_exception_of_a_callback_still_ends_the_playback():
    def fail(row):
        raise RuntimeError("a plot")

    with hardware.connect("simulated", clock=hardware.WallClock()) as board:
        with pytest.raises(RuntimeError, match="a plot"):
            hardware.play(CLOSED, board, watch=fail)
        assert board.status().state is State.DETACHED


def test_a_computer_that_was_away_is_named_as_the_cause():
    with hardware.connect("simulated") as board:
        report = hardware.play(OPEN, board, progress=lambda fraction: fraction > 0.5 and board.clock.sleep(0.4))
    assert report.result is PlayResult.LINK_LOST
    assert (
        "nothing was heard from the host for too long; the program, or its link, stood still for 0.4" in report.message
    )


def test_priority_is_only_borrowed():
    before = os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, 0), sys.getswitchinterval()
    with sending_first(hardware.WallClock()):
        assert sys.getswitchinterval() < before[2]
        assert gc.get_freeze_count() > 1000, "no collection looks at what is there already"
    assert gc.get_freeze_count() == 0
    assert (os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, 0), sys.getswitchinterval()) == before


@pytest.mark.parametrize("end", ["killed", "silent", "told"])
def test_the_guardian_speaks_when_the_program_dies_or_hangs_but_not_after_a_release(end):
    read, write = os.pipe()
    process = subprocess.Popen(
        [sys.executable, "-I", "-S", guardian.__file__, str(write), b"farewell".hex()],
        stdin=subprocess.PIPE,
        pass_fds=(write,),
    )
    process.stdin.write(b"." * 9 + (b"q" if end == "told" else b""))
    process.stdin.flush()
    if end != "silent":
        process.stdin.close()
        assert process.wait(10) == 0
    os.close(write)
    if end == "silent":
        began = time.monotonic()
        assert os.read(read, 100) == b"farewell"
        assert 1.5 < time.monotonic() - began < 5
        process.stdin.close()
        process.wait(10)
    assert os.read(read, 100) == (b"" if end == "told" else b"farewell")
    os.close(read)


@pytest.mark.slow
def test_more_than_65536_frames_on_the_modeled_board_in_constant_memory():
    """25 minutes in a process without the tests' type checks; memory after 15 of them is memory at the end."""
    script = """
import resource, numpy as np, hardware
from jaxik import Trajectory
t = np.arange(0, 1500, 0.02)
trajectory = Trajectory(t, np.stack([np.sin(t), np.cos(0.7 * t)], -1), ("a", "b"))
used = []
def watch(row):
    if len(used) < 2 and row.time > (900, 1450)[len(used)]:
        used.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
with hardware.connect("simulated") as board:
    report = hardware.play(trajectory, board, watch=watch)
assert report.ok, report.message
assert report.duration > 1500
print(used[1] - used[0])
"""
    assert float(run(sys.executable, "-c", script)) < 8, "MiB"
