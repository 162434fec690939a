"""Recordings by hand are kept whatever happens, and the arm is limp no sooner than announced."""

import errno
import os
import signal
from pathlib import Path

import numpy as np
import pytest

import hardware
from hardware import State, cli
from hardware.recording_file import RecordingFile
from hardware.stop_signals import stop_signals
from hardware.teaching import RecordingWarning
from jaxik import Trajectory, load_trajectory
from jaxik.errors import FileFormatError

JOINTS = hardware.load_joint_map("meccanoid.toml")
RECORDING = Trajectory(np.arange(3.0), np.zeros((3, len(JOINTS.names))), JOINTS.names)


def test_ctrl_c_keeps_what_was_recorded():
    with hardware.connect("simulated") as board, stop_signals() as signals:

        def stop(fraction):
            if fraction > 0.5:
                signals.take(signal.SIGINT)

        with pytest.warns(RecordingWarning, match=r"the recording ended after 2\.\d s: stopped by SIGINT"):
            taught = hardware.record(board, JOINTS, 4.0, progress=stop)
        assert board.status().state is State.DETACHED
    assert 2.0 < taught.duration < 2.8
    assert taught.notes[-1] == "ended early: stopped by SIGINT"


def test_a_fault_keeps_what_was_recorded():
    with hardware.connect("simulated") as board:

        def unplug(fraction):
            if fraction > 0.5:
                board.model.modules[0].unplug(2)

        with pytest.warns(RecordingWarning, match="right_upper_arm_roll: a smart servo does not answer"):
            taught = hardware.record(board, JOINTS, 4.0, progress=unplug)
        assert taught.duration > 2.0


def test_a_link_that_dies_keeps_what_was_recorded():
    with hardware.connect("simulated", unplugged_at_s=4.0) as board:
        with pytest.warns(RecordingWarning, match="is the cable or radio link still there"):
            taught = hardware.record(board, JOINTS, 9.0)
        assert taught.duration > 1.0


def test_nothing_recorded_is_the_error_itself():
    with (
        hardware.connect("simulated", unplugged_at_s=0.3) as board,
        pytest.raises(hardware.LinkError, match="is the cable"),
    ):
        hardware.record(board, JOINTS, 1.0)


def test_enter_ends_a_recording():
    asked = iter(range(1000))
    with hardware.connect("simulated") as board:
        taught = hardware.record(board, JOINTS, 100.0, until=lambda: next(asked) == 50)
    assert 1.5 < taught.duration < 3.5


def test_every_posture_is_on_the_disk_at_once(tmp_path):
    file = RecordingFile(tmp_path / "wave.npz", JOINTS)
    for k in range(5):
        file.add(0.04 * k, np.full(len(JOINTS.names), 0.1 * k))
    left = load_trajectory(tmp_path / "wave.part.csv")  # as after SIGKILL
    assert len(left) == 5
    assert left.joint_names == JOINTS.names
    np.testing.assert_array_equal(left.q[:, 3], 0.1 * np.arange(5))
    assert file.save(RECORDING) == tmp_path / "wave.npz"
    assert os.listdir(tmp_path) == ["wave.npz"]
    assert load_trajectory(tmp_path / "wave.npz") == RECORDING


@pytest.mark.parametrize(
    ("name", "error", "said"),
    [
        ("wave.txt", FileFormatError, r"expected a trajectory's name to end in .npz, .csv, .json; got '.txt'"),
        ("none/wave.npz", FileNotFoundError, r"No such file or directory: '.*none/wave\.npz'"),
        (".npz", FileFormatError, "expected a trajectory's name to end in"),
    ],
)
def test_the_place_is_checked_before_anything_moves(tmp_path, monkeypatch, name, error, said):
    monkeypatch.setattr(cli, "connect", lambda *words, **options: pytest.fail("too late"))
    with pytest.raises(error, match=said):
        cli.teach(tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_a_recording_that_does_not_fit_goes_elsewhere(tmp_path, monkeypatch):
    home = tmp_path / "home"
    home.mkdir()
    monkeypatch.setattr(Path, "home", lambda: home)
    save = Trajectory.save

    def full(self, file):
        if Path(file).name == "wave.csv":
            raise OSError(errno.ENOSPC, "No space left on device")
        save(self, file)

    monkeypatch.setattr(Trajectory, "save", full)
    file = RecordingFile(tmp_path / "wave.csv", JOINTS)
    kept = file.save(RECORDING)
    assert kept.parent == home
    assert load_trajectory(kept) == RECORDING


def test_a_recording_that_fits_nowhere_says_where_its_postures_are(tmp_path, monkeypatch):
    file = RecordingFile(tmp_path / "wave.npz", JOINTS)
    file.add(0.0, np.zeros(len(JOINTS.names)))
    file.add(0.1, np.zeros(len(JOINTS.names)))

    def full(self, place):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Trajectory, "save", full)
        with pytest.raises(OSError, match=r"wave\.npz: .*No space left on device; the recording is.*wave\.part\.csv"):
            file.save(RECORDING)
    file.close()
    assert len(load_trajectory(tmp_path / "wave.part.csv")) == 2


def test_the_command_counts_down_and_leaves_one_file(tmp_path, capsys):
    assert cli.teach(tmp_path / "wave.npz", seconds=0.5) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert said.index("these will go limp, so hold the arm: right_shoulder_swing") < said.index("limp in 3 ...")
    assert said.index("limp in 1 ...") < said.index("replay it: jaxik play")
    assert os.listdir(tmp_path) == ["wave.npz"]
