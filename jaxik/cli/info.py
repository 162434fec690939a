"""``jaxik info``: versions, devices and names; the arms in a URDF file; or an arm."""

import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, entry_points, version
from itertools import pairwise
from typing import Annotated

import jax
import numpy as np
import tyro

from jaxik.arm import ArmModel, RefinedArm, deviation_of, list_arms
from jaxik.cli.console import Screen
from jaxik.cli.inputs import ARMS, find_arm, is_urdf
from jaxik.paths import example_path_names

_NONE = (
    "no arm in this file can be solved; another --base or --tip may do, and other programs take other structures: "
    "docs/your-arm.md"
)
_EXTRAS = {"tyro": "cli", "rich": "cli", "matplotlib": "plots", "viser": "view", "trimesh": "urdf", "cobs": "boards"}


def info(
    file: Annotated[str | None, tyro.conf.Positional] = None,
    arm: str | None = None,
    base: str | None = None,
    tip: str | None = None,
    json: bool = False,
) -> int:
    """Show versions, devices and names; with a URDF file, the arms in it; with an arm, its joints and links.

    Args:
        file: URDF file (.urdf) whose arms are listed, or an arm as for --arm.
        arm: Preset (listed by `jaxik info`), model file (.json), URDF (.urdf) or MJCF (.xml) of an arm to describe.
        base: Base link in a URDF; not needed, as the tip, if it has one arm. Base body in an MJCF; default the world.
        tip: Tip link in a URDF; site or body of the tool in an MJCF.
        json: Print one JSON document instead of the tables.

    Returns:
        0, or 1 for a URDF file without an arm.
    """
    screen = Screen(json)
    if arm is None and file is not None and is_urdf(file) and base is None and tip is None:
        return _list(screen, file)
    if (name := arm or file) is not None:
        _describe(screen, find_arm(name, base, tip))
        return 0
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


def _list(screen: Screen, file: str) -> int:
    """Print the arms in a URDF file."""
    arms = list_arms(file)
    kinds = [(a.kinematic_class or "none", _parameter(a.kinematic_class, a.joint_names)) for a in arms]
    rows = [
        (a.base_link, a.tip_link, str(len(a.joint_names)), *kind, _exactness(a.ok, a.deviation))
        for a, kind in zip(arms, kinds, strict=True)
    ]
    screen.table(f"arms in {file}", ("base", "tip", "joints", "class", "parameter", "solved"), rows)
    good = [arm for arm in arms if arm.ok]
    if not good:  # of limbs beside an arm, such as fingers, the reasons would bury the table
        for arm in arms:
            screen.say(f"{arm.base_link} to {arm.tip_link}: {arm.problem}")
        screen.say(_NONE if arms else "no six or seven turning joints follow each other in this file")
    elif len(good) < len(arms):
        screen.copyable(f"the reason why one is not solved: jaxik info {file} --base BASE --tip TIP")
    if any(arm.deviation for arm in good):
        screen.say("arms solved by refinement: plans take longer and come without a proof")
    if good:
        first = min(good, key=lambda arm: arm.deviation)
        screen.copyable(f"use one: jaxik plan reach --arm {file} --base {first.base_link} --tip {first.tip_link}")
    keys = ("base", "tip", "joints", "problem", "deviation", "class", "parameter")
    listed = [
        dict(zip(keys, (a.base_link, a.tip_link, list(a.joint_names), a.problem, a.deviation, *kind), strict=True))
        for a, kind in zip(arms, kinds, strict=True)
    ]
    screen.result({"file": file, "arms": listed})
    return 0 if good else 1


def _describe(screen: Screen, model: ArmModel) -> None:
    """Print joints, links and notes of an arm."""
    arm = model.arm
    lower, upper, speed = (np.degrees(np.asarray(x, float)) for x in (arm.lower, arm.upper, arm.velocity_limit))
    torque, mass = np.asarray(arm.torque_limit, float), np.asarray(arm.links.mass, float)
    points = [np.asarray(p, float) for p in (arm.shoulder, arm.elbow, arm.wrist, arm.tool_position)]
    lengths = [float(np.linalg.norm(b - a)) for a, b in pairwise(points)]
    deviation = deviation_of(arm).position if isinstance(arm, RefinedArm) else 0.0
    facts = {
        "name": model.name,
        "deviation": deviation,
        "source": model.source,
        "class": model.kinematic_class,
        "parameter": _parameter(model.kinematic_class, model.joint_names),
        "joints": list(model.joint_names),
        "range_deg": [[float(a), float(b)] for a, b in zip(lower, upper, strict=True)],
        "velocity_deg_s": speed.tolist(),
        "torque": torque.tolist(),
        "mass": mass.tolist(),
        "upper_arm": lengths[0],
        "forearm": lengths[1],
        "hand": lengths[2],
        "notes": list(model.notes),
    }
    rows = [
        (name, *(_shown(x, most) for x, most in zip(numbers, (1e4, 1e4, 1e6, 1e5), strict=True)), f"{kg:.3g}")
        for name, *numbers, kg in zip(model.joint_names, lower, upper, speed, torque, mass, strict=True)
    ]
    columns = ("joint", "lower [°]", "upper [°]", "velocity [°/s]", "torque [N m]", "mass [kg]")
    screen.table(f"{model.name}, {model.kinematic_class}, {arm.n_joints} joints, from {model.source}", columns, rows)
    screen.say(f"upper arm {lengths[0]:.4g} m, forearm {lengths[1]:.4g} m, wrist to tool {lengths[2]:.4g} m")
    screen.say(f"redundancy parameter: {facts['parameter']}; solved: {_exactness(True, deviation)}")
    for note in model.notes:
        screen.say(f"note: {note}")
    screen.result(facts)


def _exactness(ok: bool, deviation: float) -> str:
    """Return how an arm is solved; of one that is refined, with the distance of the arm that gives the seeds."""
    if not ok:
        return "no"
    return f"refined from {1e3 * deviation:.3g} mm" if deviation else "closed form"


def _parameter(kinematic_class: str, names: Sequence[str]) -> str:
    """Name of the redundancy parameter of an arm of a class, which is "" for none."""
    if kinematic_class in ("", "S-R-S"):
        return "swivel" if kinematic_class else ""
    joint = 0 if kinematic_class.endswith("R-U shoulder") else 6
    return f"q{joint + 1} ({names[joint]})"


def _shown(value: float, most: float) -> str:
    """A number as text, or "none" for one that stands for no limit."""
    return "none" if abs(value) >= most else f"{value:.4g}"


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
