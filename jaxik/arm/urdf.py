"""URDF files: the chain between two links as an S-R-S arm, or the reason why it is not one."""

import difflib
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from jaxik.arm.arm import ArmModel, HalfSpaces, LinkInertia
from jaxik.arm.builder import floats, make_arm
from jaxik.arm.srs_class import ArmGeometry, common_point, degrees, deviation_bound, exact_member, mm
from jaxik.arm.swivel_reference import SwivelReference
from jaxik.arm.urdf_file import read_robot
from jaxik.errors import ArmClassError, FileFormatError

GRAVITY = np.array([0.0, 0.0, -9.81])
"""Gravity in the root link's frame [m/s²], whose z axis points up by URDF convention."""


@dataclass
class _Chain:
    """Movable joints from base to tip and the bodies they carry, in the base frame at zero joint angles."""

    joints: list[Any] = field(default_factory=list)
    axes: list[np.ndarray] = field(default_factory=list)
    points: list[np.ndarray] = field(default_factory=list)
    tool: np.ndarray = field(default_factory=lambda: np.eye(4))
    bodies: list[list[tuple[float, np.ndarray, np.ndarray]]] = field(default_factory=list)


def load_urdf(
    file: str | os.PathLike[str],
    base_link: str,
    tip_link: str,
    *,
    reference: SwivelReference | None = None,
    keep_out: HalfSpaces | None = None,
    tolerance: float = 1e-5,
) -> ArmModel:
    """Load the arm between two links of a URDF file.

    Fixed joints are folded in. Joints off the chain stay at zero, and their links' masses are added to the link of the
    chain that carries them. Meshes are not read. The tool is the frame of ``tip_link``, its z axis the pointing
    direction. A chain that misses the S-R-S class by no more than the file's rounding is replaced by the nearest exact
    member, and a note of the model bounds what that changes.

    Args:
        file: File name.
        base_link: Name of the link whose frame becomes the arm's base frame.
        tip_link: Name of the link whose frame is the tool.
        reference: Zero of the swivel angle; default as in :func:`jaxik.make_arm`.
        keep_out: Half-spaces the elbow must stay in; default none.
        tolerance: Largest deviation taken for rounding: angles [rad], lengths relative to the arm's. The default 1e-5
            accepts right angles printed as 1.5708 (off by 4e-6) and refuses real offsets, which are millimeters.

    Returns:
        The arm with the file's joint names, limits, efforts, velocities and inertias.

    Raises:
        ArmClassError: If the chain is not an S-R-S arm; says which condition fails and by how many mm or degrees.
        FileFormatError: If the file is not well-formed or lacks a number; names the line.
        OSError: If the file cannot be opened.
        ValueError: If a link name is unknown, or the base is not above the tip.
        MissingExtraError: If yourdfpy is not installed.
    """
    path = Path(file)
    robot = read_robot(path)
    chain = _chain(robot, path, base_link, tip_link)
    names = [j.name for j in chain.joints]
    if len(names) not in (6, 7):
        raise ArmClassError(
            f"{path.name}: the chain from {base_link} to {tip_link} has {len(names)} revolute joints "
            f"({', '.join(names) or 'none'}); jaxik solves 7, or 6 with the tool's roll free"
        )
    try:
        geometry = _geometry(chain, names, tolerance)
    except ArmClassError as error:
        raise ArmClassError(f"{path.name}, {base_link} to {tip_link}: {error}") from None
    notes = _rounding_note(chain, geometry) + _missing_notes(chain)
    links, impossible = _links(chain)
    root_rotation = _rotation_from_root(robot, base_link)
    lower, upper = _limits(chain, path)
    arm = make_arm(
        *geometry,
        lower=lower,
        upper=upper,
        velocity_limit=[_or_none(j, "velocity") or np.inf for j in chain.joints],
        torque_limit=[_or_none(j, "effort") or np.inf for j in chain.joints],
        links=links,
        gravity=root_rotation.T @ GRAVITY,
        reference=reference,
        keep_out=keep_out,
    )
    return ArmModel(
        arm=arm,
        joint_names=tuple(names),
        name=robot.name,
        source=f"{path.name}, {base_link} to {tip_link}",
        notes=notes + impossible,
    )


