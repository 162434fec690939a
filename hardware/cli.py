"""``jaxik play``, ``home``, ``teach`` and ``calibrate servos``, and the player that ``jaxik demo`` finds."""

import sys
from collections.abc import Callable
from contextlib import ExitStack
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from hardware.board import Board
from hardware.boards import connect, parse_addresses
from hardware.calibration_file import CalibrationFile
from hardware.channels import family
from hardware.clock import WallClock
from hardware.default_calibration import default_joint_map
from hardware.enter_key import EnterKey
from hardware.errors import BoardError, CalibrationError
from hardware.estimates import ask_consent
from hardware.joint_map import JointMap
from hardware.joint_map_file import load_joint_map
from hardware.live_view import LiveView
from hardware.play_screen import exit_code, hold_until_told, print_report, say_before, with_sign_of_life
from hardware.player import go_to_safe_pose
from hardware.player import play as play_trajectory
from hardware.recording_file import RecordingFile
from hardware.report import PlayReport
from hardware.servo_calibration import calibrate_servos as calibrate_in_dialogue
from hardware.stop_signals import StopSignal, stop_signals
from hardware.stopping import OnStop
from hardware.teaching import ENDED_EARLY, record
from hardware.terminal_question import ask_in_terminal
from jaxik.cli import Screen
from jaxik.trajectories import Trajectory, load_trajectory


def stoppable(command: Callable[..., int]) -> Callable[..., int]:
    """Let Ctrl-C, SIGTERM and SIGHUP end a command with the exit code that shells expect."""

    @wraps(command)
    def stoppable(*arguments: Any, **options: Any) -> int:
        with stop_signals():
            try:
                return command(*arguments, **options)
            except StopSignal as stop:
                print(stop, file=sys.stderr)
                return stop.exit_code

    return stoppable


def play_simulated(trajectory: Trajectory, progress: Callable[[float], None]) -> PlayReport:
    """Play on the simulated board in virtual time, with ideal servos: entry point of the group ``jaxik.players``."""
    with connect("simulated") as board:
        return play_trajectory(trajectory, board, progress=progress)


@stoppable
def play(
    trajectory: Annotated[Path, tyro.conf.Positional],
    board: str = "simulated",
    calibration: str | None = None,
    uncalibrated: bool = False,
    estimates: bool = False,
    speed: float = 1.0,
    loop: int = 1,
    on_stop: Literal["release", "hold", "lower"] = "release",
    log: Path | None = None,
    view: bool = False,
    arm: str | None = None,
    base: str | None = None,
    tip: str | None = None,
    baud: int | None = None,
    bluetooth: bool = False,
    realtime: bool = False,
    json: bool = False,
) -> int:
    """Play a trajectory on a board, or as a dry run on the simulated one.

    Args:
        trajectory: Trajectory file: .npz, .csv, .json; ROS 2: .yaml, .ros.json, .mcap.
        board: Address of the board, e.g. arduino:/dev/ttyUSB0; simulated is the dry run.
        calibration: TOML file that maps joints to servos, e.g. meccanoid.toml; without one the dry run has ideal
            servos.
        uncalibrated: Play on a real board with a calibration by data sheet.
        estimates: Move joints on a real board whose calibration has not been measured, without being asked.
        speed: Time scale: 0.5 plays at half speed.
        loop: Number of times to play; 0 to play until stopped.
        on_stop: Fate of the arm at Ctrl-C, SIGTERM, SIGHUP and faults: release lets it fall, hold keeps it driven until
            the next Ctrl-C, lower takes it slowly to its safe pose and then releases it.
        log: File for a log of commanded and measured joint angles: .csv or .npz.
        view: Show the arm in the browser as it plays.
        arm: Arm to show: preset, model file (.json), URDF (.urdf) or MJCF (.xml); by default the trajectory's own.
        base: Base link in a URDF of several arms, or base body in an MJCF, of the arm to show.
        tip: Tip link in a URDF, or site or body of the tool in an MJCF, of the arm to show.
        baud: Rate of the port in bits per second, if it is not the board's usual one; `jaxik scan` finds it.
        bluetooth: The link is a radio: 57600 baud, and silence is tolerated for longer.
        realtime: Let the simulated board take as long as a real one would.
        json: Print one JSON document instead of the table.

    Returns:
        0 after a success, 1 after a failure, 130 after Ctrl-C, 143 after SIGTERM, 129 after SIGHUP.
    """
    screen = Screen(json)
    motion = load_trajectory(trajectory)
    joints = _calibration(board, calibration, uncalibrated, motion.joint_names)
    if calibration is not None and joints is not None:
        joints = joints.select(motion.joint_names)
        if board == "simulated":
            screen.say(_dry_run(joints))
        if not estimates:
            _ask_consent(screen, joints, board)
    ending = OnStop(on_stop)
    with stop_signals() as signals, ExitStack() as opened:
        with signals.raising():
            live = opened.enter_context(LiveView(motion, arm, base, tip)) if view else None
            connected = opened.enter_context(connect(board, **board_options(board, baud, bluetooth, realtime or view)))
            if live is not None:
                screen.say(f"open {live.address} in a browser")
        say_before(screen, connected, ending)
        times = "until stopped" if loop == 0 else f"{loop} times" if loop > 1 else ""
        with screen.step(
            f"playing {motion.duration / speed if speed > 0 else 0:.1f} s on {board} {times}".rstrip()
        ) as bar:
            report = play_trajectory(
                motion,
                connected,
                joints,
                speed=speed,
                loops=loop or None,
                on_stop=ending,
                log_file=log,
                progress=with_sign_of_life(screen, bar),
                watch=None if live is None else live.show,
            )
            if report.held:
                hold_until_told(screen, connected, report, signals)
    print_report(screen, report)
    return exit_code(report)


