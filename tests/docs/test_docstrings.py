"""Public names are documented, with arguments, returned values, fields, methods and properties.

Public are the names in ``__all__`` of the packages and modules that docs/api_reference.py documents, and the public
methods, properties and fields of the classes among them.
"""

import dataclasses
import enum
import inspect
import re
from collections.abc import Callable, Iterator
from typing import NamedTuple

import pytest

import jaxik
from tests.helpers.api_reference import REFERENCE

PACKAGES = {name.partition(".")[0] for name in REFERENCE.MODULES}
REFERS = re.compile(r"\b[Ss]ee :(meth|class):`")  # a method of the same name that is documented there
PUBLIC = {f"{m}.{name}": value for m in REFERENCE.MODULES for name, value in REFERENCE.members(m).items()}


def section(docstring: str, name: str) -> str:
    """Body of a Google section, or an empty string."""
    found = re.search(rf"^{name}:\n((?:\n|[ ]+.*(?:\n|$))*)", inspect.cleandoc(docstring), re.MULTILINE)
    return found[1] if found else ""


def undocumented(value: object, package: str) -> Iterator[str]:
    """Gaps in the documentation of a public class or function."""
    if inspect.isclass(value):
        yield from _in_class(value, package)
    elif callable(value):
        yield from _in_function(value)
    elif type(value) not in PUBLIC.values():
        yield "a documented class"


def _in_class(cls: type, package: str) -> Iterator[str]:
    text = inspect.cleandoc(cls.__dict__.get("__doc__") or "")
    # Dataclasses and named tuples write their signature where a docstring is missing.
    yield from _in_summary("" if text.startswith(f"{cls.__name__}(") else text)
    attributes = section(text, "Attributes")
    yield from (f"field {name}" for name in _fields(cls) if not _describes(attributes, name))
    for name, plain in inspect.getmembers_static(cls):
        if name.startswith("_") or name in _fields(cls):
            continue
        function = plain.fget if isinstance(plain, property) else inspect.unwrap(getattr(plain, "__func__", plain))
        if not inspect.isfunction(function) or function.__module__.partition(".")[0] != package:
            continue
        text = inspect.cleandoc(function.__doc__ or "")
        if isinstance(plain, property) or REFERS.search(text):
            lacks = _in_summary(text)
        else:
            lacks = _in_function(function, bound=not isinstance(plain, staticmethod))
        yield from (f"{name}: {lack}" for lack in lacks)


def _in_function(function: Callable, *, bound: bool = False) -> Iterator[str]:
    text, signature = inspect.cleandoc(function.__doc__ or ""), inspect.signature(function)
    yield from _in_summary(text)
    arguments = section(text, "Args")
    names = [name for name in signature.parameters if not name.startswith("_")][bound:]
    yield from (f"argument {name}" for name in names if not _describes(arguments, name))
    described = section(text, "Returns") or section(text, "Yields") or text.startswith("Return ")
    if not described and signature.return_annotation not in (None, "None", inspect.Signature.empty):
        yield "returned value"


def _in_summary(text: str) -> Iterator[str]:
    first = text.partition("\n\n")[0].rstrip()
    if len(first) <= 10 or not first.endswith((".", ":")):
        yield "docstring"


def _fields(cls: type) -> list[str]:
    """Fields of a dataclass or named tuple, and other annotated attributes."""
    if issubclass(cls, enum.Enum | BaseException):
        return []
    names = [f.name for f in dataclasses.fields(cls) if f.init and f.repr] if dataclasses.is_dataclass(cls) else []
    names += [*getattr(cls, "_fields", ()), *inspect.get_annotations(cls)]
    return [name for name in dict.fromkeys(names) if not name.startswith("_")]


def _describes(entries: str, name: str) -> bool:
    return re.search(rf"^ +(?:\w+, )*\*{{0,2}}{name}(?:, \w+)*(?: \(.*\))?:", entries, re.MULTILINE) is not None


@pytest.mark.parametrize("name", PUBLIC)
def test_public_names_are_documented(name):
    lacks = list(undocumented(PUBLIC[name], name.partition(".")[0]))
    assert not lacks, f"{name} is documented without: {'; '.join(lacks)}"


def test_every_package_and_kind_is_seen():
    assert len(PUBLIC) > 150
    assert {name.partition(".")[0] for name in PUBLIC} == {"jaxik", "training", "hardware"}
    assert {"jaxik.energy.Differences", "jaxik.presets.iiwa14", "jaxik.view.draw_arm"} <= set(PUBLIC)


@pytest.mark.parametrize("name", ["solve_ik", "forward_kinematics", "joint_positions", "swivel_of"])
def test_kernels_document_units_errors_and_derivatives(name):
    text = inspect.getdoc(getattr(jaxik, name))
    assert "[rad]" in text
    assert section(text, "Raises")
    assert "**Differentiability**" in text


class Good(NamedTuple):
    """A pair of numbers.

    Attributes:
        a: The first.
        b: The second.
    """

    a: int
    b: int

    def plus(self, c: int) -> "Good":
        """Return both with a number added.

        Args:
            c: The number.
        """
        return Good(self.a + c, self.b + c)

    @property
    def total(self) -> int:
        """Sum of both numbers."""
        return self.a + self.b

    @staticmethod
    def zero(like: int) -> int:
        """Return zero.

        Args:
            like: A number.
        """
        return 0 * like


class Heir(Good):
    """A pair of numbers that adds in its own way.

    Attributes:
        a, b: The numbers.
    """

    def plus(self, c: int) -> "Good":
        """See :class:`Good`."""
        return Good(self.a + 2 * c, self.b)


class Bad(NamedTuple):
    """A pair of numbers.

    Attributes:
        a: The first.
    """

    a: int
    b: int

    def plus(self, c: int) -> Good:
        """Both with a number added."""
        return Good(self.a + c, self.b + c)

    @property
    def total(self) -> int:
        return self.a + self.b


@dataclasses.dataclass
class Bare:
    a: int


def gap(a, *, b) -> int:
    """Add two numbers, one of them described.

    Args:
        a: The first.
    """
    return a + b


@pytest.mark.parametrize(
    ("value", "lacks"),
    [
        (Good, []),
        (Heir, []),
        (Bad, ["field b", "plus: argument c", "plus: returned value", "total: docstring"]),
        (Bare, ["docstring", "field a"]),
        (gap, ["argument b", "returned value"]),
    ],
)
def test_gaps_are_found(value, lacks):
    assert list(undocumented(value, "tests")) == lacks
