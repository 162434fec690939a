"""The program ``jaxik``; its subcommands are the entry points of the group ``jaxik.commands``."""

from jaxik.cli.program import main, run

__all__ = ["main", "run"]
