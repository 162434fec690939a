"""Pictures, drawn without a display: content and text for every kind of plan."""

import sys
from dataclasses import replace
from types import SimpleNamespace

import jax
import numpy as np
import pytest

import jaxik
from jaxik.planning import EnergyMap, Plan
from jaxik.view import (
    draw_arcs,
    draw_arm,
    draw_construction,
    draw_energy_map,
    draw_joints,
    draw_learning,
    draw_torques,
    draw_tracking,
    draw_velocities,
)

MODEL = jaxik.presets.meccanoid("right")
TIME = np.linspace(0.0, 2.0, 12)
Q = np.outer(np.linspace(0.3, 0.8, 12), np.ones(6))
TRAJECTORY = jaxik.Trajectory(TIME, Q, MODEL.joint_names, MODEL.name)
PLAN = Plan(
    TRAJECTORY, np.linspace(3.0, 3.4, 12), np.full(12, 5), 1.5, None, None, jaxik.PlanStatus.OK, energy_unit="rad²/s"
)


def costs():
    cost = np.abs(np.random.default_rng(1).normal(size=(12, 36)))
    cost[3:5, 10:20] = np.nan
    return EnergyMap(TIME, np.linspace(-np.pi, np.pi, 36, endpoint=False), cost, "rad²/s per s")


def ink(figure, tmp_path):
    """Share of the picture that is not white."""
    from matplotlib.image import imread

    figure.savefig(tmp_path / "x.png", dpi=50)  # coarse: a picture in full takes half a second
    return float((imread(tmp_path / "x.png")[..., :3] < 0.99).any(axis=-1).mean())


def test_the_arm_is_drawn_on_its_path(tmp_path):
    figure = draw_arm(MODEL, TRAJECTORY)
    assert 0.01 < ink(figure, tmp_path) < 0.9
    assert MODEL.name in figure.axes[0].get_title()
    assert figure.axes[0].get_xlabel() == "x [m]"


def test_the_map_turns_its_axis_to_a_motion_about_the_half_turn_and_names_its_unit(tmp_path):
    figure = draw_energy_map(costs(), PLAN)
    line = figure.axes[0].get_lines()[0].get_ydata()
    np.testing.assert_allclose(line, np.degrees(PLAN.swivel))
    assert figure.axes[0].get_ylim() == (0, 360)
    assert "rad²/s per s" in figure.axes[1].get_ylabel()
    assert ink(figure, tmp_path) > 0.2


def test_the_map_breaks_a_line_that_goes_all_around():
    around = replace(TRAJECTORY, swivel=np.linspace(-2.0, 4.0, 12))
    figure = draw_energy_map(costs(), around)
    line = figure.axes[0].get_lines()[0].get_ydata()
    assert np.isnan(line).sum() == 1
    assert np.nanmax(np.abs(line)) <= 180


def test_the_map_says_what_is_proved():
    proved = replace(PLAN, lower_bound=1.47, gap=0.02)
    title = draw_energy_map(costs(), proved).axes[0].get_title()
    assert "certified lower bound 1.47" in title
    assert "gap at most 2.00 %" in title
    assert "bound" not in draw_energy_map(costs(), PLAN).axes[0].get_title()


def test_the_costs_stay_with_their_swivels_when_the_axis_turns():
    cost = np.tile(np.arange(36.0) + 1, (12, 1))
    straight, turned = (draw_energy_map(costs()._replace(cost=cost), p) for p in (None, PLAN))
    for figure, first in ((straight, 1.0), (turned, 19.0)):  # of the lowest row: swivel -180, and swivel 0
        assert float(figure.axes[0].collections[0].get_array().reshape(36, 12)[0, 0]) == first


def test_simpler_motions_are_drawn_beside_the_plan():
    other = replace(TRAJECTORY, swivel=np.full(12, 2.0))
    figure = draw_energy_map(costs(), PLAN, {"held": other, "greedy": other})
    assert [text.get_text() for text in figure.legends[0].get_texts()][:3] == ["planned swivel", "held", "greedy"]


@pytest.mark.parametrize("cost", [np.full((12, 36), np.nan), np.zeros((12, 36)), np.ones((12, 36))])
def test_maps_without_any_contrast_are_still_drawn(cost, tmp_path):
    failed = replace(PLAN, trajectory=None, status=jaxik.PlanStatus.UNREACHABLE)
    assert ink(draw_energy_map(costs()._replace(cost=cost), failed), tmp_path) > 0.01


def test_joints_show_names_ranges_and_speed(tmp_path):
    figure = draw_joints(MODEL, TRAJECTORY)
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert [t.split(":")[0] for t in titles] == list(MODEL.joint_names)
    assert ink(figure, tmp_path) > 0.01


