"""Every public name says what it is; functions say what goes in, what comes out and what is differentiable."""

import inspect
import re

import pytest

import jaxik

FUNCTIONS = sorted(n for n in jaxik.__all__ if callable(v := getattr(jaxik, n)) and not inspect.isclass(v))
CLASSES = sorted(n for n in jaxik.__all__ if inspect.isclass(getattr(jaxik, n)))


def section(docstring: str, name: str) -> str:
    """Body of a Google section, or an empty string."""
    found = re.search(rf"^{name}:\n((?:\n|[ ]+.*(?:\n|$))*)", inspect.cleandoc(docstring), re.MULTILINE)
    return found[1] if found else ""


@pytest.mark.parametrize("name", jaxik.__all__)
def test_has_a_docstring_of_its_own(name):
    value = getattr(jaxik, name)
    text = inspect.getdoc(value) or ""
    assert len(text.splitlines()[0]) > 10
    assert text.splitlines()[0].rstrip().endswith((".", ":"))
    assert not text.startswith(f"{name}(")  # what a dataclass writes by itself


@pytest.mark.parametrize("name", FUNCTIONS)
def test_function_names_every_parameter_and_what_it_returns(name):
    function = getattr(jaxik, name)
    text, signature = inspect.getdoc(function), inspect.signature(function)
    arguments = section(text, "Args")
    for parameter in signature.parameters:
        assert re.search(rf"^ +\*{{0,2}}{parameter}(?: \(.*\))?:", arguments, re.MULTILINE), parameter
    # A summary that names the value, or a class of the library as the type, says as much as a section would.
    named = text.startswith("The ") or getattr(signature.return_annotation, "__name__", None) in jaxik.__all__
    assert named or section(text, "Returns") or section(text, "Yields") or signature.return_annotation is None


@pytest.mark.parametrize("name", ["solve_ik", "forward_kinematics", "joint_positions", "swivel_of"])
def test_kernels_say_units_errors_and_derivatives(name):
    text = inspect.getdoc(getattr(jaxik, name))
    assert "[rad]" in text
    assert section(text, "Raises")
    assert "**Differentiability**" in text


@pytest.mark.parametrize("name", CLASSES)
def test_dataclass_names_every_field(name):
    value = getattr(jaxik, name)
    described = section(inspect.getdoc(value), "Attributes")
    for field in getattr(value, "__dataclass_fields__", {}):
        assert re.search(rf"^ +{field}(?:, \w+)*:", described, re.MULTILINE), field
