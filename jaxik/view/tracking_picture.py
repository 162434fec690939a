"""Tracking of a playback: commanded and measured angles and their difference."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

from jaxik.view.figures import COOL, INK, PALE, WARM, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@runtime_checkable
class TrackingLog(Protocol):
    """Protocol of a player's log, such as ``hardware.PlayLog``."""

    @property
    def time(self) -> np.ndarray:
        """Times of the rows, ``(N,)`` [s]."""
        ...

    @property
    def phase(self) -> Sequence[str]:
        """Activity in each row; ``"play"`` while the trajectory itself was played."""
        ...

    @property
    def commanded(self) -> np.ndarray:
        """Commanded joint angles, ``(N, joint)`` [rad]."""
        ...

    @property
    def measured(self) -> np.ndarray:
        """Measured joint angles, ``(N, joint)`` [rad]; NaN for servos without position feedback."""
        ...

    @property
    def joint_names(self) -> Sequence[str]:
        """Names of the joints."""
        ...


def draw_tracking(log: TrackingLog) -> "Figure":
    """Draw commanded and measured joint angles of a playback.

    Args:
        log: Log of the playback, ``hardware.play(...).log``.

    Returns:
        The figure: angles on the left, measured minus commanded angles on the right; other phases are shaded.

    Raises:
        MissingExtraError: matplotlib is not installed.
        ValueError: The log is empty because nothing was moved; the report's message gives the reason.
    """
    if not len(log.time):
        raise ValueError("expected a log with rows, got an empty one: nothing was moved; see the message of the report")
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
    figure.supylabel("joint angle [°] and measured minus commanded [°]; shaded: approach, hold", fontsize=9)
    return figure


def _summary(error: np.ndarray) -> str:
    """Root mean square and largest error of a joint while the trajectory was played."""
    if not np.isfinite(error).any():
        return "no position feedback"
    return f"rms {np.sqrt(np.nanmean(error**2)):.2f}°, max {np.nanmax(np.abs(error)):.2f}°"


def _shade(axes, time: np.ndarray, played: np.ndarray) -> None:
    """Shade the rows in which the trajectory was not played."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], (~played).astype(int), [0]])))
    for start, end in edges.reshape(-1, 2):
        axes.axvspan(time[start], time[min(end, len(time) - 1)], color="#f1f5f8", zorder=0)
