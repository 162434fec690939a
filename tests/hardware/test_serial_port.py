"""The firmware behind pyserial and a pseudo-terminal, in real time."""

import threading

import numpy as np
import pytest

import hardware
from hardware import PlayResult
from hardware.boards import arduino
from jaxik import Trajectory
from tests.helpers.firmware import Bench, require
from tests.helpers.pty_board import PtyBoard

JOINTS = hardware.load_joint_map("meccanoid.toml").select(["right_elbow_flexion", "right_wrist_roll"])
TIMES = np.linspace(0.0, 1.0, 26)
TRAJECTORY = Trajectory(TIMES, np.stack([0.3 * TIMES, 0.5 * np.sin(3 * TIMES)], -1), JOINTS.names)


@pytest.fixture
def port(monkeypatch):
    require()
    monkeypatch.setattr(arduino, "_BOOT_S", 0.0)
    chip = Bench()
    for place in range(4):
        chip.module(0, place, True, 41)
    carrier = PtyBoard(chip)
    yield carrier
    carrier.close()
    chip.close()


def test_a_playback_over_a_real_port(port):
    with hardware.connect(f"arduino:{port.port}") as board:
        assert board.hello.firmware == 2
        report = hardware.play(TRAJECTORY, board, JOINTS, park=False)
    assert report.result is PlayResult.SUCCESS, report.message
    assert abs(port.chip.position(0, 3) - JOINTS.to_raw(TRAJECTORY.q[-1])[0]) <= 1
    widths = port.chip.pulses()[:, 2] / 16
    planned = JOINTS.to_raw(TRAJECTORY.q)[:, 1]
    assert planned.min() - 1 <= widths.min()
    assert widths.max() <= planned.max() + 1


def test_a_port_that_vanishes_is_a_lost_link(port):
    with hardware.connect(f"arduino:{port.port}") as board:
        threading.Timer(1.2, port.vanish).start()
        report = hardware.play(TRAJECTORY, board, JOINTS)
    assert report.result is PlayResult.LINK_LOST
    assert "the link to the board is gone" in report.message
    assert "could not be released" in report.warnings[-1]


def test_a_port_that_is_in_use(port):
    with (
        hardware.connect(f"arduino:{port.port}"),
        pytest.raises(hardware.BoardError, match="does another program hold it"),
    ):
        hardware.connect(f"arduino:{port.port}")


def test_a_port_without_a_board(monkeypatch):
    import os

    monkeypatch.setattr(arduino, "_BOOT_S", 0.0)
    master, slave = os.openpty()
    with pytest.raises(hardware.LinkError, match="likely causes: it has no power, the wrong port or baud rate"):
        hardware.connect(f"arduino:{os.ttyname(slave)}")
    os.close(master)
    os.close(slave)