@stoppable
def home(
    calibration: str,
    board: str = "simulated",
    estimates: bool = False,
    on_stop: Literal["release", "hold", "lower"] = "release",
    baud: int | None = None,
    bluetooth: bool = False,
    json: bool = False,
) -> int:
    """Take the arm from wherever it stands to its safe pose, and release it there.

    Args:
        calibration: TOML file that maps joints to servos.
        board: Address of the board, e.g. arduino:/dev/ttyUSB0.
        estimates: Move joints on a real board whose calibration has not been measured, without being asked.
        on_stop: Fate of the arm at Ctrl-C, SIGTERM, SIGHUP and faults, as in `jaxik play`.
        baud: Rate of the port in bits per second, if it is not the board's usual one; `jaxik scan` finds it.
        bluetooth: The link is a radio: 57600 baud, and silence is tolerated for longer.
        json: Print one JSON document instead of the table.

    Returns:
        0 after a success, 1 after a failure, 128 and the signal's number after a signal.
    """
    screen, joints, ending = Screen(json), load_joint_map(calibration), OnStop(on_stop)
    if not estimates:
        _ask_consent(screen, joints, board)
    with stop_signals() as signals, ExitStack() as opened:
        with signals.raising():
            connected = opened.enter_context(connect(board, **board_options(board, baud, bluetooth)))
        say_before(screen, connected, ending)
        with screen.step(f"going to the safe pose on {board}") as bar:
            report = go_to_safe_pose(connected, joints, on_stop=ending, progress=bar)
            if report.held:
                hold_until_told(screen, connected, report, signals)
    print_report(screen, report)
    return exit_code(report)


@stoppable
def teach(
    out: Annotated[Path, tyro.conf.Positional],
    board: str = "simulated",
    calibration: str = "meccanoid.toml",
    seconds: float = 10.0,
    countdown: int = 3,
    baud: int | None = None,
    bluetooth: bool = False,
    json: bool = False,
) -> int:
    """Record a motion made by hand with servos that have read-back; replay it with `jaxik play`.

    Enter begins and ends the recording. Ctrl-C, or a fault of the board, ends it too, and what was recorded is kept.

    Args:
        out: Trajectory file to write: .npz, .csv or .json.
        board: Address of the board, e.g. arduino:/dev/ttyUSB0.
        calibration: TOML file that maps joints to servos.
        seconds: Longest duration of the recording.
        countdown: Seconds from Enter until the servos go limp.
        baud: Rate of the port in bits per second, if it is not the board's usual one; `jaxik scan` finds it.
        bluetooth: The link is a radio: 57600 baud, and silence is tolerated for longer.
        json: Print one JSON document instead of text.

    Returns:
        0; 1 if a fault, or 128 and the signal's number if a signal ended the recording, which is kept all the same.
    """
    screen, key = Screen(json), EnterKey()
    joints = load_joint_map(calibration)
    with stop_signals() as signals, ExitStack() as opened:
        with signals.raising():
            file = RecordingFile(out, joints)
            opened.callback(file.close)
            connected = opened.enter_context(connect(board, **board_options(board, baud, bluetooth)))
            _count_down(screen, connected, joints, key, countdown)
        with screen.step(f"recording up to {seconds:g} s") as bar:
            motion = record(connected, joints, seconds, progress=bar, keep=file.add, until=key.pressed)
        kept = file.save(motion)
    if kept != out:
        screen.say(f"note: {out} could not be written: the recording is in {kept}")
    screen.say(f"{len(motion)} waypoints, {motion.duration:.1f} s, in {kept}")
    screen.say(f"replay it: jaxik play {kept} --board {board} --calibration {calibration}")
    screen.result({"file": str(kept), "waypoints": len(motion), "duration": motion.duration})
    if signals.first is not None:
        return signals.first.exit_code
    return 1 if motion.notes[-1].startswith(ENDED_EARLY) else 0


