"""Packages import each other in one direction: hardware -> jaxik and training -> jaxik."""

import ast

import pytest

PACKAGES = {"jaxik", "training", "hardware"}
ALLOWED = {"jaxik": {"jaxik"}, "training": {"training", "jaxik"}, "hardware": {"hardware", "jaxik"}}


def imported_packages(source: str) -> dict[str, int]:
    """Return the top-level names that a source imports, each with the first line that does."""
    found = {}
    for module, line in imported_modules(source):
        found.setdefault(module.split(".")[0], line)
    return found


def imported_modules(source: str) -> list[tuple[str, int]]:
    """Return every module that a source imports, at module level or inside functions, with its line."""
    found = []
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.Import(names=names):
                modules = [alias.name for alias in names]
            case ast.ImportFrom(module=str(module), level=0, names=names):
                modules = [f"{module}.{alias.name}" for alias in names]
            case ast.Call(
                func=ast.Attribute(attr="import_module") | ast.Name(id="import_module" | "__import__"),
                args=[ast.Constant(value=str(module)), *_],
            ):
                modules = [module]
            case _:
                modules = []
        found += [(module, node.lineno) for module in modules]
    return found


@pytest.mark.parametrize("package", sorted(PACKAGES))
def test_imports_run_one_way(package, repository):
    files = sorted((repository / package).rglob("*.py"))
    assert files
    wrong = [
        f"{file.relative_to(repository)}:{line} imports {name}"
        for file in files
        for name, line in imported_packages(file.read_text(encoding="utf-8")).items()
        if name in (PACKAGES | {"tests", "benchmarks"}) - ALLOWED[package]
    ]
    assert not wrong


def test_only_the_simulated_board_imports_the_simulator(repository):
    """A real board runs the host's executor; the model of a board is for the simulated one."""
    importers = {
        str(file.relative_to(repository / "hardware"))
        for file in (repository / "hardware").rglob("*.py")
        for module, _ in imported_modules(file.read_text(encoding="utf-8"))
        if f"{module}.".startswith("hardware.simulation.") and file.parent.name != "simulation"
    }
    assert importers == {"boards/simulated.py"}


def test_every_form_of_import_is_seen():
    source = """
import hardware.player
def f():
    from training import train
    importlib.import_module("jaxik.ik")
    from . import sibling
"""
    assert imported_packages(source) == {"hardware": 2, "training": 4, "jaxik": 5}
