"""The energy map: cost by color over time and swivel, with planned motions drawn on top."""

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxik.planning import EnergyMap, Plan
from jaxik.trajectories import Trajectory
from jaxik.view.figures import INK, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw_energy_map(
    costs: EnergyMap,
    plan: Plan | Trajectory | None = None,
    others: Mapping[str, Trajectory] | None = None,
    *,
    size: tuple[float, float] = (8.0, 4.6),
) -> "Figure":
    """Draw the cost of every swivel along a path, the swivel of a plan, and its certified lower bound.

    Args:
        costs: Costs by :func:`jaxik.energy_map`.
        plan: Plan or trajectory whose swivel is drawn; a plan adds its energy and lower bound to the title.
        others: Further motions along the same path by name, drawn dashed.
        size: Width and height [inch].

    Returns:
        The figure.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    figure = new_figure(*size)
    from matplotlib.artist import Artist
    from matplotlib.colors import LogNorm
    from matplotlib.patches import Patch

    axes = figure.add_subplot()
    axes.set_facecolor("#eceff1")
    finite = costs.cost[np.isfinite(costs.cost) & (costs.cost > 0)]
    low, high = np.quantile(finite, [0.01, 0.99]) if len(finite) else (1e-3, 1.0)
    step = float(costs.swivel[1] - costs.swivel[0])
    time_edges = np.concatenate([costs.time[:1], (costs.time[1:] + costs.time[:-1]) / 2, costs.time[-1:]])
    motions = [(name, motion, style) for name, motion, style in _motions(plan, others or {}) if motion is not None]
    middle = _middle(motions[0][1]) if motions else 0.0
    turned = _turned(np.degrees(costs.swivel), middle)
    order = np.argsort(turned)
    swivel_edges = np.append(turned[order], turned[order[-1]] + np.degrees(step)) - np.degrees(step) / 2
    shown = np.ma.masked_invalid(costs.cost[:, order]).T
    norm = LogNorm(max(low, high * 1e-4), max(high, low * 1.01))
    mesh = axes.pcolormesh(time_edges, swivel_edges, shown, norm=norm, cmap="viridis", rasterized=True)
    bar = figure.colorbar(mesh, ax=axes, pad=0.02)
    bar.set_label(f"cost per second at this swivel [{costs.unit}]", fontsize=9)
    handles: list[Artist] = [
        Patch(facecolor="#eceff1", edgecolor=INK, linewidth=0.5, label="infeasible: limits or obstacles")
    ]
    handles[:0] = [_draw_swivel(axes, motion, name, style, middle) for name, motion, style in motions]
    axes.set_xlim(costs.time[0], costs.time[-1])
    axes.set_ylim(middle - 180, middle + 180)
    axes.set_yticks(np.arange(middle - 180, middle + 181, 60))
    axes.set_xlabel("time along the path [s]")
    axes.set_ylabel("swivel of the elbow [°]")
    axes.set_title("Energy map" + _facts(plan), fontsize=11, color=INK)
    figure.legend(handles=handles, loc="outside lower left", ncols=2, fontsize=9, frameon=False)
    return figure


def _motions(
    plan: Plan | Trajectory | None, others: Mapping[str, Trajectory]
) -> list[tuple[str, Trajectory | None, dict[str, Any]]]:
    """Name, motion and line style of every swivel to draw."""
    if isinstance(plan, Plan):
        own = None if plan.trajectory is None else replace(plan.trajectory, swivel=plan.swivel)
    else:
        own = plan
    dashes = ({"linestyle": (0, (4, 2)), "color": "#f4a259"}, {"linestyle": (0, (1, 1.2)), "color": "#f28482"})
    name = "planned swivel" if isinstance(plan, Plan) else "swivel"
    return [
        (name, own, {"color": "white"}),
        *((name, motion, dashes[i % 2]) for i, (name, motion) in enumerate(others.items())),
    ]


def _middle(motion: Trajectory) -> float:
    """Center of the swivel axis [°]: 0, or 180 for a motion near the half turn, so that the axis does not cut it."""
    return 0.0 if motion.swivel is None or np.cos(motion.swivel).mean() > -0.3 else 180.0


def _turned(degrees: np.ndarray, middle: float) -> np.ndarray:
    """Angles shifted by full turns to within half a turn of a center [°]."""
    return (degrees - middle + 180) % 360 - 180 + middle


def _draw_swivel(axes, motion: Trajectory, name: str, style: dict[str, Any], middle: float):
    """Draw the swivel of a motion, broken where it passes the ends of the axis."""
    from matplotlib.patheffects import withStroke

    assert motion.swivel is not None, "a motion drawn on a map has swivels"
    degrees = _turned(np.degrees(motion.swivel), middle)
    gaps = np.flatnonzero(np.abs(np.diff(degrees)) > 180) + 1
    time = np.insert(motion.time, gaps, np.nan)
    line = axes.plot(time, np.insert(degrees, gaps, np.nan), linewidth=2.2, label=name, **style)[0]
    line.set_path_effects([withStroke(linewidth=4.2, foreground="black")])
    return line


def _facts(plan: Plan | Trajectory | None) -> str:
    """Energy of a plan and its certified lower bound."""
    if not isinstance(plan, Plan) or plan.trajectory is None:
        return ""
    branch = f"branch {int(plan.branch[0])}" if len(np.unique(plan.branch)) == 1 else "changing branches"
    proved = "" if plan.lower_bound is None else f"\ncertified lower bound {plan.lower_bound:.4g}"
    within = "" if plan.gap is None else f": gap at most {100 * plan.gap:.2f} %"
    return f": {plan.energy:.4g} {plan.energy_unit} ({plan.energy_name}), {branch}{proved}{within}"
