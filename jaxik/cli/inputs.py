"""Arguments as typed on the command line: arms, paths, energies and fractions."""

from collections.abc import Callable
from pathlib import Path as FilePath

from jaxik import energy as energies
from jaxik.arm import ArmModel, UrdfArm, list_arms, load_model, load_urdf, presets
from jaxik.errors import JaxikError
from jaxik.mjcf import from_mjcf
from jaxik.paths import Path, example_path, example_path_names, load_path

ARMS: dict[str, Callable[[], ArmModel]] = {
    "meccanoid-right": lambda: presets.meccanoid("right"),
    "meccanoid-left": lambda: presets.meccanoid("left"),
    "iiwa7": presets.iiwa7,
    "iiwa14": presets.iiwa14,
    "paper": presets.paper_arm,
    "franka-fr3": presets.franka_fr3,
    "franka-panda": presets.franka_panda,
    "xarm7": presets.xarm7,
    "gen3": presets.gen3,
    "openarm-left": lambda: presets.openarm("left"),
    "openarm-right": lambda: presets.openarm("right"),
    "g1-left": lambda: presets.g1("left"),
    "g1-right": lambda: presets.g1("right"),
}
_SHORT = {"fr3": "franka-fr3", "panda": "franka-panda", "g1": "g1-left", "openarm": "openarm-left"}
ENERGIES: dict[str, Callable[[], energies.Energy]] = {
    "joint-motion": energies.joint_motion,
    "holding": energies.holding,
    "servo": energies.servo,
}


class InputError(JaxikError, ValueError):
    """An argument that cannot be understood."""


def find_arm(name: str, base: str | None = None, tip: str | None = None) -> ArmModel:
    """Return a preset, or load an arm model file or an arm of a URDF file.

    Args:
        name: Name of a preset, such as ``iiwa14`` or ``fr3``, or a file ending in ``.json``, ``.urdf`` or, for MuJoCo,
            ``.xml``.
        base: Base link in a URDF file; may be left out, with ``tip``, if the file has one arm. Body in a MuJoCo file;
            default the world.
        tip: Tip link in a URDF file; site or body in a MuJoCo file, default its only site.

    Raises:
        InputError: The name is neither, or a URDF file needs base and tip.
    """
    if is_urdf(name):
        return load_urdf(name, *urdf_ends(name, base, tip))
    if name.lower().endswith(".xml"):
        return from_mjcf(name, tip, base)
    if base is not None or tip is not None:
        raise InputError(f"--base and --tip are links of a URDF file; {name} is none")
    if (full := _SHORT.get(name, name)) in ARMS:
        return ARMS[full]()
    if name.endswith(".json"):
        return load_model(name)
    raise InputError(
        f"no arm {name!r}; there are {', '.join(ARMS)}, or give a model file (.json), a URDF (.urdf) or an MJCF (.xml)"
    )


def is_urdf(name: str) -> bool:
    """Return whether a name is that of a URDF file."""
    return name.lower().endswith((".urdf", ".xacro"))


def urdf_ends(name: str, base: str | None, tip: str | None) -> tuple[str, str]:
    """Return base and tip link of an arm in a URDF file; without them those of its only arm.

    Raises:
        InputError: Only one of them is given, or the file has several arms, or none.
    """
    if base is not None and tip is not None:
        return base, tip
    if base is not None or tip is not None:
        raise InputError(f"{name}: --base and --tip go together; `jaxik info {name}` lists the arms in the file")
    found = list_arms(name)
    arms = [arm for arm in found if arm.ok]
    if len(arms) == 1:
        return arms[0].base_link, arms[0].tip_link
    if arms:
        choices = ", ".join(f"--base {arm.base_link} --tip {arm.tip_link}" for arm in arms)
        raise InputError(f"{name} has {len(arms)} arms; select one: {choices}")
    raise InputError(f"{name} has no arm of the class{_nearest_miss(found)}; `jaxik info {name}` says more")


def _nearest_miss(found: tuple[UrdfArm, ...]) -> str:
    if not found:
        return ": no six or seven turning joints follow each other"
    return f"; from {found[0].base_link} to {found[0].tip_link}: {found[0].problem}"


def find_path(name: str, columns: str | None = None) -> Path:
    """Return an example path, or load a path file.

    Args:
        name: Name of an example path, or a file ending in ``.csv``, ``.yaml`` or ``.ros.json``.
        columns: Names of the columns in a table of another program (see :func:`parse_columns`).

    Raises:
        InputError: The name is neither.
    """
    if is_example(name):
        return example_path(name)
    if name.endswith(".csv") or FilePath(name).exists():
        return load_path(name, columns=parse_columns(columns))
    raise InputError(f"no path {name!r}; there are {', '.join(example_path_names())}, or give a file ending in .csv")


def is_example(name: str) -> bool:
    """Return whether a path is an example: a drawing without a place of its own."""
    return name in example_path_names()


def parse_columns(text: str | None) -> dict[str, str] | None:
    """Return names of columns by the names used here.

    Args:
        text: For example ``time=stamp,x=tool_x``; None for none.

    Raises:
        InputError: The text is no such list.
    """
    if text is None:
        return None
    pairs = [part.partition("=") for part in text.split(",")]
    if not all(ours.strip() and theirs.strip() for ours, _, theirs in pairs):
        raise InputError(f"expected columns such as time=stamp,x=tool_x; got {text!r}")
    return {ours.strip(): theirs.strip() for ours, _, theirs in pairs}


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
