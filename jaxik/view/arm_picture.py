"""The arm along its path: several postures, the traces of tool and elbow, and the elbow's circle."""

from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np

from jaxik.arm import Arm, ArmModel, as_arm
from jaxik.kinematics import joint_positions
from jaxik.obstacles import World
from jaxik.paths import Path
from jaxik.trajectories import Trajectory
from jaxik.view.figures import COOL, INK, PALE, WARM, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D

_GHOSTS = 7


def draw_arm(
    arm: Arm | ArmModel,
    trajectory: Trajectory,
    path: Path | None = None,
    *,
    at: float | None = None,
    world: World | None = None,
) -> "Figure":
    """Draw an arm at several times of a trajectory.

    Args:
        arm: The arm.
        trajectory: Its motion.
        path: Requested path; None to draw the trace of the tool instead.
        at: Time at which the arm is drawn in full [s]; None for the middle waypoint.
        world: Obstacles; of a moving world those at that time. Half-spaces are not drawn.

    Returns:
        The figure: ``.savefig("arm.png")``.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    bare = as_arm(arm)
    figure = new_figure(7.2, 6.4)
    axes = figure.add_subplot(projection="3d")
    points = np.asarray(joint_positions(bare, jnp.asarray(trajectory.q, bare.axes.dtype)), float)  # (K, 4, 3)
    tool = points[:, 3]
    middle = len(points) // 2 if at is None else int(np.argmin(np.abs(trajectory.time - at)))
    for k in np.linspace(0, len(points) - 1, _GHOSTS).round().astype(int):
        if k != middle:
            axes.plot(*points[k].T, color=PALE, linewidth=2.0, solid_capstyle="round", zorder=1)
    elbow, requested = points[:, 1], tool if path is None else np.asarray(path.target.position, float)
    axes.plot(*requested.T, color=COOL, linewidth=1.8, label="path of the tool", zorder=3)
    axes.plot(*elbow.T, color=WARM, linewidth=1.2, label="path of the elbow", zorder=3)
    circle = _elbow_circle(points[middle])
    axes.plot(*circle.T, color=WARM, linewidth=1.0, linestyle=(0, (4, 3)), label="circle of possible elbow positions")
    links = points[middle]
    axes.plot(*links.T, color=INK, linewidth=5.0, solid_capstyle="round", label=f"arm at {_at(trajectory, middle)}")
    axes.scatter(*links[:3].T, s=90, color="white", edgecolors=INK, linewidths=2.0, depthshade=False, zorder=5)
    axes.scatter(*links[3:].T, s=60, color=COOL, depthshade=False, zorder=5)
    for name, p in zip(("shoulder", "elbow", "wrist", "tool"), links, strict=True):
        side = -0.08 if name == "elbow" else 0.05  # the elbow hangs down: put its name below the links
        x, y, z = p + np.array([0, 0, side * _size(points)])
        axes.text(x, y, z, name, fontsize=8, color=INK, ha="center", zorder=6)
    shown = [points.reshape(-1, 3), circle, requested]
    if world is not None:
        around = world.rows(middle) if world.moving else world
        draw_spheres(axes, around)
        centers = np.asarray(around.centers, float)[np.asarray(around.radii) >= 0.0]
        shown.append(centers[np.linalg.norm(centers - points[0, 0], axis=-1) < float(bare.length)])
    equal_axes(axes, np.concatenate(shown))
    axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    axes.view_init(elev=18, azim=_azimuth(points))
    axes.legend(loc="upper left", fontsize=8, frameon=False)
    name = trajectory.arm_name or "arm"
    axes.set_title(f"{name}: {len(trajectory)} postures in {trajectory.duration:.1f} s", fontsize=11, color=INK)
    return figure


def draw_spheres(axes: "Axes3D", world: World) -> None:
    """Draw the spheres of a world at rest on three axes."""
    around, up = np.linspace(0.0, 2 * np.pi, 25), np.linspace(0.0, np.pi, 13)[:, None]
    unit = np.stack([np.sin(up) * np.cos(around), np.sin(up) * np.sin(around), np.cos(up) + 0 * around])
    for center, radius in zip(np.asarray(world.centers, float), np.asarray(world.radii, float), strict=True):
        if radius >= 0.0:
            x, y, z = center[:, None, None] + radius * unit
            axes.plot_surface(x, y, z, color=WARM, alpha=0.35, linewidth=0, zorder=2)


def _at(trajectory: Trajectory, k: int) -> str:
    return f"{trajectory.time[k] - trajectory.time[0]:.1f} s"


def _size(points: np.ndarray) -> float:
    return float(np.ptp(points.reshape(-1, 3), axis=0).max())


def _elbow_circle(links: np.ndarray) -> np.ndarray:
    """Possible positions of the elbow for the given shoulder and wrist, ``(N, 3)``."""
    shoulder, elbow, wrist = links[:3]
    n = (wrist - shoulder) / np.linalg.norm(wrist - shoulder)
    center = shoulder + n * ((elbow - shoulder) @ n)
    a = elbow - center
    b = np.cross(n, a)
    u = np.linspace(0, 2 * np.pi, 121)[:, None]
    return center + a * np.cos(u) + b * np.sin(u)


def equal_axes(axes, points: np.ndarray) -> None:
    """Set equal scales on three axes that contain the points ``(N, 3)``."""
    low, high = points.min(0), points.max(0)
    span = np.maximum(high - low, 0.25 * (high - low).max())
    middle = (low + high) / 2
    for set_limits, m, s in zip((axes.set_xlim, axes.set_ylim, axes.set_zlim), middle, span, strict=True):
        set_limits(m - 0.55 * s, m + 0.55 * s)
    axes.set_box_aspect(span, zoom=1.08)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(_locator())
        axis.pane.set_facecolor("white")
        axis.pane.set_edgecolor(PALE)
    axes.tick_params(labelsize=8)


def _locator():
    from matplotlib.ticker import MaxNLocator

    return MaxNLocator(4)


def _azimuth(points: np.ndarray) -> float:
    """Azimuth of a view from behind the shoulder and slightly from the side, in which writing is not mirrored [deg]."""
    ahead = points[:, 3].mean(0) - points[0, 0]
    return float(np.degrees(np.arctan2(ahead[1], ahead[0])) + 180 + 35)
