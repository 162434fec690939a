"""The arms in a URDF file: every run of seven or six turning joints that is one, and why the others are not."""

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from jaxik.arm.arm_classes import refined_deviation
from jaxik.arm.refined_class import RefinedGeometry
from jaxik.arm.urdf_chain import chain_between, chain_geometry, children_of, parents_of
from jaxik.arm.urdf_file import UrdfJoint, UrdfRobot, read_robot

_TOOL_NAMES = ("tcp", "tool", "tip", "ee", "end_effector", "grasp", "hand", "palm", "flange", "gripper")
"""Parts of the names of links that are chosen as tip, the best first."""

_FINGER_NAMES = ("finger", "thumb", "knuckle")

_MANY = 20
"""Tips tried per six-joint chain: it depends on the tip whether they are an arm."""


@dataclass(frozen=True)
class UrdfArm:
    """A chain of a URDF file, as :func:`jaxik.load_urdf` takes it.

    Attributes:
        base_link: Its base link.
        tip_link: Its tip link.
        joint_names: Its turning joints, 7 or 6.
        problem: Conditions of the classes that it misses, as a sentence; empty for an arm that can be loaded.
        kinematic_class: Class of the arm, as :attr:`jaxik.Arm.kinematic_class`; empty for none.
        deviation: Bound on the distance of the tool from that of the nearest arm with a closed form [m]; 0 for an arm
            that has one itself.
    """

    base_link: str
    tip_link: str
    joint_names: tuple[str, ...]
    problem: str = ""
    kinematic_class: str = ""
    deviation: float = 0.0

    @property
    def ok(self) -> bool:
        """True for an arm that can be loaded."""
        return not self.problem


def list_arms(file: str | os.PathLike[str], *, tolerance: float = 1e-5) -> tuple[UrdfArm, ...]:
    """List the arms in a URDF file.

    Args:
        file: File name.
        tolerance: As for :func:`jaxik.load_urdf`.

    Returns:
        The arms; after them, limbs that have enough joints but are no arms, with what is missing.

    Raises:
        FileFormatError: The file is not well-formed.
        OSError: The file cannot be opened.
    """
    return arms_of(read_robot(Path(file)), tolerance)


def arms_of(robot: UrdfRobot, tolerance: float) -> tuple[UrdfArm, ...]:
    """Return the arms of a robot, and limbs that are none (see :func:`list_arms`)."""
    runs = list(_runs(robot))
    arms: list[UrdfArm] = []
    for count in (7, 6):
        taken = [set(arm.joint_names) for arm in arms]
        for run in runs:
            names = {joint.name for joint in run[-count:]}
            if len(run) >= count and not any(names <= other for other in taken):
                found = _judged(robot, run[-count:], tolerance)
                arms += [found] if found.ok and found.deviation == 0.0 else []
    arms += _refined(robot, [run[-7:] for run in runs if len(run) == 7], arms, tolerance)
    used = {name for arm in arms for name in arm.joint_names}
    inner = {joint.name for run in runs for joint in run[:-1]}
    limbs = [run for run in runs if len(run) >= 6 and run[-1].name not in inner]
    others = [_judged(robot, run[-7:], tolerance) for run in limbs if not used & {joint.name for joint in run[-7:]}]
    return (*arms, *others)


def _refined(robot: UrdfRobot, runs: list[list[UrdfJoint]], arms: list[UrdfArm], tolerance: float) -> list[UrdfArm]:
    """Return the arms solved by refinement that share no joint with the others.

    Any seven joints are such an arm. Of those that share a joint, one that ends in a tool is chosen before one that
    leads through a torso to an elbow, then the one nearest to a class.
    """
    found = [_judged(robot, run, tolerance) for run in runs]
    chosen: list[UrdfArm] = []
    for arm in sorted((arm for arm in found if arm.ok), key=lambda arm: (not _is_tool(arm.tip_link), arm.deviation)):
        used = {name for other in (*arms, *chosen) for name in other.joint_names}
        chosen += [] if used & set(arm.joint_names) else [arm]
    order = [arm.joint_names for arm in found]
    return sorted(chosen, key=lambda arm: order.index(arm.joint_names))


def hint(robot: UrdfRobot, joint_names: list[str], file: str, tolerance: float) -> str:
    """Return the end of a message about a chain that is no arm: an arm that shares its joints, or how to list others.

    Args:
        robot: The robot.
        joint_names: Joints of the chain.
        file: Name of the file.
        tolerance: As for :func:`jaxik.load_urdf`.
    """
    arms = [arm for arm in arms_of(robot, tolerance) if arm.ok]
    near = [arm for arm in arms if set(arm.joint_names) & set(joint_names)]
    if not near:
        return f"; `jaxik info {file}` lists the arms in the file" if arms else ""
    best = max(near, key=lambda arm: (len(set(arm.joint_names) & set(joint_names)), len(arm.joint_names)))
    return f"; from {best.base_link} to {best.tip_link} there is an arm of {len(best.joint_names)} joints"


def _runs(robot: UrdfRobot) -> Iterator[list[UrdfJoint]]:
    """Iterate over the turning joints; each with up to seven in a row, of which it is the last."""
    above = parents_of(robot)
    for last in robot.joints:
        run, joint, seen = [], last, set()
        while len(run) < 7 and joint.name and joint.child not in seen and len(above.get(joint.child, [])) == 1:
            seen.add(joint.child)
            if joint.turns:
                run.insert(0, joint)
            elif joint.type != "fixed":
                break
            parents = above.get(joint.parent, [])
            if len(parents) != 1:
                break
            joint = parents[0]
        if run and run[-1] is last:
            yield run


def _judged(robot: UrdfRobot, run: list[UrdfJoint], tolerance: float) -> UrdfArm:
    """Return the chain of these joints with its best tip."""
    names = tuple(joint.name for joint in run)
    first: UrdfArm | None = None
    for tip in _tips(robot, run[-1].child)[: _MANY if len(run) == 6 else 1]:
        try:
            geometry = chain_geometry(chain_between(robot, run[0].parent, tip), tolerance)
            away = refined_deviation(geometry).position if isinstance(geometry, RefinedGeometry) else 0.0
            return UrdfArm(run[0].parent, tip, names, kinematic_class=geometry.kinematic_class, deviation=away)
        except ValueError as error:
            first = first or UrdfArm(run[0].parent, tip, names, str(error))
    assert first is not None
    return first


def _tips(robot: UrdfRobot, link: str) -> list[str]:
    """Return the links that move with a link, itself included; likely tools first."""
    below, found, todo = children_of(robot), [], [link]
    while todo:
        name = todo.pop(0)
        if name in robot.links and name not in found:
            found.append(name)
            todo += [joint.child for joint in below.get(name, []) if joint.type == "fixed"]
    return sorted(found, key=_likeness) or [link]


def _is_tool(name: str) -> bool:
    return _likeness(name) < len(_TOOL_NAMES) and not any(part in name.lower() for part in _FINGER_NAMES)


def _likeness(name: str) -> int:
    """Return how unlikely a link is the tool."""
    words = re.split(r"[^a-z]+", name.lower())
    for rank, part in enumerate(_TOOL_NAMES):
        if part in words or (len(part) > 3 and part in name.lower()):
            return rank
    return len(_TOOL_NAMES)
