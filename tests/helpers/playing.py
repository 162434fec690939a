"""Playing on a board in virtual time, and comparing its pulses with the plan."""

from dataclasses import dataclass

import numpy as np

import hardware
from hardware import schedule
from hardware.boards.firmware_board import FirmwareBoard
from hardware.clock import VirtualClock
from hardware.protocol import PLACES, SMART, parse_channel
from jaxik import Trajectory
from tests.helpers.faulty_link import FaultyLink

MECCANOID = hardware.load_joint_map("meccanoid.toml")
HOBBY = [j for j, joint in enumerate(MECCANOID.joints) if not joint.readback]
WIRE: dict = {}
BLUETOOTH = {"latency_s": 0.02, "jitter_s": 0.015, "stall": 0.02, "stall_s": 0.15}


def whole_robot(seconds: float = 20.0, seed: int = 1) -> tuple[Trajectory, hardware.JointMap]:
    """Return a smooth motion of all joints of meccanoid.toml, inside limits and rates, and that calibration."""
    joints = MECCANOID
    random = np.random.default_rng(seed)
    times = np.arange(0, seconds + 1e-9, 0.02)
    lower, upper, rate = (joints.column(name) for name in ("lower", "upper", "max_rate"))
    phase, hertz = random.uniform(0, 6.28, len(lower)), random.uniform(0.1, 0.3, len(lower))
    reach = np.minimum(0.45 * (upper - lower), 0.8 * rate / (2 * np.pi * hertz))
    q = (lower + upper) / 2 + reach * np.sin(2 * np.pi * hertz * times[:, None] + phase)
    return Trajectory(times, q, joints.names), joints


def standing(joints: hardware.JointMap) -> np.ndarray:
    """Return the posture before anything has moved: the safe pose, rounded to raw steps [rad]."""
    return joints.to_rad(joints.to_raw(joints.column("safe")))


def plug_in(chip, joints: hardware.JointMap) -> None:
    """Plug the smart servos of a calibration into a chip, in their safe pose."""
    raw = joints.to_raw(joints.column("safe"))
    for j, joint in enumerate(joints.joints):
        place = parse_channel(joint.channel)
        if place is not None and place >= SMART:
            chip.module((place - SMART) // PLACES, (place - SMART) % PLACES, True, int(raw[j]))


def connected(chip, **options) -> FirmwareBoard:
    """Connect to a chip over a plain wire."""
    clock = VirtualClock()
    clock.sleep(0.01)  # it has booted by then
    transport = FaultyLink(chip, clock, byte_s=getattr(chip, "byte_s", 0.0))
    transport.began = 0.0
    return FirmwareBoard("bench", transport, clock, **options)


def ready(chip, joints: hardware.JointMap = MECCANOID, **options) -> FirmwareBoard:
    """Connect to a chip, configure and enable it."""
    board = connected(chip, **options)
    assert board.configure(joints) == joints.crc
    board.enable()
    return board


def ramp(board: FirmwareBoard, seconds: float, rate: float = 60.0) -> None:
    """Queue a motion of all hobby servos at a rate [raw/s], without a last waypoint."""
    start = board.status().commanded.astype(int)
    points = []
    for i in range(int(seconds / 0.02)):
        raw = start.copy()
        raw[HOBBY] += round((i + 1) * 0.02 * rate)
        points.append(hardware.Waypoint(i, 20_000 * (i + 1), tuple(int(x) for x in raw)))
    board.send(points)


@dataclass
class Played:
    """A playback that is over.

    Attributes:
        report: Result of the playback.
        board: Host's side of the board.
        starts_s: Host times of the motions' starts [s].
    """

    report: hardware.PlayReport
    board: FirmwareBoard
    starts_s: list[float]


def play_over(peer, trajectory, joints, *, link=WIRE, stop_within_s=0.3, seed=0, **options) -> Played:
    """Play over a modeled line; options go to the player."""
    clock = VirtualClock()
    clock.sleep(0.01)  # the board has booted by then
    byte_s = getattr(peer, "byte_s", 0.0)
    transport = FaultyLink(peer, clock, seed=seed, byte_s=byte_s, **link)
    transport.began = 0.0
    board = FirmwareBoard("bench", transport, clock, stop_within_s=stop_within_s)
    starts, start_at = [], board.start_at

    def noting(host_s):
        starts.append(host_s)
        start_at(host_s)

    board.start_at = noting
    report = hardware.play(trajectory, board, joints, **options)
    return Played(report, board, starts)


def plan_in_raw(trajectory, joints, present, speed=1.0):
    """Return times since the start [s] and planned raw values, not rounded, of easing in and playing."""
    ease_times, ease_q = schedule.ease(present, trajectory.q[0], joints)
    times, q = schedule.frames(trajectory, speed)
    times, q = np.append(ease_times, ease_times[-1] + times[1:]), np.concatenate([ease_q, q[1:]])
    times, q = np.append(0.0, times), np.concatenate([[present], q])
    return times, joints.column("neutral") + joints.column("sign") * joints.column("raw_per_rad") * q


def pulse_errors(pulses_s, pins, widths_us, trajectory, joints, present, start_s):
    """Return width minus plan [µs] of every pulse during the motion."""
    times, raw = plan_in_raw(trajectory, joints, present)
    errors = []
    for j, joint in enumerate(joints.joints):
        mine = (pins == parse_channel(joint.channel)) & (pulses_s >= start_s) & (pulses_s <= start_s + times[-1])
        errors.append(widths_us[mine] - np.interp(pulses_s[mine] - start_s, times, raw[:, j]))
    return np.concatenate(errors)
