"""Output of the commands: steps with a spinner and their duration, tables, and JSON for programs."""

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from jaxik.cli.compiling import compilations
from jaxik.errors import MissingExtraError

_NOTABLE = 0.1  # s; the smallest programs are not kept in the cache and compiled every time


class Screen:
    """Text output for a person, or a single JSON document for a program.

    Args:
        as_json: Print nothing but one JSON document.

    Raises:
        MissingExtraError: rich is absent; with the pip line.
    """

    def __init__(self, as_json: bool = False) -> None:
        try:
            from rich.console import Console
        except ImportError as error:
            raise MissingExtraError('the command line needs tyro and rich: pip install "jaxik[cli]"') from error
        self.as_json = as_json
        self._console = Console(quiet=as_json, highlight=False)

    def say(self, text: str = "", *, styled: bool = False) -> None:
        """Print a line; with ``styled`` its brackets are rich's marks, else units and file names keep theirs."""
        self._console.print(text, markup=styled)

    def copyable(self, text: str) -> None:
        """Print a line to be copied, such as a command: as it is, without breaks at the width of the screen."""
        self._console.print(text, markup=False, soft_wrap=True)

    def table(self, title: str, columns: tuple[str, ...], rows: list[tuple[str, ...]]) -> None:
        """Print a table; the first column holds text, the others numbers.

        Lines between the columns would cost a table of eight columns a third of a screen's 80.
        """
        from rich.box import SIMPLE_HEAD
        from rich.markup import escape
        from rich.table import Table

        table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=0)
        for i, column in enumerate(columns):
            table.add_column(escape(column), justify="left" if i == 0 else "right", overflow="fold")
        for row in rows:
            table.add_row(*map(escape, row))
        # As a title of the table it would be folded to the table's width.
        self._console.print(title, style="bold", markup=False, soft_wrap=True)
        self._console.print(table)

    @contextmanager
    def step(self, text: str) -> Iterator[Callable[[float], None]]:
        """Show a step while it runs and its duration when it is done; yields a function that sets the fraction done.

        While a program is compiled that the cache does not hold, the step says so.
        """
        from rich.markup import escape
        from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

        began = time.perf_counter()
        bar = Progress(
            SpinnerColumn(),
            TextColumn("{task.description}"),
            BarColumn(bar_width=24),
            TimeElapsedColumn(),
            console=self._console,
            transient=True,
            disable=not self._console.is_terminal,
        )
        with bar:
            task = bar.add_task(escape(text), total=None)
            said = {True: f"{escape(text)}: compiling, for the first time", False: escape(text)}
            with compilations(lambda now: bar.update(task, description=said[now])) as compiled:
                yield lambda fraction: bar.update(task, total=1.0, completed=fraction)
        took = f"{time.perf_counter() - began:.1f} s"
        took += f", {compiled.seconds:.1f} s of it compiling" if compiled.seconds >= _NOTABLE else ""
        self._console.print(f"[green]✓[/green] {escape(text)} [dim]{took}[/dim]")

    def result(self, content: dict[str, Any]) -> None:
        """Print the result as JSON if a program reads it."""
        if self.as_json:
            print(json.dumps(content, allow_nan=False), flush=True)  # also before a command that goes on