def _chain(robot: Any, path: Path, base_link: str, tip_link: str) -> _Chain:
    """Follow the chain from the tip up to the base, then collect everything that it carries."""
    links = {link.name: link for link in robot.links}
    for role, name in (("base_link", base_link), ("tip_link", tip_link)):
        if name not in links:
            raise ValueError(_unknown_link(role, name, list(links), path))
    above: dict[str, list[Any]] = {}
    below: dict[str, list[Any]] = {}
    for joint in robot.joints:
        above.setdefault(joint.child, []).append(joint)
        below.setdefault(joint.parent, []).append(joint)

    on_chain, name, seen = [], tip_link, set()
    while name != base_link:
        parents = above.get(name, [])
        if len(parents) > 1 or name in seen:
            raise ArmClassError(
                f"{path.name}: link {name} closes a loop (child of {', '.join(j.name for j in parents)}); "
                f"jaxik solves open chains"
            )
        if not parents:
            raise ValueError(f"{path.name}: {base_link} is not above {tip_link}: going up from the tip ends at {name}")
        seen.add(name)
        on_chain.insert(0, parents[0])
        name = parents[0].parent
    for joint in on_chain:
        _check_joint(joint, path)

    chain = _Chain()
    members = {joint.name for joint in on_chain}
    todo, visited = [(base_link, np.eye(4), -1)], set()
    while todo:
        name, frame, owner = todo.pop()
        if name in visited or name not in links:
            continue
        visited.add(name)
        if name == tip_link:
            chain.tool = frame
        if owner >= 0:
            chain.bodies[owner].extend(_body(links[name], frame))
        for joint in below.get(name, []):
            child, carried_by = frame @ _matrix(joint.origin), owner
            if joint.name in members and joint.type != "fixed":
                carried_by = len(chain.joints)
                chain.joints.append(joint)
                chain.axes.append(child[:3, :3] @ (joint.axis / np.linalg.norm(joint.axis)))
                chain.points.append(child[:3, 3])
                chain.bodies.append([])
            todo.append((joint.child, child, carried_by))
    return chain


def _check_joint(joint: Any, path: Path) -> None:
    if joint.type not in ("fixed", "revolute", "continuous"):
        raise ArmClassError(
            f"{path.name}: joint {joint.name} in the chain is {joint.type}; only revolute, continuous and fixed joints "
            f"can be: choose base and tip so that it lies outside"
        )
    if joint.mimic is not None:
        raise ArmClassError(
            f"{path.name}: joint {joint.name} in the chain mimics {joint.mimic.joint}, so it is not free"
        )


def _geometry(chain: _Chain, names: list[str], tolerance: float) -> ArmGeometry:
    """Return the exact member nearest to the chain."""
    axes, points = np.stack(chain.axes), np.stack(chain.points)
    shoulder, shoulder_gap, shoulder_words = common_point(axes[:3], points[:3])
    wrist, wrist_gap, wrist_words = common_point(axes[4:], points[4:])
    elbow = points[3] + axes[3] * (axes[3] @ (shoulder - points[3]))
    given = ArmGeometry(axes, shoulder, elbow, wrist, chain.tool[:3, 3], chain.tool[:3, :3])
    allowed = tolerance * given.length
    failures = []
    for what, first, gap, words in (
        ("shoulder", 0, shoulder_gap, shoulder_words),
        ("wrist", 4, wrist_gap, wrist_words),
    ):
        if gap > allowed:
            numbered = [f"{first + i + 1} ({name})" for i, name in enumerate(names[first : first + 3])]
            failures.append(
                f"the {what} axes do not meet: {words.format(*numbered)} {mm(gap)} (tolerance {mm(allowed)})"
            )
    return exact_member(given, tolerance, failures)


def _rounding_note(chain: _Chain, geometry: ArmGeometry) -> tuple[str, ...]:
    bound = deviation_bound(np.stack(chain.axes), np.stack(chain.points), chain.tool, geometry)
    # 1e-13: products of exact numbers in float64 stay an order of magnitude below.
    if bound.rotation <= 1e-13 and bound.position <= 1e-13 * geometry.length:
        return ()
    return (
        f"Rounded to the nearest exact S-R-S arm: the tool differs from the file's by at most {mm(bound.position)} and "
        f"{degrees(bound.rotation)} in any posture.",
    )


