"""Calibrating and teaching on the simulated board, as a dialogue and from the command line."""

import importlib.metadata
import math

import numpy as np
import pytest

import hardware
from hardware import cli
from jaxik import load_trajectory
from jaxik.cli import run

TEMPLATE = hardware.load_joint_map("meccanoid.toml").select(["right_elbow_flexion", "right_wrist_roll"])


def dialogue(lines):
    """Run a dialogue with these lines; return its result, everything it said, and the board."""
    said, answers = [], iter(lines)

    def ask(prompt):
        said.append(prompt)
        return next(answers)

    with hardware.connect("simulated") as board:
        return hardware.calibrate_servos(board, TEMPLATE, ask=ask, say=said.append), said, board


def test_a_whole_dialogue(tmp_path):
    done, said, board = dialogue(
        [
            "128",
            "n",
            "62",
            "a -60",
            "+6",
            "l",
            "200",
            "u",
            "128",
            "r",
            "ok",
            *("1400", "n", "s", "1000", "u", "2000", "l", "ok"),
        ]
    )
    assert done.ok
    assert done.status is hardware.CalibrationStatus.OK
    assert done.raise_if_invalid() is done
    assert done.calibrated == TEMPLATE.names
    elbow, wrist = done.joints.joints
    assert elbow.neutral == pytest.approx(128)
    assert elbow.raw_per_rad == pytest.approx(66 / math.radians(60))
    assert elbow.sign == 1
    assert math.degrees(elbow.lower) == pytest.approx(-60 * 60 / 66)
    assert math.degrees(elbow.upper) == pytest.approx(72 * 60 / 66)
    assert elbow.safe == pytest.approx(0)
    assert (wrist.neutral, wrist.sign) == (1400, -1)
    assert math.degrees(wrist.upper) == pytest.approx(400 / 636.62 * 180 / math.pi, abs=0.01)
    assert board.log[-1].commanded[1] > 1980, "the servo went there"
    steps = np.abs(np.diff([frame.commanded for frame in board.log], axis=0)).max(0)
    assert steps[1] <= math.radians(30) * 636.62 * 0.02 + 1, "slowly"
    hardware.save_joint_map(done.joints, tmp_path / "mine.toml")
    again = hardware.load_joint_map(tmp_path / "mine.toml")
    np.testing.assert_allclose(
        again.to_rad(np.array([100, 1200])), done.joints.to_rad(np.array([100, 1200])), atol=1e-6
    )
    assert again.joints[0].channel == "D8/4"
    assert list(tmp_path.iterdir()) == [tmp_path / "mine.toml"]
    assert any("raw 200" in line for line in said)


def test_a_wrong_answer_is_refused_and_asked_again():
    done, said, _ = dialogue(["9", "a x", "hello you", "a 0", "a 10", "l", "u", "ok", "quit"])
    assert not done.ok
    text = "\n".join(said)
    assert "takes raw 24 to 232; got 9" in text
    assert "two angles need two different positions" in text
    assert "no such command: hello you" in text
    assert "is neither a number nor a command" in text
    assert "not yet: limits_deg must rise" in text


def test_two_angles_give_the_sign():
    done, _, _ = dialogue(["100", "a 0", "60", "a 40", "l", "50", "u", "s", "s", "100", "r", "quit"])
    assert not done.ok
    done, _, _ = dialogue(["100", "a 0", "60", "a 40", "u", "150", "l", "100", "r", "ok", "ok"])
    assert done.joints.joints[0].sign == -1


def test_a_dialogue_that_ends_early_keeps_the_joints_that_are_done():
    done, _, _ = dialogue(["100", "a 0", "60", "a 40", "u", "150", "l", "100", "r", "ok", "1400", "n", "quit"])
    assert done.status is hardware.CalibrationStatus.ENDED_EARLY
    assert not done.ok
    assert done.calibrated == TEMPLATE.names[:1]
    assert done.joints.joints[0].sign == -1
    assert done.joints.joints[1] == TEMPLATE.joints[1], "as in the template"
    with pytest.raises(hardware.CalibrationError, match="1 of 2 joints of 'meccanoid' were calibrated: ended before"):
        done.raise_if_invalid()


