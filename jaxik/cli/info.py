"""``jaxik info``: versions, devices, and the names of arms, paths and commands."""

import platform
from importlib.metadata import PackageNotFoundError, entry_points, version

import jax

from jaxik.cli.console import Screen
from jaxik.cli.inputs import ARMS
from jaxik.paths import example_path_names

_EXTRAS = {"tyro": "cli", "rich": "cli", "matplotlib": "plots", "viser": "view", "trimesh": "urdf", "cobs": "boards"}


def info(json: bool = False) -> int:
    """Show versions, devices, and the names of arms, paths and commands.

    Args:
        json: Print one JSON document instead of the table.

    Returns:
        0.
    """
    screen = Screen(json)
    packages = {name: _version(name) for name in ("jaxik", "jax", "jaxlib", "numpy", "optax", *_EXTRAS)}
    facts = {
        "python": platform.python_version(),
        **{k: v or f'absent: pip install "jaxik[{_EXTRAS.get(k, "all")}]"' for k, v in packages.items()},
        "devices": ", ".join(str(d) for d in jax.devices()),
        "double precision": "on" if jax.config.jax_enable_x64 else "off",  # pyright: ignore
        "arms": ", ".join(ARMS),
        "paths": ", ".join(example_path_names()),
        "commands": ", ".join(sorted(p.name for p in entry_points(group="jaxik.commands"))),
    }
    screen.table("jaxik", ("name", "value"), list(facts.items()))
    screen.result(facts)
    return 0


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
