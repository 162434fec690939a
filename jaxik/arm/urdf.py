"""URDF files: the chain between two links as an arm, or the reason why it is not one."""

import os
import warnings
from pathlib import Path

import numpy as np

from jaxik.arm.arm import ArmModel, HalfSpaces, LinkInertia
from jaxik.arm.arm_classes import Geometry, deviation_bound, exact_arm, refined_deviation
from jaxik.arm.builder import CONTINUOUS, UNLIMITED, arm_of_geometry, floats
from jaxik.arm.refined_class import RefinedGeometry
from jaxik.arm.srs_class import degrees, mm
from jaxik.arm.swivel_reference import SwivelReference
from jaxik.arm.urdf_arms import hint
from jaxik.arm.urdf_chain import Chain, carried_bodies, chain_between, chain_geometry, rotation_from_root
from jaxik.arm.urdf_file import UrdfJoint, UrdfRobot, read_robot
from jaxik.arm.urdf_units import unit_problems
from jaxik.errors import ArmClassError, FileFormatError, JaxikWarning

GRAVITY = np.array([0.0, 0.0, -9.81])
"""Gravity in the root link's frame [m/s²], whose z axis points up by URDF convention."""

_SLOWEST = 1e-9
"""Velocity [rad/s] and effort [N m] limits below this stand for "not known", as zeros do in many files."""

