"""Rooms import each other through their facades and only as the table in docs/architecture.md allows."""

import ast
import re
from collections.abc import Iterator

import pytest

PACKAGES = ("jaxik", "training", "hardware")


def table(text: str) -> dict[str, set[str]]:
    """Rooms with those that they may import, in the order of the table."""
    rows = re.findall(r"^\| `(\w+)` \|.*\| *((?:`\w+` ?)*) *\|$", text, re.MULTILINE)
    return {room: set(re.findall(r"\w+", imports)) for room, imports in rows}


def imports(source: str, rooms: set[str]) -> Iterator[tuple[int, str, str]]:
    """Line, module and name of every import from jaxik; ``from jaxik import energy`` imports the room energy."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name, "") for alias in node.names if alias.name.startswith("jaxik."))
        elif isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "jaxik":
            for alias in node.names:
                room = node.module == "jaxik" and alias.name in rooms
                yield node.lineno, f"jaxik.{alias.name}" if room else str(node.module), "" if room else alias.name


def room_of(module: str) -> str:
    """Room of a module of jaxik; empty for jaxik itself."""
    return [*module.split("."), ""][1]


@pytest.fixture(scope="module")
def rooms(repository):
    found = table((repository / "docs" / "architecture.md").read_text(encoding="utf-8"))
    here = {path.stem for path in (repository / "jaxik").iterdir() if path.suffix == ".py" or path.is_dir()}
    assert found.keys() == {name for name in here if not name.startswith("_")}
    return found


@pytest.fixture(scope="module")
def public(repository):
    """Names that each facade of jaxik offers; root modules have none and offer all."""
    names = {}
    for file in (repository / "jaxik").rglob("__init__.py"):
        module = ".".join(file.parent.relative_to(repository).parts)
        for node in ast.parse(file.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
                names[module] = set(ast.literal_eval(node.value))
    return names


@pytest.fixture(scope="module")
def every_import(repository, rooms):
    """File, room (or package), line, imported module and name."""
    return [
        (
            file.relative_to(repository).as_posix(),
            room_of(module) if package == "jaxik" else f"package {package}",
            *found,
        )
        for package in PACKAGES
        for file in sorted((repository / package).rglob("*.py"))
        for module in [".".join(file.relative_to(repository).with_suffix("").parts)]
        for found in imports(file.read_text(encoding="utf-8"), set(rooms))
    ]


def test_the_table_has_no_circle_and_no_unknown_room(rooms):
    order = list(rooms)
    assert not [(room, other) for room in order for other in rooms[room] if other not in order[: order.index(room)]]


def test_rooms_import_what_the_table_says_and_nothing_else(rooms, every_import):
    used = {room: set() for room in rooms}
    wrong = []
    for file, room, line, module, _ in every_import:
        other = room_of(module)
        if room not in rooms or other == room:  # the root facade and the packages beside jaxik may import every room
            continue
        used[room].add(other)
        if other not in rooms[room]:
            wrong.append(f"{file}:{line}: {room} imports {other or 'jaxik itself'}")
    unused = [f"{room} does not import {other}" for room in rooms for other in sorted(rooms[room] - used[room])]
    assert not wrong + unused, "docs/architecture.md says otherwise:\n" + "\n".join(wrong + unused)


def test_rooms_are_entered_through_their_facades(repository, rooms, public, every_import):
    wrong = []
    for file, room, line, module, name in every_import:
        inside = room_of(module) == room
        if inside or (module in public and (not name or name in public[module])):
            continue
        if not (repository / "jaxik" / f"{room_of(module)}.py").exists():  # errors and the like have no facade
            wrong.append(f"{file}:{line}: {module}{'.' if name else ''}{name}")
    assert not wrong, "not in the facade of the room:\n" + "\n".join(wrong)


def test_files_of_a_room_import_each_other_not_their_facade(repository, rooms, every_import):
    files = {room: {path.stem for path in (repository / "jaxik").glob(f"{room}/*")} for room in rooms}
    wrong = [
        f"{file}:{line}: {module}.{name}"
        for file, room, line, module, name in every_import
        if room in rooms and module == f"jaxik.{room}" and name not in files[room]
    ]
    assert not wrong, "import the sibling file instead:\n" + "\n".join(wrong)


def test_every_form_of_import_is_seen():
    source = """
import jaxik
import jaxik.arm.urdf
from jaxik import energy as energies, plan
def f():
    from jaxik.planning.fast import a
"""
    assert list(imports(source, {"energy"})) == [
        (3, "jaxik.arm.urdf", ""),
        (4, "jaxik.energy", ""),
        (4, "jaxik", "plan"),
        (6, "jaxik.planning.fast", "a"),
    ]


def test_the_table_is_read():
    text = "| room | holds | imports |\n|---|---|---|\n| `a` | x | |\n| `b` | `x` | `a` |\n| `c` | x | `a` `b` |\n"
    assert table(text) == {"a": set(), "b": {"a"}, "c": {"a", "b"}}
