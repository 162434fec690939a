"""Comparison of plans with motions found by other methods, and checks of their accuracy.

python -m benchmarks.plan_quality [--arms iiwa14 ...] [--paths word hello.csv ...] [--restarts 1000] [--out quality.csv]

The other methods are random local restarts and brute force on a grid 20 times as fine as the search's, both refined at
every waypoint. Rows that ``--out`` already contains are skipped. All paths with all arms take hours.
"""

import argparse
import csv
import os
from pathlib import Path
from time import process_time

import jax
import numpy as np

import jaxik
from benchmarks.common import table
from benchmarks.proofs import ARMS, EXAMPLES
from hardware import schedule
from tests.helpers.rivals import finer_routes, random_starts, refiner

jax.config.update("jax_enable_x64", True)

HEADER = (
    *("arm", "path", "poses", "status", "uncertified", "energy", "bound", "gap %", "restarts", "kept", "finer grid"),
    *("worst ratio", "at [mm]", "at [deg]", "between [mm]", "speed %", "cpu [s]"),
)
GRIDS = (32, 64)  # searched waypoints of the finer grid
BATCH = 200  # restarts per call
PLACES = 10  # samples between two waypoints


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", nargs="+", choices=list(ARMS), default=list(ARMS))
    parser.add_argument("--paths", nargs="+", default=list(EXAMPLES), help="example paths and files")
    parser.add_argument("--restarts", type=int, default=1000)
    parser.add_argument("--out", type=Path, help="CSV file, continued at its end")
    options = parser.parse_args()
    done = {}
    if options.out and options.out.exists():
        with options.out.open() as file:
            done = {tuple(row[:2]): tuple(row) for row in list(csv.reader(file))[1:]}
    rows = []
    for which in options.paths:
        for arm in options.arms:
            name = os.path.splitext(os.path.basename(which))[0]
            row = done.get((arm, name)) or measured(arm, which, name, options.restarts)
            rows.append(row)
            if (arm, name) not in done and options.out:
                new = not options.out.exists()
                with options.out.open("a", newline="") as file:
                    csv.writer(file).writerows([HEADER, row] if new else [row])
            print(" ".join(f"{key}={value}" for key, value in zip(HEADER, row, strict=True)), flush=True)
    table(f"Joint motion, {options.restarts} restarts", HEADER, rows)


def measured(name: str, which: str, shown: str, restarts: int) -> tuple[str, ...]:
    """Return one row of the table."""
    began = process_time()
    arm = ARMS[name]().arm
    path = jaxik.example_path(which) if which in EXAMPLES else jaxik.load_path(which)
    path = jaxik.fit_path(arm, path)
    uncertified, plan = jaxik.plan(arm, path, gap=None), jaxik.plan(arm, path)
    if plan.trajectory is None or plan.lower_bound is None or plan.gap is None:
        return name, shown, str(len(path)), plan.status.name, *["-"] * (len(HEADER) - 4)
    refined = refiner(arm, path)
    starts = random_starts(arm, path, -(-restarts // BATCH) * BATCH)
    parts = range(0, len(starts[0]), BATCH)
    others = np.concatenate([refined(*(x[i : i + BATCH] for x in starts)) for i in parts])[:restarts]
    finer = min((best_of(refined, finer_routes(arm, path, count)) for count in GRIDS), default=np.inf)
    position, direction = missed(arm, path, plan.trajectory)
    best = min(others.min(), finer)
    speed = np.abs(plan.trajectory.qd) / np.asarray(arm.velocity_limit)
    return (
        *(name, shown, str(len(path)), plan.status.name, f"{uncertified.energy:.6g}", f"{plan.energy:.6g}"),
        *(f"{plan.lower_bound:.6g}", f"{100 * plan.gap:.2f}", f"{others.min():.6g}", str(np.isfinite(others).sum())),
        *(f"{finer:.6g}", f"{plan.energy / best:.5f}", f"{1e3 * position:.1e}", f"{np.degrees(direction):.1e}"),
        *(f"{1e3 * played_off(arm, path, plan.trajectory):.3f}", f"{100 * speed.max():.0f}"),
        f"{process_time() - began:.0f}",
    )


def best_of(refined, routes: tuple[np.ndarray, np.ndarray]) -> float:
    """Return the energy of the best of up to eight routes, in a call of constant size."""
    swivel, branch = routes
    if not len(swivel):
        return np.inf
    take = np.minimum(np.arange(8), len(swivel) - 1)
    return float(refined(swivel[take], branch[take]).min())


def missed(arm: jaxik.Arm, path: jaxik.Path, trajectory: jaxik.Trajectory) -> tuple[float, float]:
    """Return the largest errors of the tool at the waypoints in position [m] and rotation [rad]."""
    tool, target = jaxik.forward_kinematics(arm, trajectory.q), path.target
    if isinstance(target, jaxik.Pose):
        off = np.linalg.norm(tool.rotation - target.rotation, axis=(-2, -1)) / 2**0.5
    else:
        off = np.linalg.norm(tool.rotation[..., 2] - np.asarray(target.direction), axis=-1)
    return float(np.linalg.norm(tool.position - target.position, axis=-1).max()), float(off.max())


def played_off(arm: jaxik.Arm, path: jaxik.Path, trajectory: jaxik.Trajectory) -> float:
    """Return the largest deviation from the path [m] when played by a board: at frames, linear in between."""
    times, q = schedule.frames(trajectory, 1.0)
    requested = trajectory.time - trajectory.time[0]
    dense = np.interp(
        np.linspace(0, len(requested) - 1, PLACES * (len(requested) - 1) + 1), np.arange(len(requested)), requested
    )
    played = np.stack([np.interp(dense, times, column) for column in q.T], axis=-1)
    tool, position = np.asarray(jaxik.forward_kinematics(arm, played).position), np.asarray(path.target.position)
    step = np.minimum(np.arange(len(dense)) // PLACES, len(requested) - 2)
    line = position[step + 1] - position[step]
    along = ((tool - position[step]) * line).sum(-1) / np.maximum((line * line).sum(-1), np.finfo(float).tiny)
    return float(np.linalg.norm(tool - position[step] - np.clip(along, 0, 1)[:, None] * line, axis=-1).max())


if __name__ == "__main__":
    main()
