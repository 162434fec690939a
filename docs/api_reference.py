"""Write the API reference in docs/api from the docstrings: python docs/api_reference.py.

Signatures are copied from the source, because ``inspect`` expands the type annotations of compiled functions.
"""

import ast
import dataclasses
import enum
import importlib
import inspect
import re
import sys
import textwrap
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType

FOLDER = Path(__file__).with_name("api")
MODULES = (
    "jaxik", "jaxik.energy", "jaxik.presets", "jaxik.paper", "jaxik.view", "jaxik.view.browser", "hardware", "training",
)  # fmt: skip
HEAD = "<!-- Written by docs/api_reference.py from the docstrings: change those, then run it. -->\n\n"
SECTIONS = ("Args", "Attributes", "Returns", "Yields", "Raises", "References", "Example", "Examples")


def pages() -> dict[str, str]:
    """Return every page of the reference by file name."""
    shown = {name: members(name) for name in MODULES}
    index = "\n\n".join(
        f"## [{name}]({name}.md)\n\n{_prose(_docstring(_module(name)))}\n\n"
        + "\n".join(f"- [`{member}`]({name}.md#{member.lower()}): {summary(value)}" for member, value in found.items())
        for name, found in shown.items()
        if found
    )
    made = {"README.md": f"{HEAD}# API reference\n\nEvery public name, by package.\n\n{index}\n"}
    for name, found in shown.items():
        if found:
            parts = "\n".join(_entry(member, value) for member, value in found.items())
            made[f"{name}.md"] = f"{HEAD}# {name}\n\n{_prose(_docstring(_module(name)))}\n\n{parts}"
    return made


def members(module: str) -> dict[str, object]:
    """Return the public names of a module that are not modules themselves."""
    loaded = _module(module)
    found = {name: getattr(loaded, name) for name in getattr(loaded, "__all__", ())}
    return {name: value for name, value in found.items() if not inspect.ismodule(value)}


def summary(value: object) -> str:
    """Return the first paragraph of a docstring."""
    return _roles(_docstring(value).split("\n\n")[0].replace("\n", " "))


def _module(name: str) -> ModuleType:
    """Module of a public name; ``jaxik.presets`` lives in one of the rooms."""
    parent, _, child = name.rpartition(".")
    found = getattr(importlib.import_module(parent), child, None) if parent else None
    return found if inspect.ismodule(found) else importlib.import_module(name)


def _entry(name: str, value: object) -> str:
    """Section of a function, class or constant."""
    lines = [f"## {name}", ""]
    if inspect.isclass(value) or callable(value):
        lines += ["```text", _signature(name, value), "```", ""]
    lines += [_prose(_docstring(value)), ""]
    if inspect.isclass(value) and issubclass(value, enum.Enum):
        lines += [*(f"- `{member.name}` = `{member.value!r}`" for member in value), ""]
    if inspect.isclass(value):
        for method, found in _methods(value):
            lines += [
                f"### {name}.{method}",
                "",
                "```text",
                _signature(method, found),
                "```",
                "",
                _prose(_docstring(found)),
                "",
            ]
    return "\n".join(lines)


def _methods(cls: type) -> Iterator[tuple[str, object]]:
    """Public methods and properties that are documented by the class or by a base class of the project."""
    for name, value in inspect.getmembers(cls):
        plain = getattr(cls, name, value)
        if name.startswith("_") or not (inspect.isroutine(plain) or isinstance(plain, property)):
            continue
        module = getattr(inspect.unwrap(plain.fget if isinstance(plain, property) else plain), "__module__", None) or ""
        if module.split(".")[0] in {m.split(".")[0] for m in MODULES} and _docstring(plain):
            yield name, plain


def _signature(name: str, value: object) -> str:
    """Signature, with one argument per line if it is long."""
    if isinstance(value, property):
        returns = _function(value.fget)
        return f"{name}: {ast.unparse(returns.returns)}" if returns and returns.returns else name
    if inspect.isclass(value):
        if issubclass(value, BaseException | enum.Enum) or getattr(value, "_is_protocol", False):
            return f"class {name}({', '.join(base.__name__ for base in value.__bases__)})"
        if dataclasses.is_dataclass(value):
            shown = [f.name for f in dataclasses.fields(value) if f.init and f.repr]
            return _wrapped(f"class {name}(", shown, ")")
        made = _function(value.__init__)
        return _wrapped(f"class {name}(", _arguments(made)[1:] if made else [], ")")
    function = _function(value)
    if function is None:
        return f"{name}{inspect.signature(value)}"  # pyright: ignore[reportArgumentType]
    given = _arguments(function)
    given = given[1:] if given[:1] in (["self"], ["cls"]) else given
    return _wrapped(f"{name}(", given, f") -> {ast.unparse(function.returns)}" if function.returns else ")")