def test_speeds_and_torques_say_their_share_of_the_limit(tmp_path):
    for draw, unit in ((draw_velocities, "°/s"), (draw_torques, "N m")):
        figure = draw(MODEL, TRAJECTORY)
        titles = [axes.get_title(loc="left") for axes in figure.axes]
        assert all(f" {unit}" in title and "% of its limit" in title for title in titles)
        assert ink(figure, tmp_path) > 0.01
    fastest = np.degrees(np.abs(TRAJECTORY.qd).max())
    assert f"{fastest:.3g} °/s" in draw_velocities(MODEL, TRAJECTORY).axes[0].get_title(loc="left")
    one = jaxik.Trajectory(TIME[:1], Q[:1], MODEL.joint_names)
    with pytest.raises(ValueError, match="one waypoint"):
        draw_velocities(MODEL, one)
    with pytest.raises(ValueError, match="got 1"):
        draw_torques(MODEL, one)


def test_the_construction_shows_the_paper_s_numbers(tmp_path):
    figure = draw_construction()
    numbers = [cell.get_text().get_text() for cell in figure.axes[1].tables[0].get_celld().values()]
    for text in ("(1.5, 1.5, -1.5)", "(2.56, 0.439, -1.5)", "120.00° *", "51.59° *", "9.74° *"):
        assert text in numbers
    assert ink(figure, tmp_path) > 0.05


def test_arcs_are_rings_of_one_target(tmp_path):
    arm = jaxik.presets.paper_arm().arm
    target = jaxik.Pointing(np.array([3.0, 4.0, -3.0]), np.array([0.0, 1.0, 0.0]))
    arcs = jaxik.swivel_arcs(arm, target)
    figure = draw_arcs(arcs, swivel=np.pi, branch=0)
    drawn = [line for line in figure.axes[0].get_lines() if line.get_linewidth() == 6.0]
    assert len(drawn) == int(arcs.valid.sum())
    np.testing.assert_allclose(drawn[0].get_xdata()[[0, -1]], [arcs.start[0, 0], arcs.end[0, 0]])
    assert ink(figure, tmp_path) > 0.01
    with pytest.raises(ValueError, match="one target"):
        draw_arcs(jax.tree.map(lambda x: np.stack([x] * 2), arcs))


def log(measured):
    phase = ("ease in",) * 3 + ("play",) * 9
    return SimpleNamespace(time=TIME, phase=phase, commanded=Q, measured=measured, joint_names=MODEL.joint_names)


def test_tracking_shows_errors_of_what_was_played(tmp_path):
    measured = Q + np.radians(1.5)
    measured[:3] += 1.0
    measured[:, 5] = np.nan
    figure = draw_tracking(log(measured))
    titles = [axes.get_title(loc="left") for axes in figure.axes[1::2]]
    assert titles[0] == "rms 1.50°, max 1.50°"
    assert titles[5] == "no position feedback"
    assert ink(figure, tmp_path) > 0.01
    assert ink(draw_tracking(log(np.full_like(Q, np.nan))), tmp_path) > 0.01
    empty = SimpleNamespace(**{**vars(log(Q)), "time": TIME[:0]})
    with pytest.raises(ValueError, match="nothing was moved"):
        draw_tracking(empty)


def test_learning_curves_are_logarithmic_where_they_span_a_decade(tmp_path):
    long = np.geomspace(100.0, 1.0, 400)
    figure = draw_learning({"train": long}, levels={"simple rule": 20.0}, unit="mm")
    assert figure.axes[0].get_yscale() == "log"
    assert "mm" in figure.axes[0].get_ylabel()
    assert ink(figure, tmp_path) > 0.01
    short = draw_learning({"train": [1.0, np.nan, 0.5]}, steps=[0, 10, 20])
    assert short.axes[0].get_yscale() == "linear"
    with pytest.raises(ValueError, match="at least one curve"):
        draw_learning({})
    with pytest.raises(ValueError, match="steps"):
        draw_learning({"train": [1.0, 2.0]}, steps=[0])


def test_figures_show_themselves_in_notebooks():
    assert draw_arm(MODEL, TRAJECTORY)._repr_png_()[:4] == b"\x89PNG"


def test_pictures_leave_matplotlibs_global_state_alone():
    code = "import sys, jaxik.view; draw = 'matplotlib' in sys.modules; raise SystemExit(draw)"
    import subprocess

    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0, "imported before it is needed"
    draw_joints(MODEL, TRAJECTORY)
    assert "matplotlib.pyplot" not in sys.modules or not __import__("matplotlib.pyplot").pyplot.get_fignums()


def test_without_matplotlib_the_pip_line_is_said(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(jaxik.MissingExtraError, match=r'pip install "jaxik\[plots\]"'):
        draw_joints(MODEL, TRAJECTORY)
