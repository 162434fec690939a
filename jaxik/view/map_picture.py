"""The energy map: waypoint across, swivel up, colour what it costs there, and the plan drawn over it."""

from typing import TYPE_CHECKING

import numpy as np

from jaxik.planning.energy_map import EnergyMap
from jaxik.planning.result import Plan
from jaxik.view.figures import INK, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw_energy_map(costs: EnergyMap, plan: Plan | None = None) -> "Figure":
    """Draws what each swivel costs along a path.

    Args:
        costs: From :func:`jaxik.planning.energy_map`.
        plan: Whose swivel to draw over it.

    Returns:
        The figure.

    Raises:
        MissingExtraError: matplotlib is absent; with the pip line.
    """
    figure = new_figure(8.0, 4.6)
    from matplotlib.artist import Artist
    from matplotlib.colors import LogNorm
    from matplotlib.patches import Patch

    axes = figure.add_subplot()
    axes.set_facecolor("#eceff1")
    seen = costs.cost[np.isfinite(costs.cost) & (costs.cost > 0)]
    low, high = np.quantile(seen, [0.01, 0.99]) if len(seen) else (1e-3, 1.0)
    step = float(costs.swivel[1] - costs.swivel[0])
    time_edges = np.concatenate([costs.time_s[:1], (costs.time_s[1:] + costs.time_s[:-1]) / 2, costs.time_s[-1:]])
    swivel_edges = np.degrees(np.append(costs.swivel, costs.swivel[-1] + step) - step / 2)
    shown = np.ma.masked_invalid(costs.cost).T
    norm = LogNorm(max(low, high * 1e-4), max(high, low * 1.01))
    mesh = axes.pcolormesh(time_edges, swivel_edges, shown, norm=norm, cmap="viridis", rasterized=True)
    bar = figure.colorbar(mesh, ax=axes, pad=0.02)
    bar.set_label(f"cost of passing with the elbow held there [{costs.unit}]", fontsize=9)
    handles: list[Artist] = [
        Patch(facecolor="#eceff1", edgecolor=INK, linewidth=0.5, label="not feasible: limits or keep-out")
    ]
    if plan is not None and plan.trajectory is not None:
        handles.insert(0, _draw_swivel(axes, plan))
    axes.set_xlim(costs.time_s[0], costs.time_s[-1])
    axes.set_ylim(-180, 180)
    axes.set_yticks(range(-180, 181, 60))
    axes.set_xlabel("time along the path [s]")
    axes.set_ylabel("swivel of the elbow [°]")
    axes.set_title("Energy map" + _facts(plan), fontsize=11, color=INK)
    figure.legend(handles=handles, loc="outside lower left", ncols=2, fontsize=9, frameon=False)
    return figure


def _draw_swivel(axes, plan: Plan):
    """The planned swivel, broken where it passes the half turn."""
    from matplotlib.patheffects import withStroke

    assert plan.trajectory is not None
    degrees = (np.degrees(plan.swivel) + 180) % 360 - 180
    gaps = np.flatnonzero(np.abs(np.diff(degrees)) > 180) + 1
    time_s = np.insert(plan.trajectory.time_s, gaps, np.nan)
    line = axes.plot(time_s, np.insert(degrees, gaps, np.nan), color="white", linewidth=2.2, label="planned swivel")[0]
    line.set_path_effects([withStroke(linewidth=4.2, foreground="black")])
    return line


def _facts(plan: Plan | None) -> str:
    """What the plan costs."""
    if plan is None or plan.trajectory is None:
        return ""
    proved = "" if plan.gap is None else f", at most {100 * plan.gap:.1f} % above the best possible"
    branch = f"branch {int(plan.branch[0])}" if len(np.unique(plan.branch)) == 1 else "changing branches"
    return f": {plan.energy:.4g} {plan.energy_unit} ({plan.energy_name}), {branch}{proved}"
