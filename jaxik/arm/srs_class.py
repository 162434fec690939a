"""The conditions of the S-R-S class, checked in float64, and the exact member nearest to an arm.

The closed form assumes right angles and common points that hold to rounding. A description typed or printed with six
digits holds them to 1e-6, so an arm within a stated tolerance is replaced by the nearest exact member.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from jaxik.errors import ArmClassError

UNIT_TOLERANCE = 1e-6
"""Deviation from unit length accepted in axes and rotations: six printed digits; anything more is a mistake."""

_PARALLEL = 0.1
"""Sine of the angle between axes below which they are called parallel."""

_SMALL = 0.02
"""Largest deviation that may be play or rounding: a degree, or 2 cm on an arm of a meter."""

SHORTEST_LINK = 1e-6
"""Least distance of shoulder and wrist from the elbow axis, relative to the arm; below it the elbow moves nothing."""


class ArmGeometry(NamedTuple):
    """Geometry of an arm as float64 NumPy arrays.

    Attributes:
        axes: Unit joint axes, ``(joint, 3)``.
        shoulder: Point where axes 1-3 meet, ``(3,)`` [m].
        elbow: Point on axis 4 nearest to the shoulder, ``(3,)`` [m].
        wrist: Point where axes 5-7 meet, ``(3,)`` [m].
        tool_position: Tool point, ``(3,)`` [m].
        tool_rotation: Tool frame, ``(3, 3)``.
    """

    axes: np.ndarray
    shoulder: np.ndarray
    elbow: np.ndarray
    wrist: np.ndarray
    tool_position: np.ndarray
    tool_rotation: np.ndarray

    @property
    def kinematic_class(self) -> str:
        """Name of the class."""
        return "S-R-S"

    @property
    def stations(self) -> tuple[np.ndarray, ...]:
        """Points from base to tip, the tool point last, as :attr:`jaxik.Arm.stations` [m]."""
        return self[1:5]

    @property
    def station_of_joint(self) -> tuple[int, ...]:
        """Index of the station on each joint's axis."""
        return (0, 0, 0, 1, 2, 2, 2)[: len(self.axes)]

    @property
    def length(self) -> float:
        """Length from shoulder over elbow and wrist to the tool [m]."""
        return float(sum(np.linalg.norm(b - a) for a, b in pairwise(self.stations)))


class Failure(NamedTuple):
    """A condition of the class that an arm misses.

    Attributes:
        text: Part of a sentence, with ``{0}`` to ``{6}`` in the place of the axes.
        miss: Tolerance that would accept it; infinite for none.
    """

    text: str
    miss: float