def _arguments(function: ast.FunctionDef) -> list[str]:
    """Arguments as written, with annotations and defaults."""
    text = ast.unparse(function.args)
    parts, depth, start = [], 0, 0
    for i, letter in enumerate(text):
        depth += (letter in "([{") - (letter in ")]}")
        if letter == "," and depth == 0:
            parts.append(text[start:i].strip())
            start = i + 1
    return [*parts, text[start:].strip()] if text else []


def _wrapped(head: str, arguments: list[str], tail: str) -> str:
    line = head + ", ".join(arguments) + tail
    return line if len(line) <= 100 else head + "\n" + "".join(f"    {a},\n" for a in arguments) + tail


def _function(value: object) -> ast.FunctionDef | None:
    """Syntax tree of a function, found by its name and line."""
    plain = inspect.unwrap(value)  # pyright: ignore[reportArgumentType]
    code = getattr(plain, "__code__", None)
    if code is None:
        return None
    for node in ast.walk(_tree(code.co_filename)):
        lines = isinstance(node, ast.FunctionDef) and range(
            min([node.lineno, *(d.lineno for d in node.decorator_list)]), node.lineno + 1
        )
        if lines and node.name == plain.__name__ and code.co_firstlineno in lines:  # pyright: ignore
            return node  # pyright: ignore[reportReturnType]
    return None


@cache
def _tree(file: str) -> ast.Module:
    return ast.parse(Path(file).read_text(encoding="utf-8")) if Path(file).exists() else ast.Module([], [])


def _docstring(value: object) -> str:
    return inspect.getdoc(value) or ""


def _prose(text: str) -> str:
    """Convert a Google docstring to Markdown: sections in bold, their entries as lists, doctests fenced."""
    out, section, lines = [], None, text.splitlines()
    for i, line in enumerate(lines):
        head = line.removesuffix(":")
        if line.endswith(":") and head in SECTIONS and i + 1 < len(lines) and lines[i + 1].startswith(" "):
            section = head
            out += ["", f"**{head}**", ""]
        elif section and line.startswith("    "):
            body = line[4:]
            entry = re.match(r"(\*{0,2}[\w.]+(?:, \w+)*(?: \(.*?\))?):(?: |$)", body)
            if section in ("Args", "Attributes", "Raises") and entry:
                out.append(f"- `{entry[1]}`: {body[entry.end() :]}")
            elif section in ("Example", "Examples"):
                out.append(body)
            else:
                out.append(("  " if section in ("Args", "Attributes", "Raises") else "") + body.strip())
        else:
            section = None if line.strip() else section
            out.append(line)
    text = re.sub(r"\n{3,}", "\n\n", "\n".join(out))
    return _fenced(_roles(text)).strip()


def _fenced(text: str) -> str:
    """Fence doctests, and indented blocks after a double colon."""
    text = re.sub(
        r"(?:^>>> .*\n?(?:^(?!\s*$|>>> |\*\*).*\n?)*)+", lambda m: f"```pycon\n{m[0].rstrip()}\n```\n", text, flags=re.M
    )
    return re.sub(r"::\n\n((?:    .*\n?|\n)+)", lambda m: f":\n\n```text\n{textwrap.dedent(m[1]).strip()}\n```\n", text)


def _roles(text: str) -> str:
    """Convert Sphinx roles to code spans."""
    text = re.sub(r":\w+:`~?\.?([^`]+)`", r"`\1`", text)
    return re.sub(r"``([^`]+)``", r"`\1`", text)


def main() -> None:
    """Write the pages and remove obsolete ones."""
    FOLDER.mkdir(exist_ok=True)
    made = pages()
    for old in set(FOLDER.glob("*.md")) - {FOLDER / name for name in made}:
        old.unlink()
    for name, text in made.items():
        (FOLDER / name).write_text(text, encoding="utf-8")
    print(f"{len(made)} pages in {FOLDER.name}/")


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    main()
