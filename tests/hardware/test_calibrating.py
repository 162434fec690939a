"""Calibrating and teaching on the simulated board, as a dialogue and from the command line."""

import importlib.metadata
import math
import signal
import subprocess
import sys
import time
from datetime import UTC, datetime

import numpy as np
import pytest

import hardware
from hardware import cli
from jaxik import Trajectory, load_trajectory
from jaxik.cli import run

TEMPLATE = hardware.load_joint_map("meccanoid.toml").select(["right_elbow_flexion", "right_wrist_roll"])


def dialogue(lines, template=TEMPLATE, **options):
    """Run a dialogue with these lines; return its result, everything it said, and the board."""
    said, answers = [], iter(lines)

    def ask(prompt):
        said.append(prompt)
        answer = next(answers)
        if isinstance(answer, BaseException):
            raise answer
        return answer

    with hardware.connect("simulated") as board:
        return hardware.calibrate_servos(board, template, ask=ask, say=said.append, **options), said, board


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
    assert done.joints.joints[1].neutral == 1400, "as far as it came"
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


ELBOW = ["100", "a 0", "60", "a 40", "u", "150", "l", "100", "r"]


@pytest.mark.parametrize("end", ["quit", KeyboardInterrupt(), hardware.LinkError("gone"), SystemExit(1)])
def test_nothing_measured_is_lost_however_the_dialogue_ends(end):
    kept = []
    lines = [*ELBOW, "ok", "1400", "n", end]
    if isinstance(end, str | KeyboardInterrupt):
        done, _, board = dialogue(lines, keep=kept.append, practice=False)
        assert done.status is hardware.CalibrationStatus.ENDED_EARLY
        assert done.calibrated == TEMPLATE.names[:1]
        assert done.joints == kept[-1]
        assert board.model.executor.state is hardware.State.DETACHED
    else:
        with pytest.raises(type(end)):
            dialogue(lines, keep=kept.append, practice=False)
    elbow, wrist = kept[-1].joints
    assert elbow.estimates() == ()
    assert elbow.measured.safe is not None
    assert abs((datetime.now(UTC) - elbow.measured.zero).total_seconds()) < 60
    assert (wrist.neutral, wrist.estimates()) == (1400, ("scale", "lower", "upper"))
    assert len(kept) == 6, "after every answer that changed something"


def test_a_joint_that_contradicts_itself_in_between_is_kept_as_far_as_it_does_not():
    kept = []
    dialogue(["100", "n", "60", "u", KeyboardInterrupt()], keep=kept.append, practice=False)
    elbow = kept[-1].joints[0]
    assert elbow.neutral == 100
    assert (elbow.lower, elbow.upper) == (0, pytest.approx(132 / 66.21)), "the estimates, as far as the servo goes"
    assert elbow.measured.zero is not None
    assert elbow.measured.upper is None


def test_practice_marks_nothing_as_measured():
    done, said, _ = dialogue([*ELBOW, "ok", "ok"])
    assert [joint.estimates() for joint in done.joints.joints] == [("zero", "scale", "lower", "upper")] * 2
    _, said, _ = dialogue(["100", "n", "ok", "ok"], practice=False)
    assert "  right_elbow_flexion: still estimates: scale, lower, upper" in said


def test_measured_limits_stay_where_they_are_when_the_zero_moves():
    lines = ["90", "l", "200", "u", "128", "r", "100", "n", "ok", "quit"]
    first = dialogue(lines, practice=False)[0].joints
    again = dialogue(["110", "n", "160", "a 30", "ok", "quit"], first, practice=False)[0].joints
    reversed_again = dialogue(["130", "a 0", "80", "a 30", "ok", "quit"], again, practice=False)[0].joints
    assert reversed_again.joints[0].sign == -again.joints[0].sign
    for joints in (first, again, reversed_again):
        elbow = joints.joints[0]
        ends = np.array([[elbow.lower, 0], [elbow.upper, 0], [elbow.safe, 0]])
        low, high, safe = joints.to_raw(ends)[:, 0]
        assert (*sorted((low, high)), safe) == (90, 200, 128)
        assert elbow.measured.lower is not None
        assert elbow.measured.upper is not None
    estimate = dialogue(["30", "n", "ok", "quit"], practice=False)[0].joints.joints[0]
    assert (estimate.lower, estimate.upper) == (TEMPLATE.joints[0].lower, TEMPLATE.joints[0].upper), "these are angles"


def test_a_servo_unplugged_in_the_middle_ends_the_dialogue_and_loses_nothing():
    kept, board = [], hardware.connect("simulated")

    def ask(prompt):
        if "100" not in prompt:
            return "100" if not kept else "quit"
        if kept:
            board.model.modules[0].modules[3].present = False
            return "200"
        return "n"

    said = r"the board stopped while calibrating: right_elbow_flexion: a smart servo does not answer; .* is kept"
    with board, pytest.raises(hardware.BoardError, match=said):
        hardware.calibrate_servos(board, TEMPLATE, ask=ask, say=lambda line: None, keep=kept.append, practice=False)
    assert kept[-1].joints[0].neutral == 100