def exact_member(
    given: ArmGeometry,
    tolerance: float,
    already: Sequence[Failure] = (),
    *,
    names: Sequence[str] = (),
    adjustable: bool = True,
) -> ArmGeometry:
    """Return the nearest exact member of the class.

    Axes 2 and 6 stay, axes 1, 3, 5 and 7 are made perpendicular to them; the elbow point slides along axis 4 to the
    point nearest to the shoulder; with six joints the tool's z axis is made perpendicular to axis 6 and the tool point
    is moved onto it.

    Args:
        given: The arm as described, axes of length 1 to ``UNIT_TOLERANCE``.
        tolerance: Largest deviation to repair: angles [rad], lengths relative to the arm's.
        already: Failed conditions that the caller found, reported together with those found here.
        names: Names of the joints for the messages; numbers without them.
        adjustable: The caller's user can pass a larger tolerance, which the message then mentions for small deviations.

    Returns:
        The exact member; an exact ``given`` comes back unchanged up to rounding.

    Raises:
        ArmClassError: If a condition fails by more than the tolerance; the message names every one that fails.
    """
    n_joints = len(given.axes)
    if n_joints not in (6, 7):
        raise ArmClassError(
            f"the arm has {n_joints} joint axes; jaxik solves arms with 7, or with 6 and the tool's roll free"
        )
    axes = unit_vectors(given.axes, "axis")
    rotation = rotation_matrix(given.tool_rotation)
    pairs = [(i, j) for i, j in ((0, 1), (1, 2), (4, 5), (5, 6)) if j < n_joints]
    failures = [*already, *(failure for i, j in pairs if (failure := angle_failure(axes, i, j, tolerance)))]
    for middle, outer in ((1, (0, 2)), (5, (4, 6))):
        for i in outer:
            if i < n_joints:
                axes[i] = unit(across(axes[i], axes[middle]))

    elbow = given.elbow + axes[3] * (axes[3] @ (given.shoulder - given.elbow))
    scale = given._replace(elbow=elbow).length
    for point, name in ((given.shoulder, "shoulder"), (given.wrist, "wrist")):
        distance = float(np.linalg.norm(across(point - elbow, axes[3])))
        if not distance > SHORTEST_LINK * scale:
            text = (
                f"the {name} is {mm(distance)} from axis {{3}} (needs more than {mm(SHORTEST_LINK * scale)}), so the "
                f"elbow cannot change its distance"
            )
            failures.append(Failure(text, np.inf))
    tool = given.tool_position
    if n_joints == 6:
        failures += _hand_failures(axes[5], given.wrist, tool, rotation[:, 2], tolerance, scale)
        direction = unit(across(rotation[:, 2], axes[5]))
        rotation = _minimal_rotation(rotation[:, 2], direction) @ rotation
        tool = given.wrist + direction * (direction @ (tool - given.wrist))
    if failures:
        raise ArmClassError(_refusal(failures, n_joints, names, adjustable))
    return ArmGeometry(axes, given.shoulder, elbow, given.wrist, tool, rotation)


def common_point(axes: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, list[tuple[float, str]]]:
    """Return the point nearest to two or three axes, and the distances by which they miss a common point.

    The gaps between neighboring axes, and between their feet on the middle one, do not depend on the joint angles.

    Args:
        axes: Unit axes, ``(2 or 3, 3)``, the second across the others.
        points: A point on each, same shape [m].

    Returns:
        Point ``(3,)`` [m], and every gap [m] with words for it that have ``{0}``, ``{1}``, ``{2}`` for the axes.
    """
    normal_parts = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    nearest = np.linalg.lstsq(normal_parts.sum(0), (normal_parts @ points[:, :, None]).sum(0)[:, 0])[0]
    gaps, feet = [], []
    for i in range(len(axes)):
        if i == 1:
            continue
        normal = np.cross(axes[i], axes[1])
        if np.linalg.norm(normal) < _PARALLEL:  # refused for the angle, and the gap would be all rounding
            continue
        normal = unit(normal)
        apart = points[1] - points[i]
        gaps.append((abs(float(normal @ apart)), f"axes {{{min(i, 1)}}} and {{{max(i, 1)}}} pass each other at"))
        feet.append(float(np.cross(axes[i], normal) @ apart) / float(np.cross(axes[i], normal) @ axes[1]))
    if len(feet) == 2:
        gaps.append((abs(feet[0] - feet[1]), "axes {0} and {2} meet axis {1} in two points apart by"))
    return nearest, gaps


def unit_vectors(vectors: np.ndarray, name: str) -> np.ndarray:
    """Normalize rows, or raise ArmClassError if one is further than ``UNIT_TOLERANCE`` from unit length."""
    lengths = np.linalg.norm(vectors, axis=-1)
    for i, length in enumerate(lengths):
        if not abs(length - 1.0) <= UNIT_TOLERANCE:
            raise ArmClassError(f"{name} {i + 1} has length {length:.9g} instead of 1 (tolerance {UNIT_TOLERANCE:g})")
    return vectors / lengths[:, None]


def angle_between(a: np.ndarray, b: np.ndarray) -> float:
    """Return the angle between two vectors [rad], accurate near 0 and π."""
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def mm(length: float) -> str:
    """Format a length in millimeters."""
    return f"{1e3 * length:.6g} mm"


def degrees(angle: float) -> str:
    """Format an angle in degrees."""
    return f"{np.degrees(angle):.6g}°"


