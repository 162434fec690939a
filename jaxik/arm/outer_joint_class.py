"""The conditions of the outer-joint classes, checked in float64, and the exact member nearest to a chain.

Needed are a spherical joint of three perpendicular axes at one end, and at the other two axes that meet, at any angle;
the elbow's and the outer joint's axes are free. What is free is taken as it is; the rest is rounded as for S-R-S arms.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from jaxik.arm.outer_joint_arm import OUTER_JOINT_CLASSES
from jaxik.arm.srs_class import (
    SHORTEST_LINK,
    Failure,
    across,
    angle_between,
    angle_failure,
    common_point,
    mm,
    rotation_matrix,
    unit,
    unit_vectors,
)

_PARALLEL = 0.05
"""Sine of the angle between the two meeting axes below which their common point is taken for undetermined."""


class OuterJointGeometry(NamedTuple):
    """Geometry of an arm with an outer joint as float64 NumPy arrays.

    Attributes:
        axes: Unit joint axes, ``(7, 3)``.
        shoulder: Point where axes 1-3, or 2 and 3, meet, ``(3,)`` [m].
        elbow: Point on axis 4 nearest to the shoulder, ``(3,)`` [m].
        wrist: Point where axes 5-7, or 5 and 6, meet, ``(3,)`` [m].
        tool_position: Tool point, ``(3,)`` [m].
        tool_rotation: Tool frame, ``(3, 3)``.
        outer: Point on the outer joint's axis nearest to the wrist or shoulder, ``(3,)`` [m].
        outer_joint: Index of the outer joint, 6 or 0.
    """

    axes: np.ndarray
    shoulder: np.ndarray
    elbow: np.ndarray
    wrist: np.ndarray
    tool_position: np.ndarray
    tool_rotation: np.ndarray
    outer: np.ndarray
    outer_joint: int

    @property
    def kinematic_class(self) -> str:
        """Name of the class."""
        return OUTER_JOINT_CLASSES[self.outer_joint]

    @property
    def stations(self) -> tuple[np.ndarray, ...]:
        """Points from base to tip, the tool point last, as :attr:`jaxik.Arm.stations` [m]."""
        inner = self.shoulder, self.elbow, self.wrist
        return (*(inner if self.outer_joint else (self.outer, *inner)), *self._beyond())

    @property
    def station_of_joint(self) -> tuple[int, ...]:
        """Index of the station on each joint's axis."""
        return (0, 0, 0, 1, 2, 2, 3) if self.outer_joint else (0, 1, 1, 2, 3, 3, 3)

    @property
    def length(self) -> float:
        """Length from station to station up to the tool point [m]."""
        return float(sum(np.linalg.norm(b - a) for a, b in pairwise(self.stations)))

    def _beyond(self) -> tuple[np.ndarray, ...]:
        return (self.outer, self.tool_position) if self.outer_joint else (self.tool_position,)


def outer_joint_member(
    axes: np.ndarray, points: np.ndarray, tool: np.ndarray, outer_joint: int, tolerance: float
) -> tuple[OuterJointGeometry, list[Failure]]:
    """Return the nearest exact member of an outer-joint class, and the conditions that the chain misses.

    The middle axis of the spherical joint stays, its neighbors are made perpendicular to it.

    Args:
        axes: Unit joint axes, ``(7, 3)``.
        points: A point on each, ``(7, 3)`` [m].
        tool: Tool pose at zero joint angles, ``(4, 4)``.
        outer_joint: Index of the outer joint, 6 or 0.
        tolerance: Largest deviation to repair: angles [rad], lengths relative to the arm's.
    """
    axes = unit_vectors(axes, "axis")
    spherical, pair = ((0, 1, 2), (4, 5)) if outer_joint else ((4, 5, 6), (1, 2))
    failures = _angle_failures(axes, spherical, pair, tolerance)
    center, gaps = common_point(axes[list(spherical)], points[list(spherical)])
    meeting, pair_gaps = common_point(axes[list(pair)], points[list(pair)])
    shoulder, wrist = (center, meeting) if outer_joint else (meeting, center)
    elbow = points[3] + axes[3] * (axes[3] @ (shoulder - points[3]))
    outer = points[outer_joint] + axes[outer_joint] * (axes[outer_joint] @ (meeting - points[outer_joint]))
    exact = axes.copy()
    for i in (spherical[0], spherical[2]):
        exact[i] = unit(across(axes[i], axes[spherical[1]]))
    geometry = OuterJointGeometry(
        exact, shoulder, elbow, wrist, tool[:3, 3], rotation_matrix(tool[:3, :3]), outer, outer_joint
    )
    allowed = tolerance * geometry.length
    for members, found in ((spherical, gaps), (pair, pair_gaps)):
        numbered = [f"{{{i}}}" for i in members]
        for gap, words in found:
            if gap > allowed:
                failures.append(Failure(f"{words.format(*numbered)} {mm(gap)}", gap / geometry.length))
    for point, name in ((shoulder, "shoulder"), (wrist, "wrist")):
        distance = float(np.linalg.norm(across(point - elbow, axes[3])))
        if not distance > SHORTEST_LINK * geometry.length:
            failures.append(Failure(f"the {name} is {mm(distance)} from axis {{3}}", np.inf))
    return geometry, failures


def _angle_failures(axes: np.ndarray, spherical: Sequence[int], pair: Sequence[int], tolerance: float) -> list[Failure]:
    sides = [tuple(sorted((spherical[1], i))) for i in (spherical[0], spherical[2])]
    failures = [failure for i, j in sides if (failure := angle_failure(axes, i, j, tolerance))]
    between = np.sin(angle_between(axes[pair[0]], axes[pair[1]]))
    if between < _PARALLEL:
        failures.append(Failure(f"axes {{{pair[0]}}} and {{{pair[1]}}} are parallel", np.inf))
    return failures
