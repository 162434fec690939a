"""The classes of arms: the exact member of a class that a chain of joints is, or why it is none."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from jaxik.arm.outer_joint_class import OuterJointGeometry, outer_joint_member
from jaxik.arm.refined_arm import RefinedArm
from jaxik.arm.refined_class import RefinedGeometry, refined_geometries
from jaxik.arm.srs_class import ArmGeometry, Failure, across, angle_between, common_point, exact_member, mm
from jaxik.errors import ArmClassError

Geometry = ArmGeometry | OuterJointGeometry | RefinedGeometry

OTHER_LIBRARIES = "for fewer joints, use EAIK (closed form, up to 6) or pink (numerical, any chain)"
"""Advice for chains that are not solved here, as part of a sentence."""


class Deviation(NamedTuple):
    """Largest difference of two descriptions of an arm over all postures.

    Attributes:
        position: Distance of the tool points [m].
        rotation: Angle between the tool frames [rad].
    """

    position: float
    rotation: float


def deviation_bound(axes: np.ndarray, points: np.ndarray, tool: np.ndarray, member: Geometry) -> Deviation:
    """Return a bound, over all postures, on what replacing a chain by a member of the class changes at the tool.

    A joint whose axis is turned by d and moved sideways by e displaces a point at distance r by at most 2 d r + 2 e,
    and the joints before it only carry that displacement along; so the contributions add.

    Args:
        axes: The chain's unit joint axes, ``(joint, 3)``.
        points: A point on each axis, ``(joint, 3)`` [m].
        tool: Tool pose at zero joint angles, ``(4, 4)``.
        member: The member that replaces the chain.
    """
    segments = member.stations
    tail = np.cumsum([np.linalg.norm(b - a) for a, b in pairwise(segments)][::-1])[::-1]
    position = float(np.linalg.norm(tool[:3, 3] - member.tool_position))
    rotation = float(np.linalg.norm(tool[:3, :3] - member.tool_rotation))
    for i, (axis, point) in enumerate(zip(axes, points, strict=True)):
        group = member.station_of_joint[i]
        turned = angle_between(axis, member.axes[i])
        moved = float(np.linalg.norm(across(segments[group] - point, axis)))
        rotation += 2 * turned
        position += 2 * turned * float(tail[group]) + 2 * moved
    return Deviation(position, rotation)


def arm_geometry(
    axes: np.ndarray, points: np.ndarray, tool: np.ndarray, tolerance: float, *, names: Sequence[str] = ()
) -> Geometry:
    """Return the exact member of a class that a chain is to a tolerance, else the chain as it is, to be refined.

    Args:
        axes: Unit joint axes, ``(6 or 7, 3)``.
        points: A point on each, same shape [m].
        tool: Tool pose at zero joint angles, ``(4, 4)``.
        tolerance: Largest deviation to repair: angles [rad], lengths relative to the arm's.
        names: Names of the joints for the messages; numbers without them.

    Raises:
        ArmClassError: It has neither 7 joints nor is it a member with 6, or is far from every class; the message names
            the conditions missed.
    """
    try:
        return exact_arm(axes, points, tool, tolerance, names=names)
    except ArmClassError as error:
        if len(axes) != 7:
            raise
        near, missed = refined_geometries(axes, points, tool)
        if near:
            return near[0]
        reasons = "; ".join(dict.fromkeys(failure.text.format(*_numbered(names)) for failure in missed))
        raise ArmClassError(f"{error}; and too far from both for refinement: {reasons}") from None


def refined_deviation(geometry: RefinedGeometry) -> Deviation:
    """Return a bound on the difference of the nearest member, which gives the seeds, from the chain."""
    tool = np.eye(4)
    tool[:3, :3], tool[:3, 3] = geometry.tool_rotation, geometry.tool_position
    return deviation_bound(geometry.axes, geometry.points, tool, geometry.member)


def deviation_of(arm: RefinedArm) -> Deviation:
    """Return the bound of :func:`refined_deviation` for an arm; outside ``jit``."""
    fields = {name: getattr(arm, name) for name in RefinedGeometry._fields}
    arrays: dict[str, Any] = {
        name: value if name == "outer_joint" else np.asarray(value, float) for name, value in fields.items()
    }
    return refined_deviation(RefinedGeometry(**arrays))


def exact_arm(
    axes: np.ndarray, points: np.ndarray, tool: np.ndarray, tolerance: float, *, names: Sequence[str] = ()
) -> Geometry:
    """Return the nearest exact member of the first class that takes a chain: S-R-S, U-R wrist, R-U shoulder.

    Args:
        axes: Unit joint axes, ``(6 or 7, 3)``.
        points: A point on each, same shape [m].
        tool: Tool pose at zero joint angles, ``(4, 4)``.
        tolerance: Largest deviation to repair: angles [rad], lengths relative to the arm's.
        names: Names of the joints for the messages; numbers without them.

    Raises:
        ArmClassError: No class takes it; the message names the conditions of the S-R-S class that it misses, and those
            of the nearer outer-joint class.
    """
    if len(axes) not in (6, 7):
        raise ArmClassError(
            f"the arm has {len(axes)} joint axes; jaxik solves arms with 7, or with 6 and the tool's roll free; "
            f"{OTHER_LIBRARIES}"
        )
    try:
        return _srs_arm(axes, points, tool, tolerance, names)
    except ArmClassError as error:
        if len(axes) != 7:
            raise
        refused = str(error)
    missed = []
    for outer_joint in (6, 0):
        geometry, failures = outer_joint_member(axes, points, tool, outer_joint, tolerance)
        if not failures:
            return geometry
        missed.append((max(failure.miss for failure in failures), outer_joint, failures))
    _, outer_joint, failures = min(missed, key=lambda each: each[0])
    numbered = _numbered(names)
    reasons = "; ".join(failure.text.format(*numbered) for failure in failures)
    raise ArmClassError(f"{refused}; nor an arm with only joint {numbered[outer_joint]} offset: {reasons}")


def _numbered(names: Sequence[str]) -> list[str]:
    return [f"{i + 1} ({names[i]})" if names else f"{i + 1}" for i in range(7)]


def check_outer_joint(geometry: OuterJointGeometry, tolerance: float) -> None:
    """Raise ArmClassError unless a description with an outer joint is a member to a tolerance."""
    points = np.stack([geometry.stations[station] for station in geometry.station_of_joint])
    tool = np.eye(4)
    tool[:3, :3], tool[:3, 3] = geometry.tool_rotation, geometry.tool_position
    _, failures = outer_joint_member(geometry.axes, points, tool, geometry.outer_joint, tolerance)
    if failures:
        reasons = "; ".join(failure.text.format(*range(1, 8)) for failure in failures)
        raise ArmClassError(f"not a {geometry.kinematic_class} arm: {reasons}")


def _srs_arm(
    axes: np.ndarray, points: np.ndarray, tool: np.ndarray, tolerance: float, names: Sequence[str]
) -> ArmGeometry:
    shoulder, shoulder_gaps = common_point(axes[:3], points[:3])
    wrist, wrist_gaps = common_point(axes[4:], points[4:])
    elbow = points[3] + axes[3] * (axes[3] @ (shoulder - points[3]))
    given = ArmGeometry(axes, shoulder, elbow, wrist, tool[:3, 3], tool[:3, :3])
    allowed = tolerance * given.length
    failures = []
    for what, first, gaps in (("shoulder", 0, shoulder_gaps), ("wrist", 4, wrist_gaps)):
        numbered = [f"{{{first + i}}}" for i in range(3)]
        found = [(gap, f"{words.format(*numbered)} {mm(gap)}") for gap, words in gaps if gap > allowed]
        if found:
            text = f"the {what} axes do not meet: {' and '.join(words for _, words in found)} (tolerance {mm(allowed)})"
            worst = max(gap for gap, _ in found)
            failures.append(Failure(text, worst / given.length if given.length > 0 else np.inf))
    return exact_member(given, tolerance, failures, names=names)
