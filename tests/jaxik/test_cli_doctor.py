"""`jaxik doctor`, `convert` and `completion`, and tables of 80 columns."""

import itertools
import json
import os
import shutil
import subprocess
import sys
from importlib.metadata import entry_points

import jax
import numpy as np
import pytest
import yaml
from rosbags.rosbag2 import Reader

import jaxik
from jaxik.cli import run
from jaxik.cli.completion import completion_script
from jaxik.cli.console import Screen
from jaxik.cli.doctor import optional_packages


def test_doctor_has_a_line_per_thing(capsys, monkeypatch):
    assert run(["doctor", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    found = {line["name"]: line for line in report["findings"]}
    assert report["ok"]
    assert found["jax"]["value"] == jax.__version__
    assert "cpu" in found["devices"]["value"]
    assert {"python", "compilation cache", "serial ports", "extra ros", "training", "hardware"} <= found.keys()
    monkeypatch.setenv("COLUMNS", "80")
    assert run(["doctor"]) == 0
    text = capsys.readouterr().out
    assert len(text.splitlines()) >= len(report["findings"])
    assert text.rstrip().endswith("in order")


def test_doctor_names_the_line_that_installs_a_missing_extra(capsys, monkeypatch):
    monkeypatch.setattr("jaxik.cli.doctor._version", lambda name: None if name == "viser" else "1")
    assert run(["doctor"]) == 0
    assert 'pip install "jaxik[view]"' in capsys.readouterr().out
    monkeypatch.setattr("jaxik.cli.doctor._version", lambda name: None if name == "optax" else "1")
    assert run(["doctor"]) == 1
    assert "not in order: optax" in capsys.readouterr().out


def test_extras_are_read_from_the_metadata():
    found = optional_packages(
        [
            "jax>=0.10",
            "viser>=1.0; extra == 'view'",
            'jaxik[plots]; extra == "view"',
            "matplotlib>=3.9; extra == 'plots'",
            "trimesh[easy]>=4.4 ; python_version > '3' and extra == 'urdf'",
            "jaxik[plots,view]; extra == 'all'",
            "pytest; extra == 'test'",
        ]
    )
    assert found == {"plots": ["matplotlib"], "urdf": ["trimesh"], "view": ["viser", "matplotlib"]}


MOTION = jaxik.Trajectory(np.array([0.0, 0.5, 1.25]), np.array([[0.0], [1e-5], [-2.0]]), ("elbow",))


def test_convert_writes_what_ros_reads_and_back(tmp_path, capsys):
    MOTION.save(tmp_path / "x.npz")
    names = [tmp_path / name for name in ("x.npz", "x.yaml", "x.mcap", "y.csv")]
    for file, out in itertools.pairwise(names):
        assert run(["convert", str(file), str(out), "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["waypoints"] == 3
    assert jaxik.load_trajectory(names[-1]) == MOTION
    with Reader(tmp_path / "x.mcap") as bag:
        assert bag.message_count == 4


def test_convert_prints_a_goal_on_one_line(tmp_path, capsys):
    MOTION.save(tmp_path / "x.csv")
    assert run(["convert", str(tmp_path / "x.csv"), "--goal"]) == 0
    text = capsys.readouterr().out
    assert jaxik.trajectory_from_message(yaml.safe_load(text)) == MOTION
    assert text.count("\n") == 1
    assert run(["convert", str(tmp_path / "x.csv"), "--goal", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["goal"] == text.rstrip("\n")


def test_convert_takes_the_columns_of_other_programs(tmp_path, capsys):
    (tmp_path / "a.csv").write_text("stamp,px,py,pz,dx,dy,dz,force\n5,1,2,3,0,0,1,9\n6,2,2,3,0,0,1,9\n")
    words = ["convert", str(tmp_path / "a.csv"), str(tmp_path / "b.csv")]
    assert run([*words, "--columns", "time=stamp,x=px,y=py,z=pz"]) == 0
    assert "path of 2 waypoints" in " ".join(capsys.readouterr().out.split())
    assert jaxik.load_path(tmp_path / "b.csv").time.tolist() == [0, 1]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["a.npz"], "name a file to write after the one to read, or give --goal"),
        (["a.csv", "b.csv"], r"(for a path give --path)"),
        (["a.csv", "b.csv", "--columns", "x"], "expected columns such as time=stamp,x=tool_x; got 'x'"),
        (["a.npz", "b.txt"], "expected a file name ending in .npz"),
    ],
)
def test_what_convert_cannot_do_is_one_sentence(tmp_path, words, said, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.csv").write_text("x,y\n1,2\n")
    MOTION.save("a.npz")
    assert run(["convert", *words]) == 1
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def completions(script, words):
    """The words that bash offers after others."""
    program = f'{script}\nCOMP_WORDS=({" ".join(words)} ""); COMP_CWORD={len(words)}; COMPREPLY=()\n'
    program += '$(complete -p jaxik | sed "s/.*-F \\([^ ]*\\).*/\\1/"); printf "%s\\n" "${COMPREPLY[@]}"\n'
    path = f"{os.path.dirname(sys.executable)}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-c", program], capture_output=True, text=True, env=os.environ | {"PATH": path}, timeout=60, check=True
    )
    return set(done.stdout.split())


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
def test_bash_completes_commands_and_options(tmp_path, capsys):
    assert run(["completion", "bash", "--out", str(tmp_path / "deep" / "jaxik")]) == 0
    script = (tmp_path / "deep" / "jaxik").read_text()
    subprocess.run(["bash", "-n", str(tmp_path / "deep" / "jaxik")], check=True, timeout=30)
    names = {point.name.partition("-")[0] for point in entry_points(group="jaxik.commands")}
    assert {name.partition(" ")[0] for name in completions(script, ["jaxik"])} >= names
    assert {"--arm", "--energy", "--columns"} <= completions(script, ["jaxik", "plan"])
    assert "saved" in capsys.readouterr().out


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_have_a_script(shell, capsys):
    assert run(["completion", shell]) == 0
    assert capsys.readouterr().out == completion_script(shell)
    assert "jaxik" in completion_script(shell)


def test_tables_of_seven_joints_fit_80_columns(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    angles = ("-170.5",) * 7
    Screen().table("t", ("branch", "status", *(f"q{i}" for i in range(7)), "error\n[m]"),
                   [("7 111", "NEAR_SINGULAR", *angles, "1e-16")])  # fmt: skip
    row = capsys.readouterr().out.splitlines()[-2]
    assert row.split() == ["7", "111", "NEAR_SINGULAR", *angles, "1e-16"]
    assert len(row.rstrip()) <= 80


def test_every_command_has_json_and_arms_have_base_and_tip():
    for point in entry_points(group="jaxik.commands"):
        options = point.load().__annotations__
        assert "json" in options or point.name == "calibrate-servos", point.name  # a dialogue
        if "arm" in options and point.name != "play":  # which shows an arm only
            assert {"base", "tip"} <= options.keys(), point.name
