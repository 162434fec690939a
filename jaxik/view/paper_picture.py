"""The construction of the paper: two spheres, the circle in which they intersect, the elbow on it, and the angles."""

from typing import TYPE_CHECKING

import numpy as np

from jaxik.paper import (
    EXAMPLE,
    Circle,
    elbow_circle,
    forearm_roll,
    interior_wrist_angle,
    shoulder_angles,
)
from jaxik.view.arm_picture import equal_axes
from jaxik.view.figures import COOL, INK, PALE, WARM, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw_construction(swivel: float = EXAMPLE.swivel) -> "Figure":
    """Draw the worked example of the paper with its numbers, corrected where the paper is wrong.

    Args:
        swivel: Swivel, the paper's t [rad]; π in its example.

    Returns:
        The figure: the construction in three dimensions, and its numbers with the equations that give them.

    Raises:
        MissingExtraError: matplotlib is not installed.

    References:
        Eqs. (12)-(86) of the source named in :mod:`jaxik.paper`; docs/errata.md lists the corrections.
    """
    figure = new_figure(10.6, 5.6)
    left, right = figure.subfigures(1, 2, width_ratios=(1.35, 1))  # pyright: ignore[reportGeneralTypeIssues]
    wrist, tip = np.array(EXAMPLE.wrist), np.array(EXAMPLE.tip)
    circle = elbow_circle(wrist, EXAMPLE.upper_arm, EXAMPLE.forearm)
    elbow = circle.point(swivel)
    axes = left.add_subplot(projection="3d")
    for center, radius, color in ((np.zeros(3), EXAMPLE.upper_arm, COOL), (wrist, EXAMPLE.forearm, WARM)):
        _draw_sphere(axes, center, radius, color)
    turn = np.linspace(0, 2 * np.pi, 181)
    ring = np.stack([circle.point(t) for t in turn])
    axes.plot(*ring.T, color=INK, linewidth=1.6, label="intersection of the spheres: possible elbow positions")
    swept = np.stack([circle.point(t) for t in np.linspace(0, swivel, 61)])
    axes.plot(*swept.T, color="#229654", linewidth=3.0, label=f"t from 0 to {np.degrees(swivel):.0f}°")
    zero = circle.point(0.0)
    for end, style in ((zero, ":"), (elbow, "-")):
        axes.plot(*np.stack([circle.center, end]).T, color="#229654", linewidth=1.2, linestyle=style)
    axes.plot(*np.stack([np.zeros(3), wrist]).T, color=PALE, linewidth=1.2, linestyle="--")
    arm = np.stack([np.zeros(3), elbow, wrist, tip])
    axes.plot(*arm.T, color=INK, linewidth=4.0, solid_capstyle="round", zorder=6)
    axes.scatter(*arm[:3].T, s=46, color="white", edgecolors=INK, linewidths=1.8, depthshade=False, zorder=7)
    axes.scatter(*tip, s=40, color=COOL, depthshade=False, zorder=7)
    names = (
        ("shoulder", arm[0], (-0.3, 0.0, 0.3)), ("elbow", elbow, (0.75, 0.0, 0.15)),
        ("wrist", wrist, (-0.1, 0.0, -0.75)), ("tip", tip, (0.5, 0.0, 0.1)),
        ("M", circle.center, (-0.1, 0.0, -0.6)), ("t = 0", zero, (-0.65, 0.0, 0.1)),
    )  # fmt: skip
    for name, point, off in names:
        axes.text(*(point + off), name, fontsize=9, color=INK, ha="center", zorder=8)
    upper, fore = EXAMPLE.upper_arm, EXAMPLE.forearm
    equal_axes(axes, np.array([[-upper] * 3, wrist + fore, wrist - fore, [upper] * 3]))
    axes.set(xlabel="x", ylabel="y", zlabel="z")
    axes.view_init(elev=10, azim=-82)
    axes.legend(loc="upper left", fontsize=8, frameon=False)
    left.suptitle("The paper's construction (its unitless lengths)", fontsize=11, color=INK)
    _write_numbers(right, circle, elbow, swivel)
    return figure


def _draw_sphere(axes, center: np.ndarray, radius: float, color: str) -> None:
    """Draw a transparent sphere: a faint surface and some circles of latitude."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 49), np.linspace(0, np.pi, 25))
    unit = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)])
    x, y, z = center[:, None, None] + radius * unit
    axes.plot_surface(x, y, z, color=color, alpha=0.07, linewidth=0, shade=False)
    axes.plot_wireframe(x, y, z, color=color, alpha=0.14, linewidth=0.5, rstride=4, cstride=8)


def _write_numbers(panel, circle: Circle, elbow: np.ndarray, swivel: float) -> None:
    """Write the numbers as a table of equation, name and value."""
    wrist, tip = np.array(EXAMPLE.wrist), np.array(EXAMPLE.tip)
    from_vertical, azimuth = (np.degrees(a) for a in shoulder_angles(elbow))
    interior = np.degrees(np.arccos(-elbow @ (wrist - elbow) / (EXAMPLE.upper_arm * EXAMPLE.forearm)))
    roll = np.degrees(forearm_roll(elbow, wrist, tip))
    hand = np.degrees(interior_wrist_angle(elbow, wrist, tip))
    rows = (
        ("(12)", "wrist", _vector(wrist)),
        ("(4)-(6)", "tip", _vector(tip)),
        ("(14), (15)", "lengths d1, d2, hand", f"{EXAMPLE.upper_arm:g}, {EXAMPLE.forearm:g}, {EXAMPLE.hand:g}"),
        ("(31)", "β", f"{circle.beta:.3g}"),
        ("(33)", "center M", _vector(circle.center)),
        ("(35)", "radius of the circle", f"{circle.radius:.4g}"),
        ("(37)", "t, the swivel", f"{np.degrees(swivel):.4g}°"),
        ("(38)-(40)", "elbow", _vector(elbow)),
        ("(42)", "shoulder from vertical", f"{from_vertical:.2f}°"),
        ("(44)", "shoulder about vertical", f"{azimuth:.2f}° *"),
        ("(49)", "interior elbow angle", f"{interior:.2f}° *"),
        ("(78)", "roll of the forearm", f"{roll:.2f}° *"),
        ("(86)", "interior wrist angle", f"{hand:.2f}° *"),
    )
    axes = panel.add_subplot()
    axes.axis("off")
    table = axes.table(rows, loc="center", cellLoc="left", colWidths=(0.17, 0.43, 0.40), edges="horizontal")
    table.auto_set_font_size(False)
    table.set_fontsize(8.5)
    table.scale(1, 1.45)
    for cell in table.get_celld().values():
        cell.set_edgecolor(PALE)
        cell.get_text().set_color(INK)
    axes.text(0.0, 0.06, "* differs from the printed number, see docs/errata.md", fontsize=8, color=WARM)


def _vector(values: np.ndarray) -> str:
    return "(" + ", ".join(f"{x:.3g}" for x in values) + ")"