Bodies = list[list[tuple[float, np.ndarray, np.ndarray]]]


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

    Only what kinematics and dynamics need is read, so sensors, shapes, meshes and leftovers of xacro do no harm, and a
    :class:`jaxik.JaxikWarning` names numbers that look like degrees or millimeters. Fixed joints are folded in. Joints
    off the chain stay at zero, and their links' masses are added to the link of the chain that carries them. The tool
    is the frame of ``tip_link``, its z axis the pointing direction. A chain that misses a class with a closed form by
    no more than the file's rounding is replaced by the nearest exact member, and a note of the model bounds what that
    changes. Seven joints that miss the classes by more are solved as they are, by refinement
    (:class:`jaxik.RefinedArm`).

    Args:
        file: File name.
        base_link: Name of the link whose frame becomes the arm's base frame.
        tip_link: Name of the link whose frame is the tool.
        reference: Zero of the swivel angle; default as in :func:`jaxik.make_arm`.
        keep_out: Half-spaces the elbow must stay in; default none.
        tolerance: Largest deviation taken for rounding: angles [rad], lengths relative to the arm's. The default 1e-5
            accepts right angles printed as 1.5708 (off by 4e-6) and leaves real offsets, which are millimeters, as they
            are. With 0 nothing is rounded.

    Returns:
        The arm with the file's joint names, limits, efforts, velocities and inertias.

    Raises:
        ArmClassError: If the chain is far from every class, or has other joints than it should; says which conditions
            fail and by how many mm or degrees, and between which links of the file there is an arm.
        FileFormatError: If the file is not well-formed, lacks a number or has a name twice; names the line.
        OSError: If the file cannot be opened.
        ValueError: If a link name is unknown, or the base is not above the tip.
    """
    path = Path(file)
    robot = read_robot(path)
    chain = _chain(robot, path, base_link, tip_link)
    for problem in unit_problems(chain):
        warnings.warn(f"{path.name}: {problem}", JaxikWarning, stacklevel=2)
    try:
        geometry = chain_geometry(chain, tolerance)
    except ArmClassError as error:
        where = f"{path.name}, {base_link} to {tip_link}" if len(chain.joints) in (6, 7) else path.name
        raise ArmClassError(f"{where}: {error}{hint(robot, chain.names, path.name, tolerance)}") from None
    bodies = carried_bodies(robot, chain)
    notes = _rounding_note(chain, geometry, tolerance) + _missing_notes(robot, chain, bodies)
    links, impossible = _links(chain, bodies)
    lower, upper = _limits(chain)
    arm = arm_of_geometry(
        geometry,
        lower=lower,
        upper=upper,
        velocity_limit=[_known(j, "velocity") or np.inf for j in chain.joints],
        torque_limit=[_known(j, "effort") or np.inf for j in chain.joints],
        links=links,
        gravity=rotation_from_root(robot, base_link).T @ GRAVITY,
        reference=reference,
        keep_out=keep_out,
    )
    return ArmModel(
        arm=arm,
        joint_names=tuple(chain.names),
        name=robot.name,
        source=f"{path.name}, {base_link} to {tip_link}",
        notes=notes + impossible,
    )


def _chain(robot: UrdfRobot, path: Path, base_link: str, tip_link: str) -> Chain:
    try:
        return chain_between(robot, base_link, tip_link)
    except FileFormatError:
        raise
    except ArmClassError as error:
        raise ArmClassError(f"{path.name}: {error}{hint(robot, [], path.name, 1e-5)}") from None
    except ValueError as error:
        start = f"{path.name} has" if str(error).startswith("no link") else f"{path.name}:"
        expand = (
            f"; xacro elements are left in it: expand it first, xacro {path.name} > arm.urdf" if robot.xacro else ""
        )
        raise ValueError(f"{start} {error}{expand}") from None


def _rounding_note(chain: Chain, geometry: Geometry, tolerance: float) -> tuple[str, ...]:
    if isinstance(geometry, RefinedGeometry):
        away = refined_deviation(geometry)
        return (
            f"Solved by refinement, as the file has it: {_missed(chain, tolerance)}.",
            f"The tool of the nearest {geometry.member.kinematic_class} arm, which gives the seeds, differs by up to "
            f"{mm(away.position)} and {degrees(away.rotation)}.",
        )
    bound = deviation_bound(np.stack(chain.axes), np.stack(chain.points), chain.tool, geometry)
    # 1e-13: products of exact numbers in float64 stay an order of magnitude below.
    if bound.rotation <= 1e-13 and bound.position <= 1e-13 * geometry.length:
        return ()
    return (
        f"Rounded to the nearest exact {geometry.kinematic_class} arm: the tool differs from the file's by at most "
        f"{mm(bound.position)} and {degrees(bound.rotation)} in any posture.",
    )


def _missed(chain: Chain, tolerance: float) -> str:
    """Return the conditions of the classes with a closed form that a chain misses."""
    try:
        exact_arm(np.stack(chain.axes), np.stack(chain.points), chain.tool, tolerance, names=chain.names)
    except ArmClassError as error:
        return str(error)
    return ""


def _missing_notes(robot: UrdfRobot, chain: Chain, bodies: Bodies) -> tuple[str, ...]:
    notes = ["URDF has no motor data: resistance and torque constant are 1, so servo energy counts squared torque."]
    for what in ("velocity", "effort"):
        without = [j.name for j in chain.joints if not _known(j, what)]
        if without:
            notes.append(f"The file gives no {what} limit for {', '.join(without)}: taken as unlimited.")
    massless = [j.name for j, carried in zip(chain.joints, bodies, strict=True) if not carried]
    if massless:
        notes.append(f"The file gives no mass for what {', '.join(massless)} carries.")
    if robot.xacro:
        notes.append("The file has xacro elements, which are ignored.")
    return tuple(notes)


def _limits(chain: Chain) -> tuple[list[float], list[float]]:
    lower, upper = [], []
    for joint in chain.joints:
        low, high = -np.inf, np.inf
        if joint.type == "revolute":
            given = joint.limit("lower") or 0.0, joint.limit("upper") or 0.0  # URDF's default is 0
            low, high = max(given[0], -CONTINUOUS), min(given[1], CONTINUOUS)
            if not low < high:
                raise FileFormatError(
                    f"{joint.file}, line {joint.element.line}: revolute joint {joint.name} has an empty range, lower "
                    f"{given[0]:g} and upper {given[1]:g}; give it limits or make it continuous"
                )
        lower.append(low)
        upper.append(high)
    return lower, upper


def _known(joint: UrdfJoint, what: str) -> float | None:
    """Return a positive velocity or effort limit, else None: zero and less stand for "not known" in many files."""
    value = joint.limit(what)
    return min(value, UNLIMITED) if value is not None and value > _SLOWEST else None


def _links(chain: Chain, bodies: Bodies) -> tuple[LinkInertia, tuple[str, ...]]:
    """Return one rigid body per joint, and notes on impossible inertias.

    Masses are added, inertias moved to the common center of mass.
    """
    mass, center, inertia, notes = [], [], [], []
    for joint, carried, point in zip(chain.joints, bodies, chain.points, strict=True):
        total = sum(b[0] for b in carried)
        middle = sum((b[0] * b[1] for b in carried), start=np.zeros(3)) / total if total > 0 else point
        tensor = np.zeros((3, 3))
        for m, c, own in carried:
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
