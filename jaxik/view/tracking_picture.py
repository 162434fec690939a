"""How a playback followed its commands: commanded and measured angles, and the difference."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

from jaxik.view.figures import COOL, INK, PALE, WARM, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@runtime_checkable
class TrackingLog(Protocol):
    """What a player's log offers, such as ``hardware.PlayLog``: who plays is not this package's business.

    Attributes:
        time: ``(N,)`` [s].
        phase: What was done in each row; ``"play"`` where the trajectory itself was played.
        commanded: ``(N, joint)`` [rad].
        measured: ``(N, joint)`` [rad]; nan where a servo reports nothing.
        joint_names: Names.
    """

    @property
    def time(self) -> np.ndarray: ...  # noqa: D102 - described above
    @property
    def phase(self) -> Sequence[str]: ...  # noqa: D102
    @property
    def commanded(self) -> np.ndarray: ...  # noqa: D102
    @property
    def measured(self) -> np.ndarray: ...  # noqa: D102
    @property
    def joint_names(self) -> Sequence[str]: ...  # noqa: D102


def draw_tracking(log: TrackingLog) -> "Figure":
    """Draws what a player commanded and what the servos measured, joint by joint.

    Args:
        log: Of the playback: ``hardware.play(...).log``.

    Returns:
        The figure: angles on the left, measured minus commanded on the right; easing in and holding are shaded.

    Raises:
        MissingExtraError: matplotlib is absent; with the pip line.
        ValueError: The log is empty: nothing was moved; the report's message says why.
    """
    if not len(log.time):
        raise ValueError("the log is empty: nothing was moved; see the message of the playback's report")
    joints = len(log.joint_names)
    figure = new_figure(9.0, 0.8 + 1.15 * joints)
    rows = figure.subplots(joints, 2, sharex=True, squeeze=False, width_ratios=(1.4, 1))
    commanded, measured = np.degrees(log.commanded), np.degrees(log.measured)
    played = np.array([phase == "play" for phase in log.phase], bool)
    error = measured - commanded
    largest = np.nanmax(np.abs(error)) if np.isfinite(error).any() else 1.0
    for j, (angle, off) in enumerate(rows):
        angle.plot(log.time, commanded[:, j], color=PALE, linewidth=3.2, label="commanded")
        angle.plot(log.time, measured[:, j], color=COOL, linewidth=1.2, label="measured")
        angle.set_title(log.joint_names[j], fontsize=8, loc="left", color=INK, pad=2)
        angle.margins(y=0.15)
        off.axhline(0, color=PALE, linewidth=1.0)
        off.plot(log.time, error[:, j], color=WARM, linewidth=1.2)
        off.set_ylim(-1.15 * largest, 1.15 * largest)
        off.set_title(_summary(error[played, j]), fontsize=8, loc="left", color=INK, pad=2)
        for axes in (angle, off):
            _shade(axes, log.time, played)
            axes.tick_params(labelsize=8)
            axes.spines[["top", "right"]].set_visible(False)
    for axes in rows[-1]:
        axes.set_xlabel("time [s]", fontsize=9)
        axes.set_xlim(log.time[0], log.time[-1])
    rows[0, 0].legend(loc="upper right", fontsize=8, frameon=False, ncols=2, bbox_to_anchor=(1.0, 1.35))
    figure.supylabel("joint angle [°] and measured minus commanded [°]; shaded: easing in, holding", fontsize=9)
    return figure


def _summary(error: np.ndarray) -> str:
    """Root mean square and worst of a joint, while the trajectory played."""
    if not np.isfinite(error).any():
        return "this servo reports nothing"
    return f"rms {np.sqrt(np.nanmean(error**2)):.2f}°, worst {np.nanmax(np.abs(error)):.2f}°"


def _shade(axes, time: np.ndarray, played: np.ndarray) -> None:
    """Greys what was not the trajectory itself."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], (~played).astype(int), [0]])))
    for start, end in edges.reshape(-1, 2):
        axes.axvspan(time[start], time[min(end, len(time) - 1)], color="#f1f5f8", zorder=0)
