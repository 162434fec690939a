"""The bench that the firmware's tests stand on: its own quick way with instructions, and where a run ends."""

import numpy as np

from tests.helpers import firmware
from tests.helpers.firmware import BENCH, bench
from tests.helpers.playing import BLUETOOTH, MECCANOID, play_over, plug_in, ramp, ready, whole_robot

KINDS = 74  # that core.c knows


def test_random_programs_do_the_same_in_simavr_and_in_the_bench(tmp_path):
    firmware.require()
    program = tmp_path / "check"
    firmware.run("gcc", "-O2", "-Wall", BENCH / "check.c", BENCH / "core.c", "-o", program, "-lsimavr", "-lelf")
    count, kinds = (int(word) for word in firmware.run(program, "200").split() if word.isdigit())
    assert count > 500_000
    assert kinds == KINDS, "all were tried"


def test_a_playback_is_the_same_to_the_cycle_without_the_quick_way():
    def played(plain):
        trajectory, joints = whole_robot(2.0)
        with bench(plain=plain, skew=0.003) as board:
            plug_in(board, joints)
            play_over(board, trajectory, joints, link=BLUETOOTH, stop_within_s=0.5, park=False)
            return [board.edges, board.sent, board.packets, board.memory(), board.cycles]

    quick, plain = played(plain=False), played(plain=True)
    assert quick[3:] == plain[3:]
    for ours, theirs in zip(quick[:3], plain[:3], strict=True):
        assert len(ours) > 100
        for name in ours.dtype.names:
            np.testing.assert_array_equal(ours[name], theirs[name])


def test_a_run_ends_where_it_shall_asleep_or_awake():
    with bench() as board:
        plug_in(board, MECCANOID)
        device = ready(board)
        ramp(device, 0.7)
        device.start(0)
        worst = 0
        for at in range(board.now_us, board.now_us + 60_000):
            board.run(at)
            worst = max(worst, board.cycles - board.cycle(at))
        assert worst < 16
