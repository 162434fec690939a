"""``jaxik plan``: the motion of least energy along a path, as a trajectory file."""

from dataclasses import replace
from math import isfinite
from pathlib import Path as FilePath
from typing import Annotated, Any, Literal

import tyro

from jaxik import energy as energies
from jaxik.arm import ArmModel, as_arm
from jaxik.cli.console import Screen
from jaxik.cli.inputs import ENERGIES, find_arm, find_path, is_example, parse_fraction
from jaxik.cli.surroundings import find_body
from jaxik.obstacles import World, load_world
from jaxik.paths import Path
from jaxik.planning import Baselines, Plan, PlanStatus, baselines, compile_before_placing, fit_path
from jaxik.planning import plan as plan_path
from jaxik.targets import Pose

_SIMPLER = {
    "fixed": "swivel fixed at 180°, as in the paper's example",
    "constant": "best constant swivel",
    "greedy": "nearest posture at each waypoint",
    "local": "local minimum nearest to 180°",
}


def plan(
    path: Annotated[str, tyro.conf.Positional],
    arm: str = "meccanoid-right",
    base: str | None = None,
    tip: str | None = None,
    out: FilePath = FilePath("trajectory.npz"),
    energy: Literal["joint-motion", "holding", "servo"] = "joint-motion",
    smoothness: float = 0.0,
    fit: bool = False,
    columns: str | None = None,
    gap: str = "1%",
    closed: bool = False,
    compare: bool = False,
    world: FilePath | None = None,
    clearance: float = 0.0,
    json: bool = False,
) -> int:
    """Plan the motion of least energy along a path and save the trajectory.

    Args:
        path: Example path (word, figure-eight, reach, wave, spiral) or path file (.csv; ROS 2: .yaml).
        arm: Preset (`jaxik info` lists them), model file (.json), URDF (.urdf) or MJCF (.xml).
        base: Base link in a URDF; not needed, as the tip, if it has one arm (see `jaxik info FILE.urdf`). Base body in
            an MJCF, by default the world.
        tip: Tip link in a URDF; site or body of the tool in an MJCF.
        out: Trajectory file: .npz, .csv, .json; for ROS 2: .yaml, .ros.json, .mcap.
        energy: Energy to minimize: joint-motion (rad²/s), holding (gravity torques, N²m²s) or servo (J).
        smoothness: Factor of the smoothness energy that is added.
        fit: Move, turn and scale the path of a file into the arm's workspace; else it is where the file has it. Example
            paths are drawings and always placed.
        columns: Columns of a path file of another program, such as time=stamp,x=tool_x; the others are left out.
        gap: Largest gap between the energy and its certified lower bound, as 0.01 or 1%; 0 skips the certificate.
        closed: Return to the posture in which the motion begins, so that it can be repeated; the path's last target has
            to be its first.
        compare: Compare with simpler motions: fixed swivel, nearest posture at each waypoint, local search.
        world: Obstacles to keep clear of: shapes (.json) or points (.csv, .npy). The arm needs a body: iiwa14 and the
            Meccanoid have one, and URDF files with collision shapes.
        clearance: Distance to keep from obstacles at the waypoints [m].
        json: Print one JSON document instead of the report.

    Returns:
        0 if a motion was found, else 1.
    """
    screen = Screen(json)
    model, requested = find_arm(arm, base, tip), find_path(path, columns)
    if compare:
        as_arm(model, any_class=True, closed_form=True, instead="leave out --compare")  # said before the plan is made
    wanted = ENERGIES[energy]()
    if smoothness:
        wanted = wanted + smoothness * energies.smoothness()
    fitted = fit or is_example(path)
    around = None if world is None else load_world(world)
    model = model if around is None else find_body(model, arm, base, tip)
    found, placed = planned(
        screen, model, requested, wanted, fitted, parse_fraction(gap) or None, closed, around, clearance
    )
    if found.trajectory is not None:
        found.trajectory.save(out)
    screen.say(found.report())
    screen.say(f"saved {out}" if found.ok else "no trajectory saved")
    say_unfitted(screen, found, fitted)
    facts = {**plan_facts(found, placed), "file": str(out) if found.ok else None}
    if compare:
        with screen.step("computing simpler motions for comparison"):
            others = baselines(model.arm, placed, energy=wanted)
        rows = [
            (_SIMPLER[name], f"{cost:.6g}" if isfinite(cost) else "violates limits") for name, cost in _named(others)
        ]
        screen.table("simpler motions", ("motion", f"energy [{found.energy_unit}]"), rows)
        facts["simpler"] = {name: cost if isfinite(cost) else None for name, cost in _named(others)}
    screen.result(facts)
    return 0 if found.ok else 1


def _named(others: Baselines) -> list[tuple[str, float]]:
    return list(others._asdict().items())


def planned(
    screen: Screen,
    model: ArmModel,
    path: Path,
    energy: energies.Energy,
    fit: bool,
    gap: float | None = 0.01,
    closed: bool = False,
    world: World | None = None,
    clearance: float = 0.0,
) -> tuple[Plan, Path]:
    """Plan along a path, on request after placing it in the arm's workspace, and say what was done to it.

    Args:
        screen: Output.
        model: The arm.
        path: The path.
        energy: Energy to minimize.
        fit: Place the path by :func:`jaxik.fit_path`.
        gap: As for :func:`jaxik.plan`.
        closed: True for a motion that returns to its first posture.
        world: Obstacles; the model has a body then.
        clearance: As for :func:`jaxik.plan` [m].

    Returns:
        The plan and the path in its place.
    """
    if fit:
        if not closed and world is None:
            compile_before_placing(model.arm, path, energy)
        with screen.step("placing the path in the arm's workspace"):
            path = fit_path(model.arm, path, world=world)
        if path.placement is not None:
            screen.say(f"  the path was {path.placement.describe()}")
    elif model.arm.n_joints == 6 and isinstance(path.target, Pose):
        path = replace(path, target=path.target.pointing())
        screen.say(f"  {model.name} has six joints: the hand points as the path asks, and its roll is left free")
    with screen.step(f"planning {len(path)} waypoints"):
        end, around = "start" if closed else None, {"world": world, "clearance": clearance}
        return plan_path(model, path, energy=energy, gap=gap, end=end, **around), path


def say_unfitted(screen: Screen, plan: Plan, fitted: bool) -> None:
    """Say how to place a path that is out of reach where it is."""
    if plan.status == PlanStatus.UNREACHABLE and not fitted:
        screen.say("the path is where the file has it; --fit moves, turns and scales it into the arm's reach")


def plan_facts(plan: Plan, path: Path) -> dict[str, Any]:
    """Return the main results of a plan as plain values."""
    return {
        "status": plan.status.name,
        "problems": list(plan.problems),
        "waypoints": len(path),
        "energy": plan.energy if plan.ok else None,
        "energy_unit": plan.energy_unit,
        "lower_bound": plan.lower_bound,
        "gap": plan.gap,
        "branches": sorted({int(b) for b in plan.branch}) if plan.ok else [],
        "placement": None if path.placement is None else path.placement.describe(),
        "seconds": plan.seconds,
    }
