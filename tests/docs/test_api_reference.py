"""The API reference is what the docstrings say, complete, and every public name of every package says enough."""

import importlib.util
import inspect
import pydoc
import re

import pytest

from tests.docs.test_docstrings import section


def _reference():
    from pathlib import Path

    file = Path(__file__).resolve().parents[2] / "docs" / "api_reference.py"
    spec = importlib.util.spec_from_file_location("api_reference", file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


REFERENCE = _reference()
NAMES = [(module, name) for module in REFERENCE.MODULES for name in REFERENCE.members(module)]


def test_the_pages_are_what_the_docstrings_say():
    made = REFERENCE.pages()
    kept = {file.name: file.read_text(encoding="utf-8") for file in REFERENCE.FOLDER.glob("*.md")}
    stale = sorted(name for name in made.keys() | kept.keys() if made.get(name) != kept.get(name))
    assert not stale, f"run: python docs/api_reference.py (stale: {', '.join(stale)})"


def test_every_public_name_has_its_entry_and_its_line_in_the_index():
    index = (REFERENCE.FOLDER / "README.md").read_text(encoding="utf-8")
    for module, name in NAMES:
        page = (REFERENCE.FOLDER / f"{module}.md").read_text(encoding="utf-8")
        assert f"\n## {name}\n" in page
        assert f"]({module}.md#{name.lower()})" in index
    assert len(NAMES) > 100


@pytest.mark.parametrize(("module", "name"), NAMES, ids=[f"{m}.{n}" for m, n in NAMES])
def test_pydoc_says_what_it_is_with_arguments_and_fields(module, name):
    value = REFERENCE.members(module)[name]
    text = inspect.getdoc(value) or ""
    assert len(text.splitlines()[0]) > 10
    if callable(value):
        assert text.splitlines()[0] in pydoc.plain(pydoc.render_doc(value))
    if inspect.isclass(value):
        described = section(text, "Attributes")
        for field in () if issubclass(value, BaseException) else getattr(value, "__dataclass_fields__", {}):
            assert re.search(rf"^ +(?:\w+, )*{field}(?:, \w+)*:", described, re.MULTILINE), f"{name}.{field}"
    elif callable(value):
        arguments = section(text, "Args")
        for parameter in inspect.signature(value).parameters:
            assert re.search(rf"^ +(?:\w+, )*\*{{0,2}}{parameter}\b", arguments, re.MULTILINE), parameter
