"""``jaxik demo``: from a path to a played trajectory."""

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
from jaxik.cli.inputs import find_arm, find_path, is_example
from jaxik.cli.plan import plan_facts, planned, say_unfitted
from jaxik.paths import Path
from jaxik.planning import Plan, energy_map
from jaxik.trajectories import Trajectory, load_trajectory
from jaxik.view import draw_arm, draw_energy_map, draw_joints, draw_tracking, draw_velocities

_FILES = {
    "arm.png": "the arm on its path, and the path of its elbow",
    "energy_map.png": "cost of every swivel, and the planned one",
    "joints.png": "joint angles within their ranges",
    "velocities.png": "joint velocities within their limits",
    "tracking.png": "commanded and measured angles on the simulated board",
    "trajectory.npz": "the trajectory, for programs",
    "trajectory.csv": "the trajectory, for spreadsheets",
    "trajectory.json": "the trajectory, for everything else",
    "report.txt": "energy, certificate and status",
}

PLAYERS = "jaxik.players"  # entry points (trajectory, progress) -> report, so that jaxik imports no player


def demo(
    out: FilePath = FilePath("demo"),
    arm: str = "meccanoid-right",
    base: str | None = None,
    tip: str | None = None,
    path: str = "word",
    fit: bool = False,
    json: bool = False,
) -> int:
    """Run the whole chain: path, plan, pictures, trajectory files, playback on a simulated board.

    Args:
        out: Output folder, created if it does not exist.
        arm: Preset (`jaxik info` lists them), model file (.json), URDF (.urdf) or MJCF (.xml).
        base: Base link in a URDF; not needed, as the tip, if it has one arm (see `jaxik info FILE.urdf`). Base body in
            an MJCF, by default the world.
        tip: Tip link in a URDF; site or body of the tool in an MJCF.
        path: Example path (word, figure-eight, reach, wave, spiral) or path file (.csv; ROS 2: .yaml).
        fit: Move, turn and scale the path of a file into the arm's workspace; example paths always are.
        json: Print one JSON document instead of progress and tables.

    Returns:
        0 if everything succeeded, else 1.
    """
    began = time.perf_counter()
    screen = Screen(json)
    model, requested = find_arm(arm, base, tip), find_path(path)
    out.mkdir(parents=True, exist_ok=True)
    screen.say(
        f"[bold]{path}[/bold] with [bold]{model.name}[/bold]: {len(requested)} waypoints, {requested.length:.2f} m",
        styled=True,
    )
    fitted = fit or is_example(path)
    plan, placed = planned(screen, model, requested, energies.joint_motion(), fitted)
    if plan.trajectory is None:
        screen.say(plan.report())
        say_unfitted(screen, plan, fitted)
        screen.result({"plan": plan_facts(plan, placed), "files": [], "played": None})
        return 1
    with screen.step("drawing"):
        files = _pictures(model, plan, placed, out)
    with screen.step("writing and reading back the trajectory files"):
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
    ends = "" if base is None else f" --base {base} --tip {tip}"
    _closing(screen, files, out, arm, ends, time.perf_counter() - began)
    return 0 if report is None or report.ok else 1


def _pictures(model: ArmModel, plan: Plan, path: Path, out: FilePath) -> list[FilePath]:
    """Draw the pictures of the plan and return their files."""
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
    """Save the trajectory in all three formats and read each back."""
    files = [out / f"trajectory{ending}" for ending in (".npz", ".csv", ".json")]
    for file in files:
        trajectory.save(file)
        if load_trajectory(file) != trajectory:
            raise OSError(f"{file} does not read back as it was written; check the disk")
    return files


def _play(screen: Screen, trajectory: Trajectory) -> Any | None:
    """Play on the simulated board of the package that provides one."""
    players = entry_points(group=PLAYERS, name="simulated")
    if not players:
        screen.say("no player is installed; the trajectory was not played")
        return None
    play = next(iter(players)).load()
    with screen.step("playing on the simulated board") as progress:
        return play(trajectory, progress)


def _tables(screen: Screen, model: ArmModel, plan: Plan, report: Any | None) -> None:
    """Print the results, overall and per joint."""
    t = plan.trajectory
    assert t is not None
    bound = "none" if plan.lower_bound is None else f"{plan.lower_bound:.5g} (gap {100 * (plan.gap or 0):.2f} %)"
    rows = [
        ("energy", f"{plan.energy:.5g} {plan.energy_unit}"),
        ("before refinement", f"{plan.energy_before_refinement:.5g} {plan.energy_unit}"),
        ("lower bound", bound),
        ("swivel", f"{np.degrees(plan.swivel.min()):.1f}° to {np.degrees(plan.swivel.max()):.1f}°"),
        ("branch", ", ".join(str(b) for b in dict.fromkeys(plan.branch.tolist()))),
        ("duration", f"{t.duration:.2f} s"),
        ("played", "no" if report is None else f"{report.result.name}: {report.message}"),
    ]
    screen.table("plan", ("quantity", "value"), rows)
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
    screen.table("joints", ("joint", "motion [°]", "range [°]", "velocity", "error [°]"), joints)


def _closing(screen: Screen, files: list[FilePath], out: FilePath, arm: str, ends: str, seconds: float) -> None:
    """Print the files and suggestions for further commands."""
    screen.say(f"files in {out}/, after {seconds:.1f} s:")
    width = max(len(file.name) for file in files)
    for file in files:
        screen.say(f"  {file.name:<{width}}  {_FILES.get(file.name, '')}")
    other = "iiwa14" if arm.startswith("meccanoid") else "meccanoid-right"
    mine = f" --arm {arm}{ends}" if arm.lower().endswith((".json", ".urdf", ".xacro", ".xml")) else ""
    jaxik = _program()
    screen.say("try next:")
    screen.say(f"  {jaxik} view {out}/trajectory.npz{mine}  # in the browser")
    screen.say(f"  {jaxik} view --arm {arm}{ends}  # drag the hand")
    screen.say(f"  {jaxik} demo --arm {other} --path figure-eight --out {out}-{other}")
    screen.say(f"  {jaxik} play {out}/trajectory.npz --speed 0.5")
    screen.say(f"  {jaxik} plan YOUR_PATH.csv --arm iiwa14 --out yours.csv")


def _program() -> str:
    """Name of this program if the shell finds it, else its relative path."""
    here = FilePath(sys.argv[0])
    if here.name != "jaxik" or shutil.which("jaxik") is not None:
        return "jaxik"
    return os.path.relpath(here)
