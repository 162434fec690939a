"""The examples in the docstrings of the packages give the shown results."""

import ast
import doctest
import importlib
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
PACKAGES = ("jaxik", "training", "hardware")
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def _modules_with_examples() -> list[str]:
    files = [file for package in PACKAGES for file in sorted((REPOSITORY / package).rglob("*.py"))]
    found = [file for file in files if ">>>" in file.read_text(encoding="utf-8")]
    return [".".join(file.relative_to(REPOSITORY).with_suffix("").parts).removesuffix(".__init__") for file in found]


def _examples(source: str, name: str, namespace: dict) -> list[doctest.DocTest]:
    """Examples of the docstrings in a source; doctest's own search does not see those of compiled functions."""
    tests = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, DOCUMENTED) and (text := ast.get_docstring(node)):
            where = f"{name}.{getattr(node, 'name', '')}".rstrip(".")
            line = 0 if isinstance(node, ast.Module) else node.lineno
            test = doctest.DocTestParser().get_doctest(text, dict(namespace), where, f"{name}.py", line)
            tests += [test] if test.examples else []
    return tests


@pytest.mark.parametrize("name", _modules_with_examples())
def test_examples_of(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    module = importlib.import_module(name)
    assert module.__file__ is not None
    with open(module.__file__, encoding="utf-8") as file:
        tests = _examples(file.read(), name, vars(module))
    assert tests, f"{name} holds >>> outside of docstrings"
    runner = doctest.DocTestRunner(verbose=False)
    report = []
    for test in tests:
        runner.run(test, out=report.append)
    assert runner.failures == 0, "".join(report)


def test_wrong_examples_are_found():
    source = 'def f():\n    """F.\n\n    >>> 1 + 1\n    3\n    """\n'
    (test,) = _examples(source, "m", {})
    assert test.name == "m.f"
    assert doctest.DocTestRunner(verbose=False).run(test, out=lambda _: None).failed == 1


def test_examples_exist():
    assert "jaxik.arm.presets.paper" in _modules_with_examples()
