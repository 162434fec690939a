"""The joints over time: angles, speeds and torques, each within its own limits."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np

from jaxik.arm import Arm, ArmModel
from jaxik.kinematics import gravity_torque, inverse_dynamics
from jaxik.trajectories import Trajectory
from jaxik.view.figures import COOL, INK, PALE, WARM, new_figure

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
    lower, upper = np.degrees(np.asarray(bare.lower)), np.degrees(np.asarray(bare.upper))
    used = np.zeros(len(lower))
    if len(trajectory) > 1:
        used = (np.abs(trajectory.qd) / np.asarray(bare.velocity_limit)).max(0)
    titles = [
        f"{name}: fastest at {100 * share:.0f} % of its speed limit"
        for name, share in zip(trajectory.joint_names, used, strict=True)
    ]
    label = "joint angle [°], shaded: its range"
    return _draw_rows(trajectory.time, np.degrees(trajectory.q), lower, upper, titles, label)


def draw_velocities(arm: Arm | ArmModel, trajectory: Trajectory) -> "Figure":
    """Draws each joint's speed over time with its limits.

    Args:
        arm: The arm.
        trajectory: Its motion, of two waypoints or more; speeds are those of its straight pieces.

    Returns:
        The figure.

    Raises:
        MissingExtraError: matplotlib is absent; with the pip line.
        ValueError: A single waypoint has no speed.
    """
    bare = arm.arm if isinstance(arm, ArmModel) else arm
    if len(trajectory) < 2:
        raise ValueError("a trajectory of one waypoint has no speeds to draw")
    limit = np.degrees(np.asarray(bare.velocity_limit, float))
    speed = np.degrees(trajectory.qd)
    titles = _share_titles(trajectory.joint_names, speed, limit, "°/s")
    middle = (trajectory.time[1:] + trajectory.time[:-1]) / 2
    label = "joint speed [°/s], shaded: within its limit"
    return _draw_rows(middle, speed, -limit, limit, titles, label, room=_room(speed, limit))


def draw_torques(arm: Arm | ArmModel, trajectory: Trajectory) -> "Figure":
    """Draws the torque that each joint's motor has to give over time, gravity's share in it, and its limits.

    Args:
        arm: The arm, with masses.
        trajectory: Its motion, of three waypoints or more. Speeds and accelerations are differences about the inner
            waypoints; rotors, gears and friction are left out.

    Returns:
        The figure.

    Raises:
        MissingExtraError: matplotlib is absent; with the pip line.
        ValueError: Fewer than three waypoints have no accelerations.
    """
    bare = arm.arm if isinstance(arm, ArmModel) else arm
    if len(trajectory) < 3:
        raise ValueError(f"torques need accelerations, and so three waypoints; got {len(trajectory)}")
    time, step = trajectory.time, np.diff(trajectory.time)
    qdd = np.diff(trajectory.qd, axis=0) / ((step[1:] + step[:-1]) / 2)[:, None]
    qd = (trajectory.q[2:] - trajectory.q[:-2]) / (step[1:] + step[:-1])[:, None]
    q, qd, qdd = (jnp.asarray(x, bare.axes.dtype) for x in (trajectory.q[1:-1], qd, qdd))
    torque = np.asarray(inverse_dynamics(bare, q, qd, qdd), float)
    held = np.asarray(gravity_torque(bare, q), float)
    limit = np.asarray(bare.torque_limit, float)
    titles = _share_titles(trajectory.joint_names, torque, limit, "N m")
    label = "motor torque [N m], dashed: against gravity alone, shaded: within its limit"
    return _draw_rows(time[1:-1], torque, -limit, limit, titles, label, dashed=held, room=_room(torque, limit))


def _share_titles(names: Sequence[str], values: np.ndarray, limit: np.ndarray, unit: str) -> list[str]:
    """How much of its limit each joint uses."""
    most = np.abs(values).max(0)
    return [
        f"{name}: at most {m:.3g} {unit}, "
        + (f"{100 * m / x:.0f} % of its limit of ±{x:.3g} {unit}" if np.isfinite(x) else "no limit known")
        for name, m, x in zip(names, most, limit, strict=True)
    ]


def _room(values: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """Half height of each row: the limit itself, but where little of it is used, what shows the curve."""
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
    room: np.ndarray | None = None,
) -> "Figure":
    """One row per joint: its values ``(N, joint)`` within its limits, or within ``room`` about zero."""
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
        if room is not None and room[j] > 0:
            axes.set_ylim(-1.06 * room[j], 1.06 * room[j])
            axes.set_yticks([-_tick(room[j]), 0.0, _tick(room[j])])
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
    """A limit as a short number."""
    return float(round(limit)) if abs(limit) >= 10 else float(f"{limit:.2g}")
