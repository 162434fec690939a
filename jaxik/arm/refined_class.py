"""Chains of no class: the member of an outer-joint class that is near enough to give seeds."""

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from jaxik.arm.outer_joint_arm import OUTER_JOINT_CLASSES
from jaxik.arm.outer_joint_class import OuterJointGeometry, outer_joint_member
from jaxik.arm.srs_class import Failure, rotation_matrix, unit_vectors

FARTHEST = 0.6
"""Largest deviation from the nearest member [rad, arm lengths] of a chain that is refined: axes 34° off a right angle.
The farthest of 51 real arms is off by 0.2; beyond, most seeds lead nowhere."""

_CLEARLY_NEARER = 0.7
"""Ratio of deviations below which joint 1 is held in the place of joint 7. With deviations as close as that, holding
joint 7 recovers as many solutions or more on every real arm measured."""


class RefinedGeometry(NamedTuple):
    """Geometry of an arm that is solved by refinement, as float64 NumPy arrays.

    Attributes:
        axes: Unit joint axes, ``(7, 3)``.
        shoulder: Shoulder of the nearest member, ``(3,)`` [m].
        elbow: Its elbow, ``(3,)`` [m].
        wrist: Its wrist, ``(3,)`` [m].
        tool_position: Tool point, ``(3,)`` [m].
        tool_rotation: Tool frame, ``(3, 3)``.
        points: Point on each axis, ``(7, 3)`` [m].
        member_axes: Unit joint axes of the nearest member, ``(7, 3)``.
        outer: Point on the outer joint's axis of the nearest member, ``(3,)`` [m].
        outer_joint: Index of the joint that is held, 6 or 0.
    """

    axes: np.ndarray
    shoulder: np.ndarray
    elbow: np.ndarray
    wrist: np.ndarray
    tool_position: np.ndarray
    tool_rotation: np.ndarray
    points: np.ndarray
    member_axes: np.ndarray
    outer: np.ndarray
    outer_joint: int

    @property
    def kinematic_class(self) -> str:
        """Name of the class."""
        return f"near {OUTER_JOINT_CLASSES[self.outer_joint]}"

    @property
    def stations(self) -> tuple[np.ndarray, ...]:
        """Points from base to tip, the tool point last, as :attr:`jaxik.Arm.stations` [m]."""
        return *self.points, self.tool_position

    @property
    def station_of_joint(self) -> tuple[int, ...]:
        """Index of the station on each joint's axis."""
        return tuple(range(7))

    @property
    def length(self) -> float:
        """Length from station to station up to the tool point [m]."""
        return float(sum(np.linalg.norm(b - a) for a, b in pairwise(self.stations)))

    @property
    def member(self) -> OuterJointGeometry:
        """The nearest member of a class."""
        shared: dict[str, Any] = {name: getattr(self, name) for name in OuterJointGeometry._fields}
        shared["axes"] = self.member_axes
        return OuterJointGeometry(**shared)


def refined_geometries(
    axes: np.ndarray, points: np.ndarray, tool: np.ndarray
) -> tuple[list[RefinedGeometry], list[Failure]]:
    """Return the chain with each member that is near enough, the better one first; and what is missed by none.

    Args:
        axes: Unit joint axes, ``(7, 3)``.
        points: A point on each, ``(7, 3)`` [m].
        tool: Tool pose at zero joint angles, ``(4, 4)``.
    """
    axes = unit_vectors(axes, "axis")
    near: list[tuple[float, RefinedGeometry]] = []
    missed: list[Failure] = []
    for outer_joint, ratio in ((6, _CLEARLY_NEARER), (0, 1.0)):
        member, failures = outer_joint_member(axes.copy(), points, tool, outer_joint, 0.0)
        far = [failure for failure in failures if not failure.miss <= FARTHEST]
        missed += far
        if not far:
            near.append((ratio * _distance(axes, points, member), _refined(axes, points, tool, member)))
    return [geometry for _, geometry in sorted(near, key=lambda each: each[0])], missed


def _distance(axes: np.ndarray, points: np.ndarray, member: OuterJointGeometry) -> float:
    """Sum of the distances of the member's axes from the chain's, in arm lengths and radians."""
    total = 0.0
    for i, station in enumerate(member.station_of_joint):
        apart = member.stations[station] - points[i]
        aside = np.linalg.norm(apart - axes[i] * (axes[i] @ apart))
        total += float(aside) / member.length + float(np.linalg.norm(np.cross(axes[i], member.axes[i])))
    return total


def _refined(axes: np.ndarray, points: np.ndarray, tool: np.ndarray, member: OuterJointGeometry) -> RefinedGeometry:
    on = np.stack([member.stations[station] for station in member.station_of_joint])
    nearest = points + axes * np.sum(axes * (on - points), axis=1)[:, None]
    return RefinedGeometry(
        axes,
        member.shoulder,
        member.elbow,
        member.wrist,
        tool[:3, 3],
        rotation_matrix(tool[:3, :3]),
        nearest,
        member.axes,
        member.outer,
        member.outer_joint,
    )
