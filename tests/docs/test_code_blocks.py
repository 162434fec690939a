"""The Python blocks of README.md and docs/ run and print what the text shows, in tests and for a reader."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.helpers.compiling import QUICK_COMPILING
from tests.helpers.markdown import python_blocks, run_blocks

REPOSITORY = Path(__file__).resolve().parents[2]
TEXTS = [*sorted(REPOSITORY.glob("*.md")), *sorted((REPOSITORY / "docs").rglob("*.md"))]
FILES = [file for file in TEXTS if python_blocks(file.read_text(encoding="utf-8"))]


def name_of(file):
    return file.relative_to(REPOSITORY).as_posix()


# Two processes that share a compilation cache may collide in one entry; the second one then compiles.
CACHE_RACE = [word for act in ("reading", "writing") for word in ("-W", f"ignore:Error {act} persistent compilation")]

by_name = pytest.mark.parametrize("file", FILES, ids=name_of)


# The first texts of a reader, under the settings of all other tests.
@pytest.mark.slow
@pytest.mark.parametrize("name", ["README.md", "docs/concepts.md", "docs/choosing.md"])
def test_blocks_run_in_float64_with_strict_promotion(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    assert run_blocks(REPOSITORY / name) > 0


@pytest.mark.slow
@by_name
def test_blocks_run_for_a_reader_who_set_nothing(file, tmp_path):
    # Without JAX settings, except for the compilation cache and, beyond the first page, quicker compiling.
    kept = ("JAX_COMPILATION_CACHE_DIR", "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS")
    environment = {n: value for n, value in os.environ.items() if n in kept or not n.startswith(("JAX_", "XLA_"))}
    if file != REPOSITORY / "README.md":
        environment["XLA_FLAGS"] = QUICK_COMPILING
    run = subprocess.run(
        [sys.executable, "-W", "error", *CACHE_RACE, REPOSITORY / "tests" / "helpers" / "markdown.py", file],
        cwd=tmp_path,
        env=environment | {"PYTHONPATH": str(REPOSITORY), "MPLBACKEND": "Agg", "JAX_PLATFORMS": "cpu"},
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr


@pytest.mark.parametrize("file", TEXTS, ids=name_of)
def test_links_within_the_project_lead_somewhere(file):
    for link in re.findall(r"\]\((?!https?:)([^)#]+)", file.read_text(encoding="utf-8")):
        assert (file.parent / link).exists(), link


def test_readme_shows_code():
    assert REPOSITORY / "README.md" in FILES


TEXT = """Intro
```python
x = 1
print(x)
```

```text
1
```
```sh
false
```
```python
print(x + 1)
```
"""


def test_blocks_share_names_and_say_what_they_print(tmp_path):
    first, second = python_blocks(TEXT)
    assert (first.printed, first.line, second.printed, second.line) == ("1\n", 2, None, 13)
    file = tmp_path / "good.md"
    file.write_text(TEXT)
    assert run_blocks(file) == 2


def test_another_output_or_an_error_is_found(tmp_path):
    file = tmp_path / "bad.md"
    file.write_text(TEXT.replace("\n1\n", "\n2\n"))
    with pytest.raises(AssertionError, match=r"bad\.md:2"):
        run_blocks(file)
    file.write_text(TEXT.replace("x + 1", "y"))
    with pytest.raises(NameError) as caught:
        run_blocks(file)
    assert caught.traceback[-1].lineno == 13  # counted from 0: the second block's only line
