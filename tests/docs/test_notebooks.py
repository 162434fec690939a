"""The notebooks run from top to bottom, agree with their sources, and are committed with their outputs."""

import importlib.util
from pathlib import Path

import nbformat
import pytest

from tests.helpers.compiling import QUICK_COMPILING

NOTEBOOKS = Path(__file__).resolve().parents[2] / "notebooks"


def _build():
    spec = importlib.util.spec_from_file_location("build_notebooks", NOTEBOOKS / "build.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


BUILD = _build()
by_source = pytest.mark.parametrize("source", BUILD.sources(), ids=lambda source: source.stem)


def kept(source):
    return nbformat.read(NOTEBOOKS / f"{source.stem}.ipynb", as_version=4)


@by_source
def test_a_notebook_is_its_source_with_outputs(source):
    made, committed = BUILD.notebook_of(source), kept(source)
    assert [cell.source for cell in committed.cells] == [cell.source for cell in made.cells], (
        f"run: python notebooks/build.py {source.stem.partition('_')[0]}"
    )
    code = [cell for cell in committed.cells if cell.cell_type == "code"]
    assert all(cell.execution_count for cell in code)
    outputs = [output for cell in code for output in cell.outputs]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert not any(output.output_type == "error" or output.get("name") == "stderr" for output in outputs)
    assert (NOTEBOOKS / f"{source.stem}.ipynb").stat().st_size < 400_000


def test_every_notebook_has_a_source_and_a_line_in_the_index():
    index = (NOTEBOOKS / "README.md").read_text(encoding="utf-8")
    assert {file.stem for file in NOTEBOOKS.glob("*.ipynb")} == {source.stem for source in BUILD.sources()}
    assert all(f"]({source.stem}.ipynb)" in index for source in BUILD.sources())


@pytest.mark.slow
@by_source
def test_a_notebook_runs(source, tmp_path, monkeypatch):
    # The kernel of a reader, without the eight devices of the tests.
    monkeypatch.setenv("XLA_FLAGS", QUICK_COMPILING)
    monkeypatch.setenv("PYTHONPATH", str(NOTEBOOKS.parent))
    done = BUILD.execute(BUILD.notebook_of(source), tmp_path)
    assert not any(output.get("name") == "stderr" for cell in done.cells for output in cell.get("outputs", ()))