def test_a_limp_joint_reports_where_a_hand_puts_it():
    board = hardware.connect("simulated")
    said, lines = [], iter(["t", "n", "t", "quit"])

    def ask(prompt):
        said.append(prompt)
        board.model.modules[0].modules[3].hand = 90
        for _ in range(8):
            board.clock.sleep(0.05)
            board.status()
        return next(lines)

    with board:
        assert not hardware.calibrate_servos(board, TEMPLATE, ask=ask, say=said.append).ok
    assert "raw 90, 0.0°" in said[-1]
    _, said, _ = dialogue(["ok", "t", "quit"])
    assert "  the joint has no read-back: its position by hand is unknown; move it by raw values" in said


def test_teaching_and_replaying(tmp_path):
    joints = hardware.load_joint_map("meccanoid.toml").select(
        [f"right_{name}" for name in ("elbow_flexion", "wrist_roll")]
    )
    board = hardware.connect("simulated")
    elbow = board.model.modules[0].modules[3]

    def by_hand(fraction):
        elbow.hand = round(60 + 60 * math.sin(math.pi * fraction))

    with board:
        taught = hardware.record(board, joints, 4.0, progress=by_hand)
    assert taught.joint_names == joints.names
    assert np.ptp(taught.q[:, 1]) == 0, "the wrist has no read-back"
    reached = joints.to_rad(np.array([120, 1500]))[0]
    assert taught.q[:, 0].max() == pytest.approx(reached, abs=0.06)
    taught.save(tmp_path / "wave.npz")
    with hardware.connect("simulated") as board:
        report = hardware.play(load_trajectory(tmp_path / "wave.npz"), board, joints)
    assert report.ok, report.message


def test_a_hand_too_fast_is_slowed_down():
    joints = hardware.load_joint_map("meccanoid.toml").select(["right_elbow_flexion"])
    board = hardware.connect("simulated")
    with board:
        taught = hardware.record(
            board,
            joints,
            2.0,
            progress=lambda fraction: setattr(board.model.modules[0].modules[3], "hand", 41 + 170 * (fraction > 0.5)),
        )
    assert "slowed down" in taught.notes[1]
    assert np.abs(taught.qd).max() <= joints.column("max_rate")[0]


def test_teaching_needs_a_servo_that_can_be_taught():
    joints = hardware.load_joint_map("meccanoid.toml").select(["right_wrist_roll"])
    with hardware.connect("simulated") as board:
        with pytest.raises(hardware.CalibrationError, match="none can be taught by hand"):
            hardware.record(board, joints, 1.0)
        with pytest.raises(ValueError, match="a duration above 0 s; got 0"):
            hardware.record(board, joints, 0.0)


def test_from_the_command_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    answers = iter(["n", "ok"])
    monkeypatch.setattr(cli, "ask_in_terminal", lambda board: lambda prompt: next(answers))
    assert cli.calibrate_servos(tmp_path / "mine.toml", joint=("right_elbow_flexion",)) == 0
    assert len(hardware.load_joint_map("mine.toml").joints) == 12, "the others stay as the template has them"
    assert cli.teach(tmp_path / "taught.csv", seconds=0.5) == 0
    assert cli.play(tmp_path / "taught.csv", calibration="meccanoid.toml") == 0
    with pytest.raises(hardware.CalibrationError, match="needs --calibration FILE: make one with"):
        cli.play(tmp_path / "taught.csv", board="arduino:/dev/none")
    with pytest.raises(hardware.BoardError, match=r"/dev/none cannot be opened: .*there (is|are)"):
        cli.play(tmp_path / "taught.csv", board="arduino:/dev/none", calibration="meccanoid.toml")
    capsys.readouterr()


def test_a_command_of_two_words(monkeypatch, capsys):
    point = importlib.metadata.EntryPoint("calibrate-servos", "hardware.cli:calibrate_servos", "jaxik.commands")
    monkeypatch.setattr("jaxik.cli.program.entry_points", lambda group: [point])
    assert run(["calibrate", "servos", "--help"]) == 0
    assert "usage: jaxik calibrate servos" in capsys.readouterr().out
    assert run(["calibrate", "other"]) == 2
    assert "no command 'calibrate'; there are calibrate servos" in capsys.readouterr().err
