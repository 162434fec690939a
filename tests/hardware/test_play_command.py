"""``jaxik play`` and ``jaxik home``: rounds, log, what is said before, exit codes, and the page in the browser."""

import json
import signal
import urllib.request

import numpy as np
import pytest

import hardware
from hardware import cli, play_screen
from hardware.boards.maestro import MaestroBoard
from hardware.clock import VirtualClock
from hardware.live_view import LiveView
from hardware.stop_signals import stop_signals
from jaxik import Trajectory, presets
from jaxik.cli import InputError
from tests.helpers.servo_bus import Maestro
from tests.helpers.urdf_text import two_arms

TIME = np.linspace(0.0, 1.0, 51)
JOINTS = hardware.load_joint_map("meccanoid.toml").select(["right_wrist_roll", "left_wrist_roll"])
MOTION = Trajectory(TIME, 0.3 * np.sin(2 * np.pi * TIME)[:, None] * [1.0, -1.0], JOINTS.names)


@pytest.fixture
def motion(tmp_path):
    MOTION.save(tmp_path / "motion.npz")
    return tmp_path / "motion.npz"


def said(capsys):
    return " ".join(capsys.readouterr().out.split())


def test_rounds_and_a_log(motion, tmp_path, capsys):
    log = tmp_path / "log.npz"
    assert cli.play(motion, calibration="meccanoid.toml", loop=3, log=log, json=True) == 0
    assert json.loads(capsys.readouterr().out)["duration"] > 4.5
    played = np.load(log)
    assert played["joint_names"].tolist() == list(JOINTS.names)
    assert (np.diff((played["phase"] == "play").astype(int)) == 1).sum() == 1, "a closed motion goes on without a break"


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_exit_codes_of_signals(number, code, motion, monkeypatch, capsys):
    play = cli.play_trajectory

    def interrupted(*words, **options):
        with stop_signals() as signals:
            return play(*words, **(options | {"progress": lambda fraction: fraction > 0.3 and signals.take(number)}))

    monkeypatch.setattr(cli, "play_trajectory", interrupted)
    assert cli.play(motion, calibration="meccanoid.toml", loop=0) == code
    assert f"ABORTED: stopped by {signal.Signals(number).name}" in said(capsys)


def test_a_signal_before_anything_is_driven_ends_the_command_too(motion, monkeypatch, capsys):
    def connect(*words, **options):
        with stop_signals() as signals:
            signals.take(signal.SIGTERM)

    monkeypatch.setattr(cli, "connect", connect)
    assert cli.play(motion, calibration="meccanoid.toml") == 143
    assert "stopped by SIGTERM" in capsys.readouterr().err


def test_hold_holds_until_the_next_signal(motion, monkeypatch, capsys):
    play, hold = cli.play_trajectory, play_screen.keep_holding

    def interrupted(*words, **options):
        with stop_signals() as signals:
            stop = lambda fraction: fraction > 0.3 and signals.take(signal.SIGINT)  # noqa: E731
            return play(*words, **(options | {"progress": stop}))

    def held(board, until):
        began = board.clock.now()
        with stop_signals() as signals:
            hold(board, lambda: board.clock.now() > began + 5 and (signals.take(signal.SIGINT) or until()))
        assert board.clock.now() > began + 5
        assert board.status().state is hardware.State.HOLDING

    monkeypatch.setattr(cli, "play_trajectory", interrupted)
    monkeypatch.setattr(play_screen, "keep_holding", held)
    assert cli.play(motion, calibration="meccanoid.toml", on_stop="hold") == 130
    assert "holding: Ctrl-C once more releases the arm" in said(capsys)


def test_home_goes_to_the_safe_pose(capsys, monkeypatch):
    boards = []
    connect = cli.connect
    monkeypatch.setattr(
        cli, "connect", lambda *words, **options: boards.append(connect(*words, **options)) or boards[0]
    )
    assert cli.home("meccanoid.toml") == 0
    joints = hardware.load_joint_map("meccanoid.toml")
    np.testing.assert_array_equal(boards[0].log[-1].commanded, joints.to_raw(joints.column("safe")))
    assert boards[0].model.executor.state is hardware.State.DETACHED


def test_a_board_without_a_watchdog_is_named_before_it_moves(motion, monkeypatch, capsys):
    board = MaestroBoard("/dev/ttyACM0", transport=Maestro(), clock=VirtualClock())
    monkeypatch.setattr(cli, "connect", lambda *words, **options: board)
    rows = [hardware.JointCalibration(**(vars(joint) | {"channel": str(i)})) for i, joint in enumerate(JOINTS.joints)]
    monkeypatch.setattr(cli, "load_joint_map", lambda name: hardware.JointMap("two", tuple(rows)))
    cli.play(motion, board="maestro:/dev/ttyACM0", calibration="two.toml", estimates=True)
    text = said(capsys)
    assert "Ctrl-C stops the arm at once; then the servos are released at once, and a raised arm falls" in text
    assert text.index("note: maestro:/dev/ttyACM0 has no watchdog") < text.index("playing")


def test_which_boards_have_a_watchdog():
    with hardware.connect("simulated") as board:
        assert board.without_watchdog == ()
        maestro = MaestroBoard("x", transport=Maestro(), clock=board.clock)
        both = hardware.boards.CompositeBoard({"simulated": board, "maestro": maestro})
        assert both.without_watchdog == ("maestro:x",)


@pytest.mark.slow
def test_the_page_shows_the_arm_and_ends_with_the_playback():
    model = presets.meccanoid("right")
    whole = Trajectory(
        np.array([0.0, 1.0]), np.zeros((2, len(model.joint_names))), model.joint_names, arm_name=model.name
    )
    with LiveView(whole) as view:
        with urllib.request.urlopen(view.address) as page:
            assert page.status == 200
        row = hardware.LogRow(0.0, "play", np.zeros(len(model.joint_names)), np.full(len(model.joint_names), np.nan))
        for _ in range(2000):
            view.show(row)  # never waits, whatever the browser does
        process = view._process
    assert process.returncode == 0


def test_an_arm_that_cannot_be_shown_is_refused():
    with pytest.raises(InputError, match="no preset has joints that this trajectory moves"):
        LiveView(Trajectory(np.array([0.0]), np.zeros((1, 1)), ("a",)))
    with pytest.raises(InputError, match=r"the trajectory does not move .* of iiwa7"):
        LiveView(MOTION, "iiwa7")


def test_the_arm_of_a_file_with_several_is_chosen_by_its_ends(tmp_path):
    (tmp_path / "two.urdf").write_text(two_arms())
    with pytest.raises(InputError, match="has 2 arms; select one"):
        LiveView(MOTION, str(tmp_path / "two.urdf"))
    with pytest.raises(InputError, match=r"does not move j1_2.* of .*two\.urdf"):
        LiveView(MOTION, str(tmp_path / "two.urdf"), "base_2", "tip_2")
