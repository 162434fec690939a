"""``jaxik demo``: from a path to a played trajectory in one go."""

import os
import shutil
import sys
import time
from importlib.metadata import entry_points
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from jaxik import energy as energies
from jaxik.arm import ArmModel
from jaxik.atomic_file import write_atomically
from jaxik.cli.console import Screen
from jaxik.cli.inputs import find_arm, find_path
from jaxik.cli.plan import plan_facts, planned
from jaxik.paths import Path
from jaxik.planning import Plan, energy_map
from jaxik.trajectories import Trajectory, load_trajectory
from jaxik.view import draw_arm, draw_energy_map, draw_joints, draw_tracking, draw_velocities

_MADE = {
    "arm.png": "the arm on its path, and the way of its elbow",
    "energy_map.png": "what each elbow would cost, and the planned one",
    "joints.png": "joint angles within their ranges",
    "velocities.png": "joint speeds within their limits",
    "tracking.png": "what the simulated servos did of it",
    "trajectory.npz": "the motion, for programs",
    "trajectory.csv": "the same, for spreadsheets",
    "trajectory.json": "the same, for everything else",
    "report.txt": "what it costs and what is proved",
}

PLAYERS = (
    "jaxik.players"  # entry points (trajectory, board, progress) -> report: who plays is not this package's business
)


def demo(out: FilePath = FilePath("demo"), arm: str = "meccanoid-right", path: str = "word", json: bool = False) -> int:
    """Go the whole way: path, plan, pictures, trajectory files, playback on a simulated board.

    Args:
        out: Folder for what it makes; created if need be.
        arm: Preset (meccanoid-right, meccanoid-left, iiwa7, iiwa14, paper) or model file (.json).
        path: Example path (word, figure-eight, reach, wave, spiral) or path file (.csv).
        json: Print one JSON document instead of progress and tables.

    Returns:
        0 if everything succeeded, else 1.
    """
    began = time.perf_counter()
    screen = Screen(json)
    model, asked = find_arm(arm), find_path(path)
    out.mkdir(parents=True, exist_ok=True)
    screen.say(f"[bold]{path}[/bold] with [bold]{model.name}[/bold]: {len(asked)} waypoints, {asked.length:.2f} m")
    plan, placed = planned(screen, model, asked, energies.joint_motion())
    if placed.placement is not None:
        screen.say(f"  path {placed.placement.describe()}")
    if plan.trajectory is None:
        screen.say(plan.report())
        screen.result({"plan": plan_facts(plan, placed), "files": [], "played": None})
        return 1
    with screen.step("drawing"):
        files = _pictures(model, plan, placed, out)
    with screen.step("writing trajectory files and reading them back"):
        files += _trajectories(plan.trajectory, out)
    report = _play(screen, plan.trajectory)
    if report is not None:
        files.append(out / "tracking.png")
        draw_tracking(report.log).savefig(files[-1])
    _tables(screen, model, plan, report)
    write_atomically(out / "report.txt", plan.report() + "\n")
    files.append(out / "report.txt")
    played = None if report is None else report.summary()
    facts = {"plan": plan_facts(plan, placed), "files": [str(f) for f in files], "played": played}
    screen.result({**facts, "seconds": time.perf_counter() - began})
    _closing(screen, files, out, arm, time.perf_counter() - began)
    return 0 if report is None or report.ok else 1


def _pictures(model: ArmModel, plan: Plan, path: Path, out: FilePath) -> list[FilePath]:
    """The pictures of the plan."""
    assert plan.trajectory is not None
    figures = {
        "energy_map.png": draw_energy_map(energy_map(model.arm, path, plan.branch), plan),
        "arm.png": draw_arm(model, plan.trajectory, path),
        "joints.png": draw_joints(model, plan.trajectory),
        "velocities.png": draw_velocities(model, plan.trajectory),
    }
    for name, figure in figures.items():
        figure.savefig(out / name)
    return [out / name for name in figures]


