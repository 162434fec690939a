"""Generate the notebooks from notebooks/sources and execute them: python notebooks/build.py [NUMBER ...].

A source is Python with cell markers, ``# %%`` for code and ``# %% [markdown]`` for text in comments. The executed
notebooks are committed with their outputs; a test executes each again, and compares its cells with the source.
"""

import sys
import time
from pathlib import Path

import nbformat
from nbclient import NotebookClient

FOLDER = Path(__file__).resolve().parent
METADATA = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}


def sources() -> list[Path]:
    """Return all sources in order."""
    return sorted((FOLDER / "sources").glob("*.py"))


def notebook_of(source: Path) -> nbformat.NotebookNode:
    """Return a source as a notebook without outputs."""
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


def execute(notebook: nbformat.NotebookNode, folder: Path, timeout: int = 180) -> nbformat.NotebookNode:
    """Run a notebook from top to bottom in a folder; raise the first error."""
    client = NotebookClient(
        notebook, timeout=timeout, resources={"metadata": {"path": str(folder)}}, record_timing=False
    )
    done = client.execute()
    done.metadata = METADATA  # without information on the machine
    return done


def main(numbers: list[str]) -> None:
    """Generate and execute the notebooks with the given numbers, or all."""
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
