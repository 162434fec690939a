"""`jaxik.training` and `jaxik.hardware` work in projects that have folders of these names."""

import subprocess
import sys

import pytest

ALONE = """
import jaxik, sys
assert not {"training", "hardware", "jaxik.training", "jaxik.hardware"} & sys.modules.keys()
import jaxik.training, jaxik.hardware.boards.simulated
import training, hardware.boards.simulated
from jaxik.hardware import boards
assert jaxik.training is training and jaxik.hardware is hardware and boards is hardware.boards
assert sys.modules["jaxik.hardware.boards.simulated"] is hardware.boards.simulated
assert hardware.boards.simulated.__spec__.name == "hardware.boards.simulated"
"""
FIRST = """
import sys
import jaxik
assert not {"jaxik.training", "jaxik.hardware"} & sys.modules.keys()
assert jaxik.hardware.connect and jaxik.training.load_probe_points
"""
SHADOWED = """
import sys
import training, hardware
assert training.MINE and hardware.MINE
import jaxik.hardware, jaxik.training
from jaxik.hardware import cli, load_joint_map
assert not hasattr(jaxik.hardware, "MINE")
assert load_joint_map("meccanoid.toml")
with jaxik.hardware.connect("simulated") as board:
    assert isinstance(board, jaxik.hardware.SimulatedBoard)
jaxik.training.ElbowPolicy
assert sys.modules["training"] is training and {m for m in sys.modules if m.startswith("training.")} == set()
from jaxik.cli.doctor import shadowed
for finding in shadowed():
    print(finding.value, "|", finding.advice)
import jaxik.hardware.nothing
"""


def check(program, folder, repository):
    return subprocess.run(
        [sys.executable, "-c", program], cwd=folder, capture_output=True, text=True, timeout=120, check=False,
        env={"PYTHONPATH": f"{folder}:{repository}", "JAX_PLATFORMS": "cpu", "PATH": ""},
    )  # fmt: skip


@pytest.mark.parametrize("program", [ALONE, FIRST], ids=["the same modules", "on first access"])
def test_the_names_under_jaxik_are_the_packages(program, tmp_path, repository):
    run = check(program, tmp_path, repository)
    assert run.returncode == 0, run.stderr


@pytest.mark.parametrize("form", ["module", "package"])
def test_folders_of_a_project_are_left_alone(form, tmp_path, repository):
    for name in ("training", "hardware"):
        file = tmp_path / (f"{name}.py" if form == "module" else f"{name}/__init__.py")
        file.parent.mkdir(exist_ok=True)
        file.write_text("MINE = True\n")
    run = check(SHADOWED, tmp_path, repository)
    assert "No module named 'jaxik.hardware.nothing'" in run.stderr, run.stderr
    assert f"`import training` finds {tmp_path}" in run.stdout
    assert "`import jaxik.hardware` finds jaxik's" in run.stdout
