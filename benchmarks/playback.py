"""How exactly does the firmware play, how long does a playback take, and what does the board have room for?

python -m benchmarks.playback

Runs the firmware's binary in simavr, in virtual time, with twelve servos on both chains and four outputs. Needs
Debian's gcc-avr, avr-libc, libsimavr-dev and libelf-dev.
"""

import time

import numpy as np

import hardware
from benchmarks.common import table
from hardware.simulation import BoardModel
from tests.helpers.firmware import CYCLES_PER_US, Bench, firmware, missing, run
from tests.helpers.playing import (
    BLUETOOTH,
    HOBBY,
    MECCANOID,
    WIRE,
    play_over,
    plug_in,
    pulse_errors,
    ramp,
    ready,
    standing,
    whole_robot,
)

SECONDS = 20.0


def played(link: dict, stop_within_s: float, skew: float, seed: int) -> tuple[str, ...]:
    trajectory, joints = whole_robot(SECONDS)
    board = Bench(skew=skew)
    plug_in(board, joints)
    began = time.process_time()
    report = play_over(board, trajectory, joints, link=link, stop_within_s=stop_within_s, park=False, seed=seed)
    took = time.process_time() - began
    pulses = board.pulses()
    error = pulse_errors(
        pulses[:, 0] / board.cycles_per_us * 1e-6,
        pulses[:, 1],
        pulses[:, 2] / CYCLES_PER_US,
        trajectory,
        joints,
        standing(joints),
        report.starts_s[0],
    )
    rms, worst = np.sqrt(np.mean(error**2)), np.abs(error).max()
    packets = len(board.packets) / 2 / (board.now_us * 1e-6)
    row = (
        report.report.result.name,
        f"{rms:.2f}",
        f"{worst:.2f}",
        str(len(error)),
        f"{packets:.1f}",
        str(board.overruns),
    )
    row += (str(board.stack_left()), f"{100 * board.awake:.1f}", f"{took:.2f}")
    board.close()
    return row


def pulse_widths() -> tuple[str, ...]:
    """Widths against commands that stand still, while 100 questions a second and both chains keep it busy."""
    board = Bench()
    plug_in(board, MECCANOID)
    device = ready(board)
    raw = device.status().commanded.astype(int)
    errors = []
    for trial in range(20):
        wanted = np.random.default_rng(trial).integers(700, 2300, len(HOBBY))
        raw[HOBBY] = wanted
        device.move(raw.tolist())
        for _ in range(60):
            device.clock.sleep(0.02)
            device.status()
        settled = board.now_us
        for _ in range(100):
            device.status()
            device.clock.sleep(0.01 - device.clock.now() % 0.01)
        pulses = board.pulses()
        pulses = pulses[pulses[:, 0] > settled * CYCLES_PER_US]
        pins = {0: 0, 1: 1, 3: 2, 4: 3}
        errors.append(pulses[:, 2] / CYCLES_PER_US - wanted[[pins[pin] for pin in pulses[:, 1]]])
    error = np.abs(np.concatenate(errors))
    board.close()
    figures = np.concatenate(errors).std(), np.quantile(error, 0.999), error.max()
    return (*(f"{x:.4f}" for x in figures), str(len(error)))


def stopping() -> list[tuple[str, ...]]:
    """How long servos go on after STOP, and after the last word of a host; worst of many moments."""
    rows = []
    for name, within in (("STOP", 0.3), ("silence, wire", 0.3), ("silence, Bluetooth", 0.5)):
        rest, gone = [], []
        for moment in range(12):
            board = Bench()
            plug_in(board, MECCANOID)
            device = ready(board, stop_within_s=within)
            ramp(device, 0.75, rate=500.0)
            device.start(0)
            device.clock.sleep(0.1 + 0.0017 * moment)
            device.stop() if name == "STOP" else device.status()
            told = board.now_us
            board.run(told + 3_000_000)
            pulses = board.pulses()
            at = pulses[:, 0] / CYCLES_PER_US - told
            for pin in set(pulses[:, 1]):
                mine = pulses[:, 1] == pin
                changes = np.flatnonzero(np.diff(pulses[mine, 2])) + 1
                rest.append(max(0.0, at[mine][changes[-1]]))
            gone.append(at.max())
            board.close()
        rows.append((name, f"{max(rest) / 1e3:.1f}", f"{max(gone) / 1e3:.0f}"))
    return rows


def model_seconds() -> float:
    """CPU time of a playback on the simulated board."""
    trajectory, joints = whole_robot(SECONDS)
    times = []
    for _ in range(5):
        began = time.process_time()
        with hardware.connect("simulated") as robot:
            assert hardware.play(trajectory, robot, joints).ok
        times.append(time.process_time() - began)
    return min(times)


def bad_lines() -> list[tuple[str, ...]]:
    """How playbacks of three seconds end on bad lines, on the Python model."""
    trajectory, joints = whole_robot(3.0)
    safe = joints.to_raw(joints.column("safe")).astype(float).tolist()
    rows = []
    for kind in ("flip", "drop", "duplicate"):
        for rate in (0.001, 0.005, 0.02):
            ended = [
                play_over(
                    BoardModel(lambda n: list(safe)), trajectory, joints, link={kind: rate}, seed=seed, park=False
                )
                for seed in range(20)
            ]
            names = [each.report.result.name for each in ended]
            counts = ", ".join(f"{names.count(name)} {name}" for name in sorted(set(names)))
            rows.append(
                (f"{kind} {100 * rate:g} % of bytes" if kind != "duplicate" else f"repeat {100 * rate:g} %", counts)
            )
    return rows


def main() -> None:
    if lacking := missing():
        raise SystemExit(f"apt-get install gcc-avr avr-libc libsimavr-dev libelf-dev; missing: {lacking}")
    print(run("avr-size", firmware()))
    table("Pulse width minus command [us]", ("sd", "99.9 %", "worst", "pulses"), [pulse_widths()])
    rows = []
    for name, link, within in (("wire", WIRE, 0.3), ("Bluetooth", BLUETOOTH, 0.5)):
        for skew in (-0.005, 0.0, 0.005):
            for seed in (0, 1):
                rows.append((name, f"{100 * skew:g} %", *played(link, within, skew, seed)))
    head = (
        "line",
        "skew",
        "result",
        "rms [us]",
        "worst [us]",
        "pulses",
        "packets/s",
        "overruns",
        "stack left",
        "awake [%]",
        "CPU [s]",
    )
    table(f"Pulses against the plan, {SECONDS:g} s of twelve joints", head, rows)
    table("Stopping", ("after", "last change of a width [ms]", "last pulse [ms]"), stopping())
    table("Bad lines, 20 playbacks each", ("fault", "ended"), bad_lines())
    print(f"{SECONDS:g} s on the simulated board take {model_seconds():.2f} s of CPU time")


if __name__ == "__main__":
    main()
