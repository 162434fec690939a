"""``jaxik plan``: the motion of least energy along a path, as a trajectory file."""

from math import isfinite
from pathlib import Path as FilePath
from typing import Annotated, Any, Literal

import tyro

from jaxik import energy as energies
from jaxik.arm import ArmModel
from jaxik.cli.console import Screen
from jaxik.cli.inputs import ENERGIES, find_arm, find_path, parse_fraction
from jaxik.paths import Path
from jaxik.planning import Baselines, Plan, baselines, fit_path
from jaxik.planning import plan as plan_path

_SIMPLER = {
    "fixed": "swivel fixed at 180°, as in the paper's example",
    "constant": "best constant swivel",
    "greedy": "nearest posture at each waypoint",
    "local": "local minimum nearest to 180°",
}


def plan(
    path: Annotated[str, tyro.conf.Positional],
    arm: str = "meccanoid-right",
    out: FilePath = FilePath("trajectory.npz"),
    energy: Literal["joint-motion", "holding", "servo"] = "joint-motion",
    smoothness: float = 0.0,
    fit: bool = True,
    gap: str = "1%",
    compare: bool = False,
    json: bool = False,
) -> int:
    """Plan the motion of least energy along a path and save the trajectory.

    Args:
        path: Example path (word, figure-eight, reach, wave, spiral) or path file (.csv).
        arm: Preset (meccanoid-right, meccanoid-left, iiwa7, iiwa14, paper) or model file (.json).
        out: Trajectory file: .npz, .csv or .json.
        energy: Energy to minimize: joint-motion (rad²/s), holding (gravity torques, N²m²s) or servo (J).
        smoothness: Factor of the smoothness energy that is added.
        fit: Move and scale the path into the arm's workspace; --no-fit leaves it in place.
        gap: Largest gap between the energy and its certified lower bound, as 0.01 or 1%; 0 skips the certificate.
        compare: Compare with simpler motions: fixed swivel, nearest posture at each waypoint, local search.
        json: Print one JSON document instead of the report.

    Returns:
        0 if a motion was found, else 1.
    """
    screen = Screen(json)
    model, requested = find_arm(arm), find_path(path)
    wanted = ENERGIES[energy]()
    if smoothness:
        wanted = wanted + smoothness * energies.smoothness()
    found, placed = planned(screen, model, requested, wanted, fit, parse_fraction(gap) or None)
    if found.trajectory is not None:
        found.trajectory.save(out)
    screen.say(found.report())
    screen.say(f"saved {out}" if found.ok else "no trajectory saved")
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
    fit: bool = True,
    gap: float | None = 0.01,
) -> tuple[Plan, Path]:
    """Place a path in the arm's workspace and plan on it, showing both steps.

    Args:
        screen: Output.
        model: The arm.
        path: The path.
        energy: Energy to minimize.
        fit: Place the path by :func:`jaxik.fit_path`.
        gap: As for :func:`jaxik.plan`.

    Returns:
        The plan and the path in its place.
    """
    if fit:
        with screen.step("placing the path in the arm's workspace"):
            path = fit_path(model.arm, path)
    with screen.step(f"planning {len(path)} waypoints"):
        return plan_path(model, path, energy=energy, gap=gap), path


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
