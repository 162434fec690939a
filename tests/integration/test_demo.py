"""The whole chain as a user runs it: path, plan, pictures, files, playback."""

import json

import numpy as np
import pytest

import jaxik
from jaxik.cli import run

FILES = {
    "energy_map.png", "arm.png", "joints.png", "velocities.png", "tracking.png", "report.txt",
    "trajectory.npz", "trajectory.csv", "trajectory.json",
}  # fmt: skip


def demo(folder, capsys, *words):
    code = run(["demo", "--out", str(folder), *words, "--json"])
    return code, json.loads(capsys.readouterr().out)


def test_demo_leaves_a_played_plan_in_three_forms_with_pictures(tmp_path, capsys):
    folder = tmp_path / "made"
    code, answer = demo(folder, capsys, "--path", "reach")
    assert code == 0
    assert {f.name for f in folder.iterdir()} == FILES
    assert answer["plan"]["status"] == "OK"
    assert answer["played"]["result"] == "SUCCESS"
    assert all((folder / name).stat().st_size > 10_000 for name in FILES if name.endswith(".png"))
    forms = [jaxik.load_trajectory(folder / f"trajectory{ending}") for ending in (".npz", ".csv", ".json")]
    assert forms[0] == forms[1] == forms[2]
    assert len(forms[0]) == answer["plan"]["waypoints"] == 101
    assert np.isfinite(forms[0].swivel).all()
    assert f"{answer['plan']['energy']:.6g}" in (folder / "report.txt").read_text()


def test_demo_ends_with_what_it_made_and_what_to_try_next(tmp_path, capsys):
    folder = tmp_path / "made"
    assert run(["demo", "--out", str(folder), "--path", "reach"]) == 0
    said = capsys.readouterr().out
    closing = said[said.index("files in") :]
    assert all(name in closing for name in FILES)
    assert "try next" in closing
    assert "jaxik view" in closing


@pytest.mark.slow
def test_demo_runs_on_a_published_path(data_dir, tmp_path, capsys):
    code, answer = demo(tmp_path, capsys, "--arm", "iiwa14", "--path", str(data_dir / "paths" / "hello.csv"), "--fit")
    assert code == 0
    assert answer["plan"]["waypoints"] == 553
    assert answer["played"]["result"] == "SUCCESS"
    assert max(v for v in answer["played"]["worst_tracking_rad"].values()) < np.radians(5)


def test_demo_says_why_there_is_no_plan(tmp_path, capsys):
    """A drawing that fits at no scale leaves no trajectory, and the reason is one sentence."""
    path = jaxik.example_path("reach")
    huge = jaxik.Path(jaxik.Pose(80.0 * path.target.position, path.target.rotation), path.time)
    jaxik.save_path(huge, tmp_path / "huge.csv")
    assert run(["demo", "--out", str(tmp_path / "made"), "--path", str(tmp_path / "huge.csv"), "--fit"]) == 1
    assert "jaxik demo: no placement at scales" in capsys.readouterr().err
    assert not list((tmp_path / "made").glob("trajectory*"))


def test_plan_command_names_waypoints_out_of_reach_and_how_to_place_them(tmp_path, capsys):
    out = tmp_path / "x.npz"
    jaxik.save_path(jaxik.example_path("reach"), tmp_path / "reach.csv")
    assert run(["plan", str(tmp_path / "reach.csv"), "--arm", "iiwa14", "--out", str(out)]) == 1
    said = " ".join(capsys.readouterr().out.split())
    assert "no feasible swivel in any branch at waypoint" in said
    assert "the path is where the file has it; --fit moves, turns and scales it into the arm's reach" in said
    assert not out.exists()


def test_a_files_path_stays_where_it_is_and_is_placed_on_request(tmp_path, capsys):
    arm = jaxik.presets.iiwa14().arm
    placed = jaxik.fit_path(arm, jaxik.example_path("reach"))
    moved = jaxik.Path(placed.target, placed.time + 1.7e9)  # as a log has it
    jaxik.save_path(moved, tmp_path / "here.csv")
    words = ["plan", str(tmp_path / "here.csv"), "--arm", "iiwa14", "--gap", "0", "--out", str(tmp_path / "x.npz")]
    assert run([*words, "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["placement"] is None
    motion = jaxik.load_trajectory(tmp_path / "x.npz")
    reached = jaxik.forward_kinematics(arm, motion.q)
    np.testing.assert_allclose(reached.position, placed.target.position, atol=1e-8)
    np.testing.assert_allclose(reached.rotation, placed.target.rotation, atol=1e-8)
    np.testing.assert_allclose(motion.time, placed.time, atol=1e-6)  # what float64 keeps of such stamps
    assert run([*words, "--fit"]) == 0
    assert "the path was scaled by 1.000, turned by" in " ".join(capsys.readouterr().out.split())


def test_plan_command_saves_what_it_reports(tmp_path, capsys):
    out = tmp_path / "x.csv"
    assert run(["plan", "reach", "--arm", "iiwa14", "--out", str(out), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    trajectory = jaxik.load_trajectory(out)
    energy = jaxik.energy.joint_motion()(jaxik.presets.iiwa14().arm, trajectory.q, trajectory.time)
    np.testing.assert_allclose(energy, answer["energy"], rtol=1e-12)
