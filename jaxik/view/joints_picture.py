"""Joint angles, velocities and torques over time, with their limits."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np

from jaxik.arm import Arm, ArmModel, as_arm
from jaxik.kinematics import gravity_torque, inverse_dynamics
from jaxik.trajectories import Trajectory
from jaxik.view.figures import COOL, INK, PALE, WARM, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw_joints(arm: Arm | ArmModel, trajectory: Trajectory) -> "Figure":
    """Draw the joint angles over time with their limits, and the largest fraction of each velocity limit.

    Args:
        arm: The arm.
        trajectory: Its motion.

    Returns:
        The figure.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    bare = as_arm(arm)
    lower, upper = np.degrees(np.asarray(bare.lower)), np.degrees(np.asarray(bare.upper))
    used = np.zeros(len(lower))
    if len(trajectory) > 1:
        used = (np.abs(trajectory.qd) / np.asarray(bare.velocity_limit)).max(0)
    titles = [
        f"{name}: at most {100 * share:.0f} % of its velocity limit"
        for name, share in zip(trajectory.joint_names, used, strict=True)
    ]
    label = "joint angle [°], shaded: range"
    return _draw_rows(trajectory.time, np.degrees(trajectory.q), lower, upper, titles, label)


def draw_velocities(arm: Arm | ArmModel, trajectory: Trajectory) -> "Figure":
    """Draw the joint velocities over time with their limits.

    Args:
        arm: The arm.
        trajectory: Its motion, with at least two waypoints; the velocities are the mean velocities of the steps.

    Returns:
        The figure.

    Raises:
        MissingExtraError: matplotlib is not installed.
        ValueError: The trajectory has a single waypoint and thus no velocity.
    """
    bare = as_arm(arm)
    if len(trajectory) < 2:
        raise ValueError("expected at least two waypoints to draw velocities, got one waypoint")
    limit = np.degrees(np.asarray(bare.velocity_limit, float))
    speed = np.degrees(trajectory.qd)
    titles = _share_titles(trajectory.joint_names, speed, limit, "°/s")
    middle = (trajectory.time[1:] + trajectory.time[:-1]) / 2
    label = "joint velocity [°/s], shaded: within its limit"
    return _draw_rows(middle, speed, -limit, limit, titles, label, half_height=_half_height(speed, limit))


def draw_torques(arm: Arm | ArmModel, trajectory: Trajectory) -> "Figure":
    """Draw the motor torques over time with their limits, and the part that gravity alone requires.

    Args:
        arm: The arm, with masses.
        trajectory: Its motion, with at least three waypoints. Velocities and accelerations are central differences;
            rotor inertia, gears and friction are neglected.

    Returns:
        The figure.

    Raises:
        MissingExtraError: matplotlib is not installed.
        ValueError: The trajectory has fewer than three waypoints and thus no acceleration.
    """
    bare = as_arm(arm)
    if len(trajectory) < 3:
        raise ValueError(f"expected at least three waypoints to compute accelerations, got {len(trajectory)}")
    time, step = trajectory.time, np.diff(trajectory.time)
    qdd = np.diff(trajectory.qd, axis=0) / ((step[1:] + step[:-1]) / 2)[:, None]
    qd = (trajectory.q[2:] - trajectory.q[:-2]) / (step[1:] + step[:-1])[:, None]
    q, qd, qdd = (jnp.asarray(x, bare.axes.dtype) for x in (trajectory.q[1:-1], qd, qdd))
    torque = np.asarray(inverse_dynamics(bare, q, qd, qdd), float)
    held = np.asarray(gravity_torque(bare, q), float)
    limit = np.asarray(bare.torque_limit, float)
    titles = _share_titles(trajectory.joint_names, torque, limit, "N m")
    label = "motor torque [N m], dashed: gravity alone, shaded: within its limit"
    return _draw_rows(
        time[1:-1], torque, -limit, limit, titles, label, dashed=held, half_height=_half_height(torque, limit)
    )


def _share_titles(names: Sequence[str], values: np.ndarray, limit: np.ndarray, unit: str) -> list[str]:
    """Titles with the largest value of each joint and its fraction of the limit."""
    most = np.abs(values).max(0)
    return [
        f"{name}: at most {m:.3g} {unit}, "
        + (f"{100 * m / x:.0f} % of its limit of ±{x:.3g} {unit}" if np.isfinite(x) else "no known limit")
        for name, m, x in zip(names, most, limit, strict=True)
    ]


def _half_height(values: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """Half height of each row: the limit, or less where the values use little of it."""
    most = np.abs(values).max(0)
    return np.where(most > 0.3 * limit, limit, np.maximum(1.3 * most, 0.02 * np.where(np.isfinite(limit), limit, 0.0)))


def _draw_rows(
    time: np.ndarray,
    values: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    titles: Sequence[str],
    label: str,
    dashed: np.ndarray | None = None,
    half_height: np.ndarray | None = None,
) -> "Figure":
    """Draw values ``(N, joint)`` in one row per joint, within its limits or within ``half_height`` of zero."""
    joints = values.shape[1]
    figure = new_figure(8.0, 0.6 + 1.05 * joints)
    rows = figure.subplots(joints, 1, sharex=True, squeeze=False)[:, 0]
    for j, axes in enumerate(rows):
        own = values[:, j]
        if np.isfinite([lower[j], upper[j]]).all():
            axes.axhspan(lower[j], upper[j], color="#f1f5f8", zorder=0)
            for limit in (lower[j], upper[j]):
                axes.axhline(limit, color=PALE, linewidth=1.0)
            pad = 0.06 * (upper[j] - lower[j])
            axes.set_ylim(min(lower[j], own.min()) - pad, max(upper[j], own.max()) + pad)
            axes.set_yticks([_tick(lower[j]), _tick(upper[j])])
        if half_height is not None and half_height[j] > 0:
            axes.set_ylim(-1.06 * half_height[j], 1.06 * half_height[j])
            axes.set_yticks([-_tick(half_height[j]), 0.0, _tick(half_height[j])])
        if dashed is not None:
            axes.plot(time, dashed[:, j], color=WARM, linewidth=1.2, linestyle=(0, (4, 2)))
        axes.plot(time, own, color=COOL, linewidth=1.6)
        axes.tick_params(labelsize=8)
        axes.set_title(titles[j], fontsize=8, loc="left", color=INK, pad=2)
        axes.spines[["top", "right"]].set_visible(False)
    rows[-1].set_xlabel("time [s]", fontsize=9)
    rows[-1].set_xlim(time[0], time[-1])
    figure.supylabel(label, fontsize=9)
    return figure


def _tick(limit: float) -> float:
    """Limit rounded to a short number."""
    return float(round(limit)) if abs(limit) >= 10 else float(f"{limit:.2g}")
