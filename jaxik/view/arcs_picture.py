"""Feasible arcs of one target: one ring per branch, the elbow's circle seen along the line to the wrist."""

from typing import TYPE_CHECKING

import numpy as np

from jaxik.redundancy import SwivelArcs
from jaxik.view.figures import COOL, INK, PALE, WARM, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_GREEN = "#229654"


def draw_arcs(arcs: SwivelArcs, *, swivel: float | None = None, branch: int | None = None) -> "Figure":
    """Draw the feasible swivels of every branch at one target.

    Args:
        arcs: Arcs of a single target by :func:`jaxik.swivel_arcs`, ``(8, arcs)``.
        swivel: Swivel to mark [rad].
        branch: Branch to highlight.

    Returns:
        The figure; branch 0 is the innermost ring, swivel 0 is at the top and grows counterclockwise.

    Raises:
        MissingExtraError: matplotlib is not installed.
        ValueError: The arcs are those of several targets.
    """
    start, end, valid = (np.asarray(x) for x in (arcs.start, arcs.end, arcs.valid))
    if start.ndim != 2:
        raise ValueError(f"draw_arcs draws the arcs of one target, of shape (8, arcs), got {start.shape}; select a row")
    figure = new_figure(5.2, 5.4)
    axes = figure.add_subplot(projection="polar")
    axes.set_theta_zero_location("N")  # pyright: ignore[reportAttributeAccessIssue] - polar
    around = np.linspace(-np.pi, np.pi, 181)
    for b in range(8):
        radius = 3.0 + b
        axes.plot(around, np.full(181, radius), color=PALE, linewidth=1.0, zorder=1)
        for k in np.flatnonzero(valid[b]):
            along = np.linspace(start[b, k], end[b, k], 91)
            color = COOL if b == branch else _GREEN
            axes.plot(along, np.full(91, radius), color=color, linewidth=6.0, solid_capstyle="butt", zorder=2)
        axes.text(np.radians(180), radius, str(b), fontsize=8, ha="center", va="center", color=INK, zorder=3,
                  bbox={"boxstyle": "circle,pad=0.12", "facecolor": "white", "edgecolor": "none"})  # fmt: skip
    if swivel is not None:
        axes.plot([swivel, swivel], [0, 10.6], color=WARM, linewidth=1.6, zorder=4)
    axes.set_ylim(0, 10.8)
    axes.set_yticks([])
    axes.set_xticks(np.radians([0, 45, 90, 135, 180, 225, 270, 315]))
    axes.set_xticklabels(["0°", "45°", "90°", "135°", "±180°", "-135°", "-90°", "-45°"], fontsize=8)
    axes.grid(alpha=0.25)
    axes.spines["polar"].set_visible(False)
    axes.set_title("Feasible swivels of the eight branches", fontsize=11, color=INK)
    return figure
