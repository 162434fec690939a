"""Makes the notebooks from notebooks/sources and executes them: python notebooks/build.py [NUMBER ...].

A source is Python with cell marks, ``# %%`` for code and ``# %% [markdown]`` for text in comments. What is committed is
the executed notebook with its outputs; a test executes each once more, and checks that its cells are the source's.
"""

import sys
import time
from pathlib import Path

import nbformat
from nbclient import NotebookClient

FOLDER = Path(__file__).resolve().parent
METADATA = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}


def sources() -> list[Path]:
    """All sources in order."""
    return sorted((FOLDER / "sources").glob("*.py"))


def notebook_of(source: Path) -> nbformat.NotebookNode:
    """A source as a notebook without outputs."""
    cells = []
    for part in source.read_text(encoding="utf-8").split("# %%")[1:]:
        head, _, body = part.partition("\n")
        number = f"cell-{len(cells)}"
        if head.strip() == "[markdown]":
            text = "\n".join(line.removeprefix("#").removeprefix(" ") for line in body.strip().splitlines())
            cells.append(nbformat.v4.new_markdown_cell(text, id=number))
        else:
            cells.append(nbformat.v4.new_code_cell(body.strip(), id=number))
    return nbformat.v4.new_notebook(cells=cells, metadata=METADATA)


def execute(notebook: nbformat.NotebookNode, folder: Path, timeout_s: int = 180) -> nbformat.NotebookNode:
    """Runs a notebook from top to bottom in a folder; raises at the first error."""
    client = NotebookClient(
        notebook, timeout=timeout_s, resources={"metadata": {"path": str(folder)}}, record_timing=False
    )
    done = client.execute()
    done.metadata = METADATA  # nothing of the machine it ran on
    return done


def main(numbers: list[str]) -> None:
    """Makes and executes the notebooks whose numbers are given, or all."""
    for source in sources():
        if numbers and source.stem.partition("_")[0] not in numbers:
            continue
        began = time.perf_counter()
        done = execute(notebook_of(source), FOLDER)
        file = FOLDER / f"{source.stem}.ipynb"
        file.with_suffix(".tmp").write_text(nbformat.writes(done) + "\n", encoding="utf-8")
        file.with_suffix(".tmp").replace(file)
        print(f"{file.name}: {time.perf_counter() - began:.1f} s, {file.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main(sys.argv[1:])