def _trajectories(trajectory: Trajectory, out: FilePath) -> list[FilePath]:
    """The three file forms, each read back."""
    files = [out / f"trajectory{ending}" for ending in (".npz", ".csv", ".json")]
    for file in files:
        trajectory.save(file)
        if load_trajectory(file) != trajectory:
            raise OSError(f"{file} does not read back as it was written; is the disk full or faulty?")
    return files


def _play(screen: Screen, trajectory: Trajectory) -> Any | None:
    """Plays on the simulated board of whichever package offers one."""
    players = entry_points(group=PLAYERS, name="simulated")
    if not players:
        screen.say("no player installed: the trajectory was not played")
        return None
    play = next(iter(players)).load()
    with screen.step("playing on the simulated board") as progress:
        return play(trajectory, progress)


def _tables(screen: Screen, model: ArmModel, plan: Plan, report: Any | None) -> None:
    """What came of it, overall and joint by joint."""
    t = plan.trajectory
    assert t is not None
    proved = (
        "none computed yet"
        if plan.lower_bound is None
        else f"{plan.lower_bound:.5g} (gap {100 * (plan.gap or 0):.2f} %)"
    )
    rows = [
        ("energy", f"{plan.energy:.5g} {plan.energy_unit}"),
        ("before the polish", f"{plan.searched:.5g} {plan.energy_unit}"),
        ("lower bound", proved),
        ("swivel", f"{np.degrees(plan.swivel.min()):.1f}° to {np.degrees(plan.swivel.max()):.1f}°"),
        ("branch", ", ".join(str(b) for b in dict.fromkeys(plan.branch.tolist()))),
        ("duration", f"{t.duration:.2f} s"),
        ("played", "no" if report is None else f"{report.result.name}: {report.message}"),
    ]
    screen.table("plan", ("what", "value"), rows)
    q, lower, upper = np.degrees(t.q), np.degrees(np.asarray(model.arm.lower)), np.degrees(np.asarray(model.arm.upper))
    used = np.abs(t.qd).max(0) / np.asarray(model.arm.velocity_limit)
    worst = np.full(len(t.joint_names), np.nan) if report is None else np.degrees(report.tracking.worst)
    joints = [
        (
            name,
            f"{q[:, j].min():.1f} to {q[:, j].max():.1f}",
            f"{lower[j]:.0f} to {upper[j]:.0f}",
            f"{100 * used[j]:.0f} %",
            "-" if np.isnan(worst[j]) else f"{worst[j]:.1f}",
        )
        for j, name in enumerate(t.joint_names)
    ]
    screen.table("joints", ("joint", "moves [°]", "range [°]", "speed", "lag [°]"), joints)


def _closing(screen: Screen, files: list[FilePath], out: FilePath, arm: str, seconds: float) -> None:
    """What was made, and what to try next."""
    screen.say(f"made in {seconds:.1f} s, in {out}/:")
    width = max(len(file.name) for file in files)
    for file in files:
        screen.say(f"  {file.name:<{width}}  {_MADE.get(file.name, '')}")
    other = "iiwa14" if arm.startswith("meccanoid") else "meccanoid-right"
    mine = f" --arm {arm}" if arm.endswith(".json") else ""
    jaxik = _program()
    screen.say("try next:")
    screen.say(f"  {jaxik} view {out}/trajectory.npz{mine}  # in the browser")
    screen.say(f"  {jaxik} view --arm {arm}  # drag its hand")
    screen.say(f"  {jaxik} demo --arm {other} --path figure-eight --out {out}-{other}")
    screen.say(f"  {jaxik} play {out}/trajectory.npz --speed 0.5")
    screen.say(f"  {jaxik} plan YOUR_PATH.csv --arm iiwa14 --out yours.csv")


def _program() -> str:
    """How to call this program from here: by its name where the shell finds it, else by its place."""
    here = FilePath(sys.argv[0])
    if here.name != "jaxik" or shutil.which("jaxik") is not None:
        return "jaxik"
    return os.path.relpath(here)
