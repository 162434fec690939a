"""The joints over time, each within its own range."""

from typing import TYPE_CHECKING

import numpy as np

from jaxik.arm import Arm, ArmModel
from jaxik.trajectory import Trajectory
from jaxik.view.figures import COOL, INK, PALE, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw_joints(arm: Arm | ArmModel, trajectory: Trajectory) -> "Figure":
    """Draws each joint's angle over time with its limits, and how much of its speed it uses.

    Args:
        arm: The arm.
        trajectory: Its motion.

    Returns:
        The figure.

    Raises:
        MissingExtraError: matplotlib is absent; with the pip line.
    """
    bare = arm.arm if isinstance(arm, ArmModel) else arm
    joints = len(trajectory.joint_names)
    figure = new_figure(8.0, 0.6 + 1.05 * joints)
    rows = figure.subplots(joints, 1, sharex=True)
    lower, upper = np.degrees(np.asarray(bare.lower)), np.degrees(np.asarray(bare.upper))
    used = np.abs(trajectory.qd) / np.asarray(bare.velocity_limit) if len(trajectory) > 1 else np.zeros((1, joints))
    for j, axes in enumerate(np.atleast_1d(rows)):
        q = np.degrees(trajectory.q[:, j])
        axes.axhspan(lower[j], upper[j], color="#f1f5f8", zorder=0)
        for limit in (lower[j], upper[j]):
            axes.axhline(limit, color=PALE, linewidth=1.0)
        axes.plot(trajectory.time_s, q, color=COOL, linewidth=1.6)
        pad = 0.06 * (upper[j] - lower[j])
        axes.set_ylim(min(lower[j], q.min()) - pad, max(upper[j], q.max()) + pad)
        axes.set_yticks([round(lower[j]), round(upper[j])])
        axes.tick_params(labelsize=8)
        title = f"{trajectory.joint_names[j]}: fastest at {100 * used[:, j].max():.0f} % of its speed limit"
        axes.set_title(title, fontsize=8, loc="left", color=INK, pad=2)
        axes.spines[["top", "right"]].set_visible(False)
    last = np.atleast_1d(rows)[-1]
    last.set_xlabel("time [s]", fontsize=9)
    last.set_xlim(trajectory.time_s[0], trajectory.time_s[-1])
    figure.supylabel("joint angle [°], shaded: its range", fontsize=9)
    return figure
