"""Accuracy of the firmware's pulses, time that a playback takes, and memory left on the board.

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
    chip = Bench(skew=skew)
    plug_in(chip, joints)
    began = time.process_time()
    report = play_over(chip, trajectory, joints, link=link, stop_within_s=stop_within_s, park=False, seed=seed)
    took = time.process_time() - began
    pulses = chip.pulses()
    error = pulse_errors(
        pulses[:, 0] / chip.cycles_per_us * 1e-6,
        pulses[:, 1],
        pulses[:, 2] / CYCLES_PER_US,
        trajectory,
        joints,
        standing(joints),
        report.starts_s[0],
    )
    rms, worst = np.sqrt(np.mean(error**2)), np.abs(error).max()
    packets = len(chip.packets) / 2 / (chip.now_us * 1e-6)
    row = (
        report.report.result.name,
        f"{rms:.2f}",
        f"{worst:.2f}",
        str(len(error)),
        f"{packets:.1f}",
        str(chip.overruns),
    )
    row += (str(chip.stack_left()), f"{100 * chip.awake:.1f}", f"{took:.2f}")
    chip.close()
    return row


def pulse_widths() -> tuple[str, ...]:
    """Compare widths with constant commands, while 100 requests per second and both chains keep the board busy."""
    chip = Bench()
    plug_in(chip, MECCANOID)
    board = ready(chip)
    raw = board.status().commanded.astype(int)
    errors = []
    for trial in range(20):
        wanted = np.random.default_rng(trial).integers(700, 2300, len(HOBBY))
        raw[HOBBY] = wanted
        board.move(raw.tolist())
        for _ in range(60):
            board.clock.sleep(0.02)
            board.status()
        settled = chip.now_us
        for _ in range(100):
            board.status()
            board.clock.sleep(0.01 - board.clock.now() % 0.01)
        pulses = chip.pulses()
        pulses = pulses[pulses[:, 0] > settled * CYCLES_PER_US]
        pins = {0: 0, 1: 1, 3: 2, 4: 3}
        errors.append(pulses[:, 2] / CYCLES_PER_US - wanted[[pins[pin] for pin in pulses[:, 1]]])
    error = np.abs(np.concatenate(errors))
    chip.close()
    figures = np.concatenate(errors).std(), np.quantile(error, 0.999), error.max()
    return (*(f"{x:.4f}" for x in figures), str(len(error)))


def stopping() -> list[tuple[str, ...]]:
    """Measure how long servos move after STOP and after a host's last message; the worst of many moments."""
    rows = []
    for name, within in (("STOP", 0.3), ("silence, wire", 0.3), ("silence, Bluetooth", 0.5)):
        rest, gone = [], []
        for moment in range(12):
            chip = Bench()
            plug_in(chip, MECCANOID)
            board = ready(chip, stop_within_s=within)
            ramp(board, 0.75, rate=500.0)
            board.start(0)
            board.clock.sleep(0.1 + 0.0017 * moment)
            board.stop() if name == "STOP" else board.status()
            told_us = chip.now_us
            chip.run(told_us + 3_000_000)
            pulses = chip.pulses()
            at = pulses[:, 0] / CYCLES_PER_US - told_us
            for pin in set(pulses[:, 1]):
                mine = pulses[:, 1] == pin
                changes = np.flatnonzero(np.diff(pulses[mine, 2])) + 1
                rest.append(max(0.0, at[mine][changes[-1]]))
            gone.append(at.max())
            chip.close()
        rows.append((name, f"{max(rest) / 1e3:.1f}", f"{max(gone) / 1e3:.0f}"))
    return rows


def model_seconds() -> float:
    """Return the CPU time of a playback on the simulated board [s]."""
    trajectory, joints = whole_robot(SECONDS)
    times = []
    for _ in range(5):
        began = time.process_time()
        with hardware.connect("simulated") as board:
            assert hardware.play(trajectory, board, joints).ok
        times.append(time.process_time() - began)
    return min(times)


def bad_lines() -> list[tuple[str, ...]]:
    """Count how playbacks of three seconds end on bad lines, with the Python model."""
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