def _count_down(screen: Screen, board: Board, joints: JointMap, key: EnterKey, seconds: int) -> None:
    """Say what goes limp, wait for Enter where there is a terminal, and count down."""
    limp = ", ".join(joint.name for joint in joints.joints if joint.readback)
    screen.say(f"these will go limp, so hold the arm: {limp}; all others hold")
    if key.available:
        screen.say("press Enter to begin; Enter again ends the recording")
        while not key.pressed():
            board.clock.sleep(0.05)
    for left in range(seconds, 0, -1):
        screen.say(f"limp in {left} ...")
        board.clock.sleep(1.0)


@stoppable
def calibrate_servos(
    out: Annotated[Path, tyro.conf.Positional],
    board: str = "simulated",
    template: str | None = None,
    joint: tuple[str, ...] = (),
    baud: int | None = None,
    bluetooth: bool = False,
) -> int:
    """Calibrate servos joint by joint (jog, set neutral, angles, limits and sign) and write the file.

    A file that exists is continued, and saved after every answer: `quit` and Ctrl-C lose nothing.

    Args:
        out: TOML file to write, or to continue.
        board: Address of the board, e.g. arduino:/dev/ttyUSB0; simulated is for practice.
        template: Calibration to start a new file from: names, channels, raw ranges; default meccanoid.toml.
        joint: Only these joints; default those that have not been measured.
        baud: Rate of the port in bits per second, if it is not the board's usual one; `jaxik scan` finds it.
        bluetooth: The link is a radio: 57600 baud, and silence is tolerated for longer.

    Returns:
        0 if every joint was calibrated, 1 if the dialogue was ended early, 128 and the signal's number after a signal.
    """
    parse_addresses(board)
    file = CalibrationFile(out, template, joint, practice=board.partition(":")[0] == "simulated")
    print(file.summary())
    if not file.chosen.joints:
        print("nothing is left to measure; --joint NAME measures a joint again")
        return 0
    options = board_options(board, baud, bluetooth, realtime=True)
    with stop_signals() as signals, signals.raising(), connect(board, **options) as connected:
        done = calibrate_in_dialogue(connected, file.chosen, ask=ask_in_terminal(connected), keep=file.keep)
    if done.joints != file.chosen:
        file.keep(done.joints)
        print(f"saved: {file.summary()}")
    if done.ok:
        print(f"play with --calibration {out}")
        return 0
    print(f"ended; go on with the same command: jaxik calibrate servos {out} --board {board}")
    return 1 if signals.first is None else signals.first.exit_code


def _dry_run(joints: JointMap) -> str:
    """Return which boards a dry run stands for."""
    kinds = sorted({family(joint.channel) for joint in joints.joints} - {""})
    return (
        f"dry run as on {' or '.join(kinds)}"
        if kinds
        else "dry run with ideal servos: the calibration names no channels, and a real board needs them"
    )


def _ask_consent(screen: Screen, joints: JointMap, board: str) -> None:
    """Ask, if somebody is there, before a real board moves joints by estimates."""
    interactive = sys.stdin is not None and sys.stdin.isatty() and not screen.as_json
    with stop_signals() as signals, signals.raising():
        ask_consent(joints, board, screen.say, input if interactive else None)


def _calibration(board: str, file: str | None, uncalibrated: bool, names: tuple[str, ...]) -> JointMap | None:
    """Return the calibration to play with; a real board needs a file, or explicit consent to do without."""
    parse_addresses(board)
    if file is not None:
        return load_joint_map(file)
    kind = board.partition(":")[0]
    if kind == "simulated" or uncalibrated:
        return default_joint_map(kind, names)
    raise CalibrationError(
        f"playing on {board} needs --calibration FILE: make one with `jaxik calibrate servos FILE --board {board}`; "
        "--uncalibrated plays with the numbers of data sheets, at your own risk"
    )


def board_options(board: str, baud: int | None, bluetooth: bool, realtime: bool = False) -> dict[str, Any]:
    """Return the keyword arguments to open a board with."""
    if baud is not None and "+" in board:
        raise BoardError(f"--baud is for one board; write the rate behind a port: feetech:/dev/ttyUSB0@{baud}")
    kind, rate = board.partition(":")[0], {} if baud is None else {"baud": baud}
    if kind == "arduino" and bluetooth:
        return {"bluetooth": True, "baud": 57_600} | rate
    return ({"clock": WallClock()} if kind == "simulated" and realtime else {}) | rate
