"""``jaxik plan``: the least-energy motion along a path, as a trajectory file."""

from pathlib import Path as FilePath
from typing import Annotated, Any

import tyro

from jaxik import energy as energies
from jaxik.arm import ArmModel
from jaxik.cli.console import Screen
from jaxik.cli.inputs import find_arm, find_path
from jaxik.path import Path
from jaxik.path_fit import fit_path
from jaxik.planning import Plan
from jaxik.planning import plan as plan_path


def plan(
    path: Annotated[str, tyro.conf.Positional],
    arm: str = "meccanoid-right",
    out: FilePath = FilePath("trajectory.npz"),
    smoothness: float = 0.0,
    fit: bool = True,
    json: bool = False,
) -> int:
    """Plan the least-energy elbow along a path and save the trajectory.

    Args:
        path: Example path (word, figure-eight, reach, wave, spiral) or path file (.csv).
        arm: Preset (meccanoid-right, meccanoid-left, iiwa7, iiwa14, paper) or model file (.json).
        out: Trajectory file: .npz, .csv or .json.
        smoothness: Weight of the smoothness energy beside joint motion.
        fit: Place and scale the path into the arm's reach; with --no-fit it is taken as it is.
        json: Print one JSON document instead of the report.

    Returns:
        0 if there is a motion, else 1.
    """
    screen = Screen(json)
    model, asked = find_arm(arm), find_path(path)
    energy = energies.joint_motion()
    if smoothness:
        energy = energy + smoothness * energies.smoothness()
    found, placed = planned(screen, model, asked, energy, fit)
    if found.trajectory is not None:
        found.trajectory.save(out)
    screen.say(found.report())
    screen.say(f"saved {out}" if found.ok else "nothing saved")
    screen.result({**plan_facts(found, placed), "file": str(out) if found.ok else None})
    return 0 if found.ok else 1


def planned(
    screen: Screen, model: ArmModel, path: Path, energy: energies.Energy, fit: bool = True
) -> tuple[Plan, Path]:
    """Places a path and plans on it, showing both steps."""
    if fit:
        with screen.step("placing the path in the arm's reach"):
            path = fit_path(path, model.arm)
    with screen.step(f"planning {len(path)} waypoints"):
        return plan_path(model, path, energy=energy), path


def plan_facts(plan: Plan, path: Path) -> dict[str, Any]:
    """A plan's essentials as plain values."""
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
