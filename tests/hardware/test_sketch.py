"""The firmware's folder as a sketch of the Arduino IDE: it builds there without make, and does the same."""

import re

import numpy as np

from hardware import PlayResult
from tests.helpers import firmware
from tests.helpers.firmware import CYCLES_PER_US, FIRMWARE, bench
from tests.helpers.playing import play_over, plug_in, pulse_errors, standing, whole_robot


def test_the_folder_is_a_sketch():
    """The IDE opens a folder by the file of the same name, and builds what lies beside it, with one rate."""
    text = (FIRMWARE / f"{FIRMWARE.name}.ino").read_text()
    assert all(line.startswith("//") for line in text.splitlines()), "main() is the firmware's own"
    assert "#define BAUD 115200UL" in (FIRMWARE / "settings.h").read_text()
    makefile = (FIRMWARE / "Makefile").read_text()
    assert "BAUD ?= 115200" in makefile
    objects = re.search(r"OBJECTS := .*", makefile)
    assert objects is not None
    assert sorted(re.findall(r"(\w+)\.o", objects[0])) == sorted(path.stem for path in FIRMWARE.glob("*.c"))


def test_the_ides_binary_plays_as_the_makefiles_does():
    trajectory, joints = whole_robot(2.0)
    errors = {}
    for ide in (False, True):
        with bench(ide=ide) as chip:
            plug_in(chip, joints)
            played = play_over(chip, trajectory, joints, park=False)
            assert played.report.result is PlayResult.SUCCESS
            pulses = chip.pulses()
            widths = pulses[:, 2] / CYCLES_PER_US
            at = pulses[:, 0] / chip.cycles_per_us * 1e-6, pulses[:, 1], widths
            errors[ide] = pulse_errors(*at, trajectory, joints, standing(joints), played.starts_s[0])
    assert len(errors[True]) > 300
    assert np.sqrt(np.mean(errors[True] ** 2)) <= 1.5
    assert abs(np.std(errors[True]) / np.std(errors[False]) - 1) < 0.1
    size = firmware.run("avr-size", firmware.sketch()).splitlines()[1].split()
    assert int(size[1]) + int(size[2]) <= 1664, "static memory, as the Makefile allows"