def test_a_full_disk_does_not_end_the_dialogue():
    kept = []

    def keep(joints):
        if not kept:
            kept.append(None)
            raise OSError(28, "No space left on device", "mine.toml")
        kept.append(joints)

    _, said, _ = dialogue([*ELBOW, "ok", "quit"], keep=keep, practice=False)
    assert "  not saved: [Errno 28] No space left on device: 'mine.toml'; the next answer tries again" in said
    assert kept[-1].joints[0].estimates() == ()


def answering(monkeypatch, lines):
    """Let the next command of the command line find an Arduino, and these answers."""
    answers = iter(lines)
    monkeypatch.setattr(cli, "ask_in_terminal", lambda board: lambda prompt: next(answers))

    def connect(address, **options):
        board = hardware.SimulatedBoard()
        board.name = address
        return board

    monkeypatch.setattr(cli, "connect", connect)


def test_a_file_is_continued_joint_by_joint(tmp_path, monkeypatch, capsys):
    file, board = tmp_path / "two.toml", "arduino:/dev/none"
    answering(monkeypatch, ["1400", "n", "ok"])
    assert cli.calibrate_servos(file, board, joint=("right_wrist_roll",)) == 0
    answering(monkeypatch, ["1300", "n", "ok"])
    assert cli.calibrate_servos(file, board, joint=("left_wrist_roll",)) == 0
    joints = hardware.load_joint_map(file).select(["right_wrist_roll", "left_wrist_roll"]).joints
    assert [joint.neutral for joint in joints] == [1400, 1300]
    assert all(joint.measured.zero and not joint.measured.scale for joint in joints)
    answering(monkeypatch, [*ELBOW, "ok"])
    assert cli.calibrate_servos(file, board, joint=("right_elbow_flexion",)) == 0
    assert "1 of 12 joints measured; estimates: right_shoulder_swing, " in capsys.readouterr().out
    answering(monkeypatch, ["quit"])
    assert cli.calibrate_servos(file, board) == 1
    said = capsys.readouterr().out
    assert "right_elbow_flexion" not in said.partition("estimates: ")[2].partition("\n")[0]
    assert f"go on with the same command: jaxik calibrate servos {file} --board {board}" in said
    assert [path.name for path in tmp_path.iterdir()] == ["two.toml"]
    with pytest.raises(hardware.CalibrationError, match=r"two\.toml exists and is continued, so --template"):
        cli.calibrate_servos(file, board, template="meccanoid.toml")
    with pytest.raises(hardware.CalibrationError, match="holds measured numbers, which practice on the simulated"):
        cli.calibrate_servos(file)


def test_a_joint_that_the_file_lacks_comes_from_the_template(tmp_path, monkeypatch):
    hardware.save_joint_map(TEMPLATE, tmp_path / "mine.toml")
    answering(monkeypatch, ["1300", "n", "ok"])
    assert cli.calibrate_servos(tmp_path / "mine.toml", "arduino:/dev/none", joint=("left_wrist_roll",)) == 0
    joints = hardware.load_joint_map(tmp_path / "mine.toml")
    assert joints.names == (*TEMPLATE.names, "left_wrist_roll")
    assert joints.joints[:2] == TEMPLATE.joints
    with pytest.raises(hardware.CalibrationError, match="lacks tail; it has right_elbow_flexion"):
        cli.calibrate_servos(tmp_path / "mine.toml", "arduino:/dev/none", joint=("tail",))


@pytest.mark.parametrize(
    ("channels", "said"),
    [(("D2", "D8/1"), "dry run as on an Arduino"), (("", ""), "names no channels"), (("1", "2"), "as on a servo bus")],
)
def test_a_dry_run_says_which_board_it_stands_for(tmp_path, capsys, channels, said):
    servos = {"D2": (500, 2500, 1500.0, 636.62, False)}
    joints = []
    for name, channel in zip("ab", channels, strict=True):
        low, high, neutral, scale, readback = servos.get(channel, (24, 232, 128.0, 66.2, True))
        joints.append(
            hardware.JointCalibration(name, low, high, neutral, scale, 1, -1.0, 1.0, 1.0, 0.0, readback, channel)
        )
    hardware.save_joint_map(hardware.JointMap("x", tuple(joints)), tmp_path / "x.toml")
    Trajectory(np.array([0.0, 1.0]), np.zeros((2, 2)), ("a", "b")).save(tmp_path / "x.csv")
    assert cli.play(tmp_path / "x.csv", calibration=str(tmp_path / "x.toml")) == 0
    assert said in capsys.readouterr().out


