"""Pictures: drawn without a screen, with what they say on them, for every kind of plan."""

import sys
from dataclasses import replace

import numpy as np
import pytest

import jaxik
from jaxik.planning import EnergyMap, Plan
from jaxik.view import draw_arm, draw_energy_map, draw_joints

MODEL = jaxik.presets.meccanoid("right")
TIME_S = np.linspace(0.0, 2.0, 12)
Q = np.outer(np.linspace(0.3, 0.8, 12), np.ones(6))
TRAJECTORY = jaxik.Trajectory(TIME_S, Q, MODEL.joint_names, MODEL.name)
PLAN = Plan(
    TRAJECTORY, np.linspace(3.0, 3.4, 12), np.full(12, 5), 1.5, None, None, jaxik.PlanStatus.OK, energy_unit="rad²/s"
)


def costs():
    cost = np.abs(np.random.default_rng(1).normal(size=(12, 36)))
    cost[3:5, 10:20] = np.nan
    return EnergyMap(TIME_S, np.linspace(-np.pi, np.pi, 36, endpoint=False), cost, "rad²/s per s")


def ink(figure, tmp_path):
    """Share of the picture that is not white."""
    from matplotlib.image import imread

    figure.savefig(tmp_path / "x.png")
    return float((imread(tmp_path / "x.png")[..., :3] < 0.99).any(axis=-1).mean())


def test_the_arm_is_drawn_on_its_path(tmp_path):
    figure = draw_arm(MODEL, TRAJECTORY)
    assert 0.01 < ink(figure, tmp_path) < 0.9
    assert MODEL.name in figure.axes[0].get_title()
    assert figure.axes[0].get_xlabel() == "x [m]"


def test_the_map_breaks_the_swivel_at_the_seam_and_names_its_unit(tmp_path):
    figure = draw_energy_map(costs(), PLAN)
    line = figure.axes[0].get_lines()[0].get_ydata()
    assert np.isnan(line).sum() == 1, "one crossing of ±180°"
    assert np.nanmax(np.abs(line)) <= 180
    assert "rad²/s per s" in figure.axes[1].get_ylabel()
    assert ink(figure, tmp_path) > 0.2


@pytest.mark.parametrize("cost", [np.full((12, 36), np.nan), np.zeros((12, 36)), np.ones((12, 36))])
def test_maps_without_any_contrast_are_still_drawn(cost, tmp_path):
    failed = replace(PLAN, trajectory=None, status=jaxik.PlanStatus.UNREACHABLE)
    assert ink(draw_energy_map(costs()._replace(cost=cost), failed), tmp_path) > 0.01


def test_joints_show_names_ranges_and_speed(tmp_path):
    figure = draw_joints(MODEL, TRAJECTORY)
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert [t.split(":")[0] for t in titles] == list(MODEL.joint_names)
    assert ink(figure, tmp_path) > 0.01


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
