"""The chain between two links of a URDF file: its joints, their axes, and what they carry."""

import difflib
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from jaxik.arm.arm_classes import OTHER_LIBRARIES, Geometry, arm_geometry
from jaxik.arm.urdf_file import UrdfJoint, UrdfRobot
from jaxik.errors import ArmClassError


@dataclass
class Chain:
    """Turning joints from base to tip, in the base frame at zero joint angles.

    Attributes:
        base: Base link.
        tip: Tip link.
        joints: Turning joints.
        axes: Unit axis of each, ``(3,)``.
        points: A point on each axis, ``(3,)`` [m].
        tool: Frame of the tip, ``(4, 4)``.
        owners: Number of turning joints that move a link, by name, for the links of the chain.
    """

    base: str
    tip: str
    joints: list[UrdfJoint] = field(default_factory=list)
    axes: list[np.ndarray] = field(default_factory=list)
    points: list[np.ndarray] = field(default_factory=list)
    tool: np.ndarray = field(default_factory=lambda: np.eye(4))
    owners: dict[str, int] = field(default_factory=dict)

    @property
    def names(self) -> list[str]:
        """Names of the turning joints."""
        return [joint.name for joint in self.joints]


def parents_of(robot: UrdfRobot) -> dict[str, list[UrdfJoint]]:
    """Return the joints above every link; more than one close a loop."""
    above: dict[str, list[UrdfJoint]] = {}
    for joint in robot.joints:
        above.setdefault(joint.child, []).append(joint)
    return above


def children_of(robot: UrdfRobot) -> dict[str, list[UrdfJoint]]:
    """Return the joints below every link."""
    below: dict[str, list[UrdfJoint]] = {}
    for joint in robot.joints:
        below.setdefault(joint.parent, []).append(joint)
    return below


def chain_between(robot: UrdfRobot, base_link: str, tip_link: str) -> Chain:
    """Return the chain between two links.

    Raises:
        ValueError: A link is unknown, or the base is not above the tip.
        ArmClassError: A joint between them is no free turning joint, or closes a loop.
        FileFormatError: A number of a joint between them is malformed.
    """
    for role, name in (("base_link", base_link), ("tip_link", tip_link)):
        if name not in robot.links:
            raise ValueError(_unknown_link(role, name, list(robot.links)))
    chain, frame = Chain(base_link, tip_link, owners={base_link: 0}), np.eye(4)
    for joint in _joints_between(robot, base_link, tip_link):
        _check_joint(joint)
        frame = frame @ joint.origin()
        if joint.type != "fixed":
            chain.joints.append(joint)
            chain.axes.append(frame[:3, :3] @ joint.axis())
            chain.points.append(frame[:3, 3])
        chain.owners[joint.child] = len(chain.joints)
    chain.tool = frame
    return chain


def chain_geometry(chain: Chain, tolerance: float) -> Geometry:
    """Return the exact member of a class that a chain is to a tolerance, else the chain, to be refined.

    Raises:
        ArmClassError: The chain is far from every class, or has another number of joints; names the conditions missed.
    """
    names, count = chain.names, len(chain.joints)
    if count not in (6, 7):
        raise ArmClassError(
            f"the chain from {chain.base} to {chain.tip} has {count} revolute joints ({', '.join(names) or 'none'}); "
            f"jaxik solves 7, or 6 with the tool's roll free; {OTHER_LIBRARIES}"
        )
    return arm_geometry(np.stack(chain.axes), np.stack(chain.points), chain.tool, tolerance, names=names)


def carried_bodies(robot: UrdfRobot, chain: Chain) -> list[list[tuple[float, np.ndarray, np.ndarray]]]:
    """Return the bodies that every joint of a chain carries before the next one, in the base frame.

    Joints off the chain stay at zero.

    Returns:
        Mass [kg], center of mass ``(3,)`` [m] and inertia about it ``(3, 3)`` [kg m²] of every body.

    Raises:
        FileFormatError: A number is malformed.
    """
    below = children_of(robot)
    bodies: list[list[tuple[float, np.ndarray, np.ndarray]]] = [[] for _ in chain.joints]
    todo, visited = [(chain.base, np.eye(4), 0)], set()
    while todo:
        name, at, owner = todo.pop()
        if name in visited or name not in robot.links:
            continue
        visited.add(name)
        if owner > 0 and (body := robot.links[name].body()) is not None:
            mass, frame, tensor = body
            own = at @ frame
            bodies[owner - 1].append((mass, own[:3, 3], own[:3, :3] @ tensor @ own[:3, :3].T))
        for joint in below.get(name, []):
            moved_by = chain.owners.get(joint.child, owner)
            if moved_by > 0:  # what the base carries does not matter
                todo.append((joint.child, at @ joint.origin(), moved_by))
            elif joint.child in chain.owners:
                todo.append((joint.child, at @ joint.origin(), 0))
    return bodies


def rotation_from_root(robot: UrdfRobot, base_link: str) -> np.ndarray:
    """Return the rotation of a link in the root link, with the joints between at zero, ``(3, 3)``."""
    above, rotation, name = parents_of(robot), np.eye(3), base_link
    for _ in robot.joints:  # a bound on the steps, should the joints above the base form a loop
        if name not in above:
            break
        joint = above[name][-1]
        rotation = joint.origin()[:3, :3] @ rotation
        name = joint.parent
    return rotation


def _joints_between(robot: UrdfRobot, base_link: str, tip_link: str) -> list[UrdfJoint]:
    """Follow the joints from the tip up to the base."""
    above = parents_of(robot)
    found, name, seen = [], tip_link, set()
    while name != base_link:
        parents = above.get(name, [])
        if len(parents) > 1 or name in seen:
            raise ArmClassError(
                f"link {name} closes a loop (child of {', '.join(j.name for j in parents)}); jaxik solves open chains; "
                f"pinocchio has constraints for closed ones"
            )
        if not parents:
            raise ValueError(_not_above(above, base_link, tip_link, name))
        seen.add(name)
        found.append(parents[0])
        name = parents[0].parent
    return found[::-1]


def _not_above(above: dict[str, list[UrdfJoint]], base_link: str, tip_link: str, end: str) -> str:
    text = f"{base_link} is not above {tip_link}: going up from the tip ends at {end}"
    name, seen = base_link, set()
    while name in above and name not in seen:
        seen.add(name)
        name = above[name][0].parent
        if name == tip_link:
            return f"{text}; base and tip are swapped: the base is {tip_link}, the tip {base_link}"
    return text


def _check_joint(joint: UrdfJoint) -> None:
    if joint.type not in ("fixed", "revolute", "continuous"):
        raise ArmClassError(
            f"joint {joint.name or joint.child} in the chain is {joint.type[:40] or 'without a type'}; only revolute, "
            f"continuous and fixed joints can be: choose base and tip so that it lies outside, or use pink"
        )
    if joint.mimics is not None:
        raise ArmClassError(f"joint {joint.name} in the chain mimics {joint.mimics}, so it is not free")
    if not joint.name and joint.type != "fixed":
        raise ArmClassError(f"the joint above {joint.child}, on line {joint.element.line}, has no name; give it one")


def _unknown_link(role: str, name: str, links: Sequence[str]) -> str:
    close = difflib.get_close_matches(name, links, n=3)
    hint = f"; did you mean {' or '.join(close)}?" if close else ";"
    shown = ", ".join(links[:40]) + (f" and {len(links) - 40} more" if len(links) > 40 else "")
    return f"no link {name} ({role}){hint} Its links are: {shown}"
