"""Training curves: losses over the steps."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from jaxik.view.figures import COOL, INK, PALE, WARM, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLORS = (COOL, WARM, "#229654", "#7b5ea7", "#c98a1b", INK)


def draw_learning(
    losses: Mapping[str, ArrayLike],
    *,
    steps: ArrayLike | None = None,
    levels: Mapping[str, float] | None = None,
    unit: str = "",
) -> "Figure":
    """Draw losses over the steps of a training, on a logarithmic axis if they span a decade.

    Args:
        losses: Curves by name, ``(N,)`` each; NaN at steps without a value.
        steps: Step of each value, ``(N,)``; None for 0, 1, 2, …
        levels: Horizontal reference lines by name, such as the loss of a simple rule.
        unit: Unit of the losses.

    Returns:
        The figure; curves of more than 200 values are drawn faint, with their running median on top.

    Raises:
        MissingExtraError: matplotlib is not installed.
        ValueError: There is no curve, or the length of a curve differs from that of the steps.
    """
    curves = {name: np.asarray(values, float) for name, values in losses.items()}
    if not curves:
        raise ValueError("expected at least one curve, got none")
    figure = new_figure(8.0, 4.2)
    axes = figure.add_subplot()
    for (name, values), color in zip(curves.items(), _COLORS * len(curves), strict=False):
        at = np.arange(len(values)) if steps is None else np.asarray(steps)
        if at.shape != values.shape:
            raise ValueError(f"expected one value per step, got shape {values.shape} for {name!r} and {at.shape} steps")
        known = np.isfinite(values)
        faint = known.sum() > 200
        axes.plot(at[known], values[known], color=color, linewidth=1.6, alpha=0.25 if faint else 1.0,
                  label=None if faint else name)  # fmt: skip
        if faint:
            axes.plot(*_running_median(at[known], values[known]), color=color, linewidth=1.8, label=name)
    for name, level in (levels or {}).items():
        axes.axhline(level, color=PALE, linewidth=1.4, linestyle="--")
        axes.annotate(f"{name}: {level:.3g}", (1.0, level), xycoords=("axes fraction", "data"), fontsize=8, color=INK,
                      ha="right", va="bottom")  # fmt: skip
    finite = np.concatenate([v[np.isfinite(v)] for v in curves.values()])
    if len(finite) and finite.min() > 0 and finite.max() > 10 * finite.min():
        axes.set_yscale("log")
    axes.set_xlabel("training step")
    axes.set_ylabel(f"loss [{unit}]" if unit else "loss")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=9, frameon=False)
    return figure


def _running_median(at: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Running median over a fiftieth of the curve."""
    width = max(len(values) // 50, 3) | 1
    windows = np.lib.stride_tricks.sliding_window_view(values, width)
    return at[width // 2 : width // 2 + len(windows)], np.median(windows, axis=1)
