"""``jaxik plan``: the least-energy motion along a path, as a trajectory file."""

from math import isfinite
from pathlib import Path as FilePath
from typing import Annotated, Any, Literal

import tyro

from jaxik import energy as energies
from jaxik.arm import ArmModel
from jaxik.cli.console import Screen
from jaxik.cli.inputs import find_arm, find_path
from jaxik.paths import Path
from jaxik.planning import Plan
from jaxik.planning import plan as plan_path
from jaxik.planning.baselines import Baselines, baselines
from jaxik.planning.path_fit import fit_path

_ENERGIES = {"joint-motion": energies.joint_motion, "holding": energies.holding, "servo": energies.servo}
_SIMPLER = {
    "fixed": "swivel fixed at 180°, as in the paper's example",
    "constant": "best constant swivel",
    "greedy": "to the nearest posture each time",
    "local": "nearest minimum from 180°",
}


def plan(
    path: Annotated[str, tyro.conf.Positional],
    arm: str = "meccanoid-right",
    out: FilePath = FilePath("trajectory.npz"),
    energy: Literal["joint-motion", "holding", "servo"] = "joint-motion",
    smoothness: float = 0.0,
    fit: bool = True,
    gap: float = 1.0,
    compare: bool = False,
    json: bool = False,
) -> int:
    """Plan the least-energy elbow along a path and save the trajectory.

    Args:
        path: Example path (word, figure-eight, reach, wave, spiral) or path file (.csv).
        arm: Preset (meccanoid-right, meccanoid-left, iiwa7, iiwa14, paper) or model file (.json).
        out: Trajectory file: .npz, .csv or .json.
        energy: What to make small: joint-motion (rad²/s), holding (torques at rest, N²m²s) or servo (J).
        smoothness: Weight of the smoothness energy beside it.
        fit: Place and scale the path into the arm's reach; with --no-fit it is taken as it is.
        gap: How close to the best possible the motion is to be proved, in percent; 0 for no proof.
        compare: Say also what simpler motions would cost: a fixed swivel, a greedy walk, a local search.
        json: Print one JSON document instead of the report.

    Returns:
        0 if there is a motion, else 1.
    """
    screen = Screen(json)
    model, asked = find_arm(arm), find_path(path)
    wanted = _ENERGIES[energy]()
    if smoothness:
        wanted = wanted + smoothness * energies.smoothness()
    found, placed = planned(screen, model, asked, wanted, fit, gap / 100 or None)
    if found.trajectory is not None:
        found.trajectory.save(out)
    screen.say(found.report())
    screen.say(f"saved {out}" if found.ok else "nothing saved")
    facts = {**plan_facts(found, placed), "file": str(out) if found.ok else None}
    if compare:
        with screen.step("simpler motions for comparison"):
            others = baselines(model.arm, placed, wanted)
        rows = [(_SIMPLER[name], f"{cost:.6g}" if isfinite(cost) else "breaks limits") for name, cost in _named(others)]
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
    """Places a path and plans on it, showing both steps."""
    if fit:
        with screen.step("placing the path in the arm's reach"):
            path = fit_path(path, model.arm)
    with screen.step(f"planning {len(path)} waypoints"):
        return plan_path(model, path, energy=energy, gap=gap), path


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
