"""The firmware's bench: its own execution of instructions is exact, and a run ends on its cycle."""

import numpy as np

from tests.helpers import firmware
from tests.helpers.firmware import BENCH, bench
from tests.helpers.playing import BLUETOOTH, MECCANOID, play_over, plug_in, ramp, ready, whole_robot

KINDS = 74  # of instructions in core.c


def test_random_programs_run_alike_in_simavr_and_in_the_bench(tmp_path):
    firmware.require()
    program = tmp_path / "check"
    firmware.run("gcc", "-O2", "-Wall", BENCH / "check.c", BENCH / "core.c", "-o", program, "-lsimavr", "-lelf")
    count, kinds = (int(word) for word in firmware.run(program, "200").split() if word.isdigit())
    assert count > 500_000
    assert kinds == KINDS, "every kind has run"


def test_a_playback_is_the_same_to_the_cycle_in_plain_simavr():
    def played(plain):
        trajectory, joints = whole_robot(2.0)
        with bench(plain=plain, skew=0.003) as chip:
            plug_in(chip, joints)
            play_over(chip, trajectory, joints, link=BLUETOOTH, stop_within_s=0.5, park=False)
            return [chip.edges, chip.sent, chip.packets, chip.memory(), chip.cycles]

    quick, plain = played(plain=False), played(plain=True)
    assert quick[3:] == plain[3:]
    for ours, theirs in zip(quick[:3], plain[:3], strict=True):
        assert len(ours) > 100
        for name in ours.dtype.names:
            np.testing.assert_array_equal(ours[name], theirs[name])


def test_a_run_ends_on_its_cycle_asleep_or_awake():
    with bench() as chip:
        plug_in(chip, MECCANOID)
        board = ready(chip)
        ramp(board, 0.7)
        board.start(0)
        worst = 0
        for at in range(chip.now_us, chip.now_us + 60_000):
            chip.run(at)
            worst = max(worst, chip.cycles - chip.cycle(at))
        assert worst < 16