@pytest.mark.parametrize("place", ["missing/mine.toml", ""])
def test_a_file_that_cannot_be_written_is_refused_before_the_work(tmp_path, monkeypatch, place):
    answering(monkeypatch, [])
    with pytest.raises(OSError, match=str(tmp_path / place)) as caught:
        cli.calibrate_servos(tmp_path / place, "arduino:/dev/none")
    assert caught.value.filename == str(tmp_path / place)


def test_a_killed_calibration_has_kept_every_answer(tmp_path):
    """Also without any chance to save at the end: the file is complete after every answer."""
    program = (
        "import sys; from pathlib import Path; from hardware import cli; "
        "cli.calibrate_servos(Path('mine.toml'), joint=('right_wrist_roll',))"
    )
    child = subprocess.Popen(
        [sys.executable, "-c", program], cwd=tmp_path, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    child.stdin.write("1510\nn\n")
    child.stdin.flush()
    end = time.monotonic() + 60
    while not (tmp_path / "mine.toml").exists() and time.monotonic() < end:
        time.sleep(0.02)
    child.send_signal(signal.SIGKILL)
    child.communicate()
    (joint,) = hardware.load_joint_map(tmp_path / "mine.toml").select(["right_wrist_roll"]).joints
    assert joint.neutral == 1510
    assert [path.name for path in tmp_path.iterdir()] == ["mine.toml"]


def test_a_real_board_moves_estimates_only_with_consent(tmp_path, monkeypatch, capsys):
    measured = dialogue([*ELBOW, "ok", "1400", "n", "ok"], practice=False)[0].joints
    hardware.save_joint_map(measured, tmp_path / "mine.toml")
    elbow, both = measured.names[:1], measured.names
    for names in (elbow, both):
        Trajectory(np.array([0.0, 1.0]), np.zeros((2, len(names))), names).save(tmp_path / f"{len(names)}.csv")
    answering(monkeypatch, [])
    play = lambda count, **options: cli.play(  # noqa: E731
        tmp_path / f"{count}.csv", "arduino:/dev/none", calibration=str(tmp_path / "mine.toml"), **options
    )
    assert play(1) == 0, "the elbow is measured"
    assert "estimates" not in capsys.readouterr().out
    said = r"arduino:/dev/none would move joints by estimates: right_wrist_roll \(scale, lower, upper\); measure them"
    with pytest.raises(hardware.CalibrationError, match=said):
        play(2)
    assert play(2, estimates=True) == 0
    monkeypatch.setattr("sys.stdin", type("Terminal", (), {"isatty": lambda self: True, "fileno": lambda self: 0})())
    for answer, result in (("y", 0), ("", None), ("no", None)):
        monkeypatch.setattr("builtins.input", lambda prompt, answer=answer: answer)
        if result is None:
            with pytest.raises(hardware.CalibrationError, match="nothing was moved"):
                play(2)
        else:
            assert play(2) == result
    assert "not measured, estimates: right_wrist_roll (scale, lower, upper)" in capsys.readouterr().out


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
        cli.play(tmp_path / "taught.csv", board="arduino:/dev/none", calibration="meccanoid.toml", estimates=True)
    capsys.readouterr()


def test_a_command_of_two_words(monkeypatch, capsys):
    point = importlib.metadata.EntryPoint("calibrate-servos", "hardware.cli:calibrate_servos", "jaxik.commands")
    monkeypatch.setattr("jaxik.cli.program.entry_points", lambda group: [point])
    assert run(["calibrate", "servos", "--help"]) == 0
    assert "usage: jaxik calibrate servos" in capsys.readouterr().out
    assert run(["calibrate", "other"]) == 2
    assert "no command 'calibrate'; there are calibrate servos" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("keys", "code", "said"), [(b"\x03", 130, "stopped by SIGINT"), (b"n\n", 1, "nothing was moved")]
)
def test_the_question_before_estimates_move_in_a_terminal(tmp_path, keys, code, said):
    """Also Ctrl-C answers it."""
    Trajectory(np.array([0.0, 1.0]), np.zeros((2, 1)), TEMPLATE.names[:1]).save(tmp_path / "x.csv")
    play = "import sys; from jaxik.cli import run; sys.exit(run(sys.argv[1:]))"
    terminal = (
        "import os, pty, sys; "
        "sys.exit(os.waitstatus_to_exitcode(pty.spawn([sys.executable, '-c', sys.argv[1], *sys.argv[2:]])))"
    )
    words = ["play", "x.csv", "--calibration", "meccanoid.toml", "--board", "arduino:/dev/none"]
    child = subprocess.Popen(
        [sys.executable, "-c", terminal, play, *words], cwd=tmp_path, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert child.stdin is not None
    assert child.stdout is not None
    shown = b""
    while b"[y/N]" not in shown and (part := child.stdout.read1()):
        shown += part
    time.sleep(0.1)
    rest, _ = child.communicate(keys, timeout=60)
    assert child.returncode == code, (shown + rest).decode()
    assert said in (shown + rest).decode()
