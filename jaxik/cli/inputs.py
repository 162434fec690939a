"""Arms and paths by the names people type."""

from collections.abc import Callable
from pathlib import Path as FilePath

from jaxik.arm import ArmModel, load_model, presets
from jaxik.errors import JaxikError
from jaxik.paths import Path, example_path, example_path_names, load_path

ARMS: dict[str, Callable[[], ArmModel]] = {
    "meccanoid-right": lambda: presets.meccanoid("right"),
    "meccanoid-left": lambda: presets.meccanoid("left"),
    "iiwa7": presets.iiwa7,
    "iiwa14": presets.iiwa14,
    "paper": presets.paper_arm,
}


class InputError(JaxikError, ValueError):
    """A name that is neither known nor a file."""


def find_arm(name: str) -> ArmModel:
    """A preset by name, or an arm model file.

    Raises:
        InputError: Neither.
    """
    if name in ARMS:
        return ARMS[name]()
    if name.endswith(".json"):
        return load_model(name)
    raise InputError(f"no arm {name!r}; there are {', '.join(ARMS)}, or give a model file ending in .json")


def find_path(name: str) -> Path:
    """An example path by name, or a path file.

    Raises:
        InputError: Neither.
    """
    if name in example_path_names():
        return example_path(name)
    if name.endswith(".csv") or FilePath(name).exists():
        return load_path(name)
    raise InputError(f"no path {name!r}; there are {', '.join(example_path_names())}, or give a file ending in .csv")