def _refusal(failures: Sequence[Failure], n_joints: int, names: Sequence[str], adjustable: bool) -> str:
    """Return the sentence that names every condition missed, and the tolerance that would accept small ones."""
    axes = [f"{i + 1} ({names[i]})" if names else f"{i + 1}" for i in range(n_joints)]
    text = "not an S-R-S arm: " + "; ".join(failure.text.format(*axes) for failure in failures)
    worst = max(failure.miss for failure in failures)
    if not adjustable or not worst <= _SMALL:
        return text
    return f"{text}; if this is play or rounding in the description, tolerance={_rounded_up(1.05 * worst)} accepts it"


def _rounded_up(value: float) -> str:
    """Two digits, not less than the value."""
    unit = 10.0 ** (np.floor(np.log10(value)) - 1)
    return f"{np.ceil(value / unit) * unit:.2g}"


def angle_failure(axes: np.ndarray, i: int, j: int, tolerance: float) -> Failure | None:
    """Return the failure of two axes that are not perpendicular, None if they are."""
    angle = angle_between(axes[i], axes[j])
    off = abs(angle - np.pi / 2)
    if off <= tolerance:
        return None
    if np.sin(angle) < _PARALLEL:
        aside = "" if np.sin(angle) < UNIT_TOLERANCE else f" up to {degrees(np.pi / 2 - off)}"
        return Failure(f"axes {{{i}}} and {{{j}}} are parallel{aside}, where a right angle is needed", off)
    return Failure(
        f"axes {{{i}}} and {{{j}}} are {degrees(off)} off the right angle (tolerance {degrees(tolerance)})", off
    )


def _hand_failures(
    axis: np.ndarray, wrist: np.ndarray, tool: np.ndarray, direction: np.ndarray, tolerance: float, scale: float
) -> list[Failure]:
    """Return the failures of a six-joint hand that is not across axis 6, or whose tool point is off its line."""
    failures = []
    off = abs(angle_between(axis, direction) - np.pi / 2)
    if off > tolerance:
        text = (
            f"axis {{5}} and the tool's z axis are {degrees(off)} off the right angle (tolerance {degrees(tolerance)})"
        )
        if np.pi / 2 - off < _PARALLEL:
            text = "axis {5} and the tool's z axis are parallel, where a right angle is needed"
        failures.append(Failure(text, off))
    aside = float(np.linalg.norm(across(tool - wrist, direction)))
    if aside > tolerance * scale:
        text = (
            f"the tool point is {mm(aside)} off the line through the wrist along the tool's z axis (tolerance "
            f"{mm(tolerance * scale)}), which six joints need"
        )
        failures.append(Failure(text, aside / scale if scale > 0 else np.inf))
    return failures


def rotation_matrix(matrix: np.ndarray) -> np.ndarray:
    """Return the nearest rotation matrix, or raise ArmClassError if it is further than ``UNIT_TOLERANCE``."""
    off = float(np.abs(matrix.T @ matrix - np.eye(3)).max())
    if not off <= 2 * UNIT_TOLERANCE or np.linalg.det(matrix) < 0:
        raise ArmClassError(
            f"tool_rotation is no rotation matrix: its columns miss orthonormality by {off:.3g} (tolerance "
            f"{2 * UNIT_TOLERANCE:g}) and its determinant is {np.linalg.det(matrix):.6g}; jaxik.nearest_rotation "
            f"projects it"
        )
    # Newton's iteration for the polar factor: quadratic, and leaves an exact rotation as it is to the bit.
    for _ in range(2):
        matrix = matrix @ (3 * np.eye(3) - matrix.T @ matrix) / 2
    return matrix


def _minimal_rotation(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the smallest rotation that carries unit vector a to unit vector b."""
    k = np.cross(a, b)
    hat = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    return np.eye(3) + hat + hat @ hat / (1 + a @ b)


def across(v: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Return the part of a vector across a unit axis."""
    return v - axis * (axis @ v)


def unit(v: np.ndarray) -> np.ndarray:
    """Normalize a vector; one of zeros, or whose length underflows, gives no number, for the caller to refuse."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return v / np.linalg.norm(v)
