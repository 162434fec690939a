"""Runs the Python blocks of a Markdown file, in one namespace, and compares what they print with what the file says.

A fenced block of ``text`` right after a Python block is what that block prints. As a program it runs one file, with the
settings of a reader who installed the library and changed nothing.
"""

import contextlib
import io
import re
import sys
from pathlib import Path
from typing import NamedTuple

FENCE = re.compile(r"^```(?P<language>\w*)[^\n]*\n(?P<body>.*?)^```[ ]*$", re.MULTILINE | re.DOTALL)


class Block(NamedTuple):
    """A Python block: its source, the line before it, and what it prints according to the file, or None."""

    source: str
    line: int
    printed: str | None


def python_blocks(text: str) -> list[Block]:
    """The Python blocks of a Markdown text, in order."""
    fences = list(FENCE.finditer(text))
    blocks = []
    for fence, following in zip(fences, [*fences, None][1:], strict=True):
        if fence["language"] not in ("python", "py"):
            continue
        adjacent = following is not None and not text[fence.end() : following.start()].strip()
        printed = following["body"] if adjacent and following["language"] == "text" else None
        blocks.append(Block(fence["body"], text[: fence.start()].count("\n") + 1, printed))
    return blocks


def run_blocks(file: Path) -> int:
    """Run every Python block of a file; tracebacks carry the file's own line numbers.

    Returns:
        How many blocks ran.

    Raises:
        AssertionError: Where a block prints something else than the file says.
    """
    namespace: dict = {"__name__": "__main__"}
    blocks = python_blocks(file.read_text(encoding="utf-8"))
    for block in blocks:
        code = compile("\n" * block.line + block.source, str(file), "exec")
        with contextlib.redirect_stdout(io.StringIO()) as output:
            exec(code, namespace)
        if block.printed is not None and output.getvalue().rstrip() != block.printed.rstrip():
            raise AssertionError(
                f"{file.name}:{block.line}: prints\n{output.getvalue()}where the text says\n{block.printed}"
            )
    return len(blocks)


if __name__ == "__main__":
    run_blocks(Path(sys.argv[1]))
