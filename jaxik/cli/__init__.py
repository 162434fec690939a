"""The program ``jaxik``; its subcommands are the entry points of the group ``jaxik.commands``."""

from jaxik.cli.console import Screen
from jaxik.cli.inputs import ARMS, ENERGIES, InputError, find_arm, find_path
from jaxik.cli.program import main, run

__all__ = ["ARMS", "ENERGIES", "InputError", "Screen", "find_arm", "find_path", "main", "run"]