def _missing_notes(chain: _Chain) -> tuple[str, ...]:
    notes = ["URDF has no motor data: resistance and torque constant are 1, so servo energy counts squared torque."]
    for what in ("velocity", "effort"):
        without = [j.name for j in chain.joints if not _or_none(j, what)]
        if without:
            notes.append(f"The file gives no {what} limit for {', '.join(without)}: taken as unlimited.")
    massless = [j.name for j, bodies in zip(chain.joints, chain.bodies, strict=True) if not sum(b[0] for b in bodies)]
    if massless:
        notes.append(f"The file gives no mass for what {', '.join(massless)} carries.")
    return tuple(notes)


def _limits(chain: _Chain, path: Path) -> tuple[list[float], list[float]]:
    lower, upper = [], []
    for joint in chain.joints:
        if joint.type == "continuous":
            low, high = -np.inf, np.inf
        else:
            low, high = (getattr(joint.limit, k, None) or 0.0 for k in ("lower", "upper"))  # URDF's default is 0
            if not low < high:
                raise FileFormatError(
                    f"{path.name}: revolute joint {joint.name} has an empty range, lower {low:g} and upper {high:g}; "
                    f"give it limits or make it continuous"
                )
        lower.append(low)
        upper.append(high)
    return lower, upper


def _or_none(joint: Any, what: str) -> float | None:
    """Return a positive velocity or effort limit, else None: zero and less stand for "not known" in many files."""
    value = getattr(joint.limit, what, None)
    return value if value is not None and value > 0 else None


def _links(chain: _Chain) -> tuple[LinkInertia, tuple[str, ...]]:
    """Return one rigid body per joint, and notes on impossible inertias.

    Masses are added, inertias moved to the common center of mass.
    """
    mass, center, inertia, notes = [], [], [], []
    for joint, bodies, point in zip(chain.joints, chain.bodies, chain.points, strict=True):
        total = sum(b[0] for b in bodies)
        middle = sum((b[0] * b[1] for b in bodies), start=np.zeros(3)) / total if total > 0 else point
        tensor = np.zeros((3, 3))
        for m, c, own in bodies:
            arm = c - middle
            tensor += own + m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        tensor = (tensor + tensor.T) / 2
        moments, directions = np.linalg.eigh(tensor)
        if moments[0] < -1e-12:  # a mistake in the file that does not matter to kinematics
            tensor = (directions * np.maximum(moments, 0)) @ directions.T
            notes.append(
                f"The file's inertia of what {joint.name} carries is impossible (principal moment {moments[0]:.3g} "
                f"kg m²): its negative part is dropped."
            )
        mass.append(total)
        center.append(middle)
        inertia.append(tensor)
    return LinkInertia(floats(np.array(mass)), floats(np.stack(center)), floats(np.stack(inertia))), tuple(notes)


def _body(link: Any, frame: np.ndarray) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """Return mass, center and inertia of one link in the base frame; nothing for a link without mass."""
    inertial = link.inertial
    if inertial is None or not inertial.mass:
        return []
    own = frame @ _matrix(inertial.origin)
    tensor = np.zeros((3, 3)) if inertial.inertia is None else inertial.inertia
    return [(inertial.mass, own[:3, 3], own[:3, :3] @ tensor @ own[:3, :3].T)]


def _rotation_from_root(robot: Any, base_link: str) -> np.ndarray:
    """Return the rotation of the base link in the root link, with the joints between at zero."""
    above = {joint.child: joint for joint in robot.joints}
    rotation, name = np.eye(3), base_link
    for _ in robot.joints:  # a bound on the steps, should the joints above the base form a loop
        if name not in above:
            break
        rotation = _matrix(above[name].origin)[:3, :3] @ rotation
        name = above[name].parent
    return rotation


def _matrix(origin: np.ndarray | None) -> np.ndarray:
    return np.eye(4) if origin is None else origin


def _unknown_link(role: str, name: str, links: list[str], path: Path) -> str:
    close = difflib.get_close_matches(name, links, n=3)
    hint = f"; did you mean {' or '.join(close)}?" if close else ";"
    shown = ", ".join(links[:40]) + (f" and {len(links) - 40} more" if len(links) > 40 else "")
    return f"{path.name} has no link {name} ({role}){hint} Its links are: {shown}"
