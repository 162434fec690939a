"""What every command shows: steps with a spinner and their time, tables, and plain JSON for programs."""

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from jaxik.errors import MissingExtraError

try:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
    from rich.table import Table
except ImportError as error:
    raise MissingExtraError('the command line needs tyro and rich: pip install "jaxik[cli]"') from error


class Screen:
    """A person's terminal, or silence where a program reads JSON.

    Args:
        as_json: Whether a program reads: then nothing but one JSON document is printed.
    """

    def __init__(self, as_json: bool = False) -> None:
        self.as_json = as_json
        self._console = Console(quiet=as_json, highlight=False)

    def say(self, text: str = "") -> None:
        """A line."""
        self._console.print(text)

    def table(self, title: str, columns: tuple[str, ...], rows: list[tuple[str, ...]]) -> None:
        """A table; the first column is text, the others are numbers."""
        table = Table(title=title, title_justify="left", title_style="bold")
        for i, column in enumerate(columns):
            table.add_column(column, justify="left" if i == 0 else "right", overflow="fold")
        for row in rows:
            table.add_row(*row)
        self._console.print(table)

    @contextmanager
    def step(self, text: str) -> Iterator[Callable[[float], None]]:
        """A step of work, shown while it runs and with its time when done; yields a function for the share done."""
        began = time.perf_counter()
        bar = Progress(
            SpinnerColumn(),
            TextColumn("{task.description}"),
            BarColumn(bar_width=24),
            TimeElapsedColumn(),
            console=self._console,
            transient=True,
            disable=not self._console.is_terminal,  # a file needs no moving picture
        )
        with bar:
            task = bar.add_task(text, total=None)
            yield lambda share: bar.update(task, total=1.0, completed=share)
        self._console.print(f"[green]✓[/green] {text} [dim]{time.perf_counter() - began:.1f} s[/dim]")

    def result(self, content: dict[str, Any]) -> None:
        """The answer for a program; nothing for a person."""
        if self.as_json:
            print(json.dumps(content, allow_nan=False))
