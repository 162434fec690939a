"""Calibrating and teaching against the simulated board, as a dialogue and from the command line."""

import importlib.metadata
import math

import numpy as np
import pytest

import hardware
from hardware import cli
from hardware.servo_calibration import ServoCalibration
from jaxik import load_trajectory
from jaxik.cli import run

TEMPLATE = hardware.load_joint_map("meccanoid.toml").select(["right_elbow_flexion", "right_wrist_roll"])


def dialogue(lines, template=TEMPLATE, robot=None):
    """Runs it with these lines; what was written, and what was said."""
    said, answers = [], iter(lines)

    def ask(prompt):
        said.append(prompt)
        return next(answers)

    with robot or hardware.connect("simulated") as board:
        return ServoCalibration(board, template, ask, said.append).run(), said, board


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
    elbow, wrist = done.joints
    assert elbow.neutral == pytest.approx(128)
    assert elbow.raw_per_rad == pytest.approx(66 / math.radians(60))
    assert elbow.sign == 1
    assert math.degrees(elbow.lower) == pytest.approx(-60 * 60 / 66)
    assert math.degrees(elbow.upper) == pytest.approx(72 * 60 / 66)
    assert elbow.safe == pytest.approx(0)
    assert (wrist.neutral, wrist.sign) == (1400, -1)
    assert math.degrees(wrist.upper) == pytest.approx(400 / 636.62 * 180 / math.pi, abs=0.01)
    assert board.log[-1].commanded[1] > 1980, "the servo really went there"
    steps = np.abs(np.diff([pulse.commanded for pulse in board.log], axis=0)).max(0)
    assert steps[1] <= math.radians(30) * 636.62 * 0.02 + 1, "slowly"
    hardware.save_joint_map(done, tmp_path / "mine.toml")
    again = hardware.load_joint_map(tmp_path / "mine.toml")
    np.testing.assert_allclose(again.to_rad(np.array([100, 1200])), done.to_rad(np.array([100, 1200])), atol=1e-6)
    assert again.joints[0].channel == "D8/4"
    assert list(tmp_path.iterdir()) == [tmp_path / "mine.toml"]
    assert any("raw 200" in line for line in said)


def test_what_cannot_be_is_said_and_asked_again():
    done, said, _ = dialogue(["9", "a x", "hello you", "a 0", "a 10", "l", "u", "ok", "quit"])
    assert done is None
    told = "\n".join(said)
    assert "takes raw 24 to 232; got 9" in told
    assert "two angles need two different places" in told
    assert "no such command: hello you" in told
    assert "is neither a number nor a command" in told
    assert "not yet: limits_deg must rise" in told


def test_a_sign_that_two_angles_say():
    done, _, _ = dialogue(["100", "a 0", "60", "a 40", "l", "50", "u", "s", "s", "100", "r", "quit"])
    assert done is None
    done, _, _ = dialogue(["100", "a 0", "60", "a 40", "u", "150", "l", "100", "r", "ok", "ok"])
    assert done.joints[0].sign == -1


def test_a_limp_joint_says_where_the_hand_puts_it():
    robot = hardware.connect("simulated")
    said, lines = [], iter(["t", "n", "t", "quit"])

    def ask(prompt):
        said.append(prompt)
        robot.model.modules[0].modules[3].hand = 90
        for _ in range(8):
            robot.clock.sleep(0.05)
            robot.status()
        return next(lines)

    with robot:
        assert ServoCalibration(robot, TEMPLATE, ask, said.append).run() is None
    assert "raw 90, 0.0°" in said[-1]
    assert (
        dialogue(["ok", "t", "quit"])[1].count("  it has no read-back, so it cannot say where a hand has put it") == 1
    )


def test_teaching_and_replaying(tmp_path):
    joints = hardware.load_joint_map("meccanoid.toml").select(
        [f"right_{name}" for name in ("elbow_flexion", "wrist_roll")]
    )
    robot = hardware.connect("simulated")
    elbow = robot.model.modules[0].modules[3]

    def by_hand(share):
        elbow.hand = round(60 + 60 * math.sin(math.pi * share))

    with robot:
        taught = hardware.record(robot, joints, 4.0, progress=by_hand)
    assert taught.joint_names == joints.names
    assert np.ptp(taught.q[:, 1]) == 0, "the wrist has no read-back"
    reached = joints.to_rad(np.array([120, 1500]))[0]
    assert taught.q[:, 0].max() == pytest.approx(reached, abs=0.06)
    taught.save(tmp_path / "wave.npz")
    with hardware.connect("simulated") as robot:
        report = hardware.play(load_trajectory(tmp_path / "wave.npz"), robot, joints)
    assert report.ok, report.message


def test_a_hand_too_fast_is_slowed_down():
    joints = hardware.load_joint_map("meccanoid.toml").select(["right_elbow_flexion"])
    robot = hardware.connect("simulated")
    with robot:
        taught = hardware.record(
            robot,
            joints,
            2.0,
            progress=lambda share: setattr(robot.model.modules[0].modules[3], "hand", 41 + 170 * (share > 0.5)),
        )
    assert "slowed down" in taught.notes[1]
    assert np.abs(taught.qd).max() <= joints.column("max_rate")[0]


def test_teaching_needs_a_servo_that_can_be_taught():
    joints = hardware.load_joint_map("meccanoid.toml").select(["right_wrist_roll"])
    with hardware.connect("simulated") as robot:
        with pytest.raises(hardware.CalibrationError, match="none can be taught by hand"):
            hardware.record(robot, joints, 1.0)
        with pytest.raises(ValueError, match="a duration above 0 s; got 0"):
            hardware.record(robot, joints, 0.0)


def test_from_the_command_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    answers = iter(["n", "ok"])
    monkeypatch.setattr(cli, "ask_in_terminal", lambda robot: lambda prompt: next(answers))
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
