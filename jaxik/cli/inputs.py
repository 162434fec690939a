"""Arguments as typed on the command line: arms, paths, energies and fractions."""

from collections.abc import Callable
from pathlib import Path as FilePath

from jaxik import energy as energies
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
ENERGIES: dict[str, Callable[[], energies.Energy]] = {
    "joint-motion": energies.joint_motion,
    "holding": energies.holding,
    "servo": energies.servo,
}


class InputError(JaxikError, ValueError):
    """An argument that cannot be understood."""


def find_arm(name: str) -> ArmModel:
    """Return a preset, or load an arm model file.

    Args:
        name: Name of a preset, or a file ending in ``.json``.

    Raises:
        InputError: The name is neither.
    """
    if name in ARMS:
        return ARMS[name]()
    if name.endswith(".json"):
        return load_model(name)
    raise InputError(f"no arm {name!r}; there are {', '.join(ARMS)}, or give a model file ending in .json")


def find_path(name: str) -> Path:
    """Return an example path, or load a path file.

    Args:
        name: Name of an example path, or a file ending in ``.csv``.

    Raises:
        InputError: The name is neither.
    """
    if name in example_path_names():
        return example_path(name)
    if name.endswith(".csv") or FilePath(name).exists():
        return load_path(name)
    raise InputError(f"no path {name!r}; there are {', '.join(example_path_names())}, or give a file ending in .csv")


def parse_fraction(text: str) -> float:
    """Return a fraction given as a number or in percent.

    Args:
        text: For example ``0.01`` or ``1%``.

    Returns:
        The fraction, from 0 to less than 1.

    Raises:
        InputError: The text is no such number.
    """
    number, percent = text.strip().removesuffix("%"), text.strip().endswith("%")
    try:
        fraction = float(number) / (100 if percent else 1)
    except ValueError:
        fraction = -1.0
    if not 0 <= fraction < 1:
        raise InputError(f"expected a fraction such as 0.01 or a percentage such as 1%, got {text!r}")
    return fraction
