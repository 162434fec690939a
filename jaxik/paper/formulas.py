"""The paper's formulas as printed, errors included, and the corrected formula for each wrong one.

They use plain NumPy in float64 and share no code with the solver, so that each can check the other. Lengths are the
paper's unitless numbers; the base frame has its origin in the shoulder and its z axis points up. They take one posture
at a time, without batches or derivatives; applications use :func:`jaxik.solve_ik`. Equation numbers refer to the source
named in :mod:`jaxik.paper`.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

Vector = Float[np.ndarray, "3"]


def wrist_from_hand(tip: Vector, hand_length: float, wrist_angle: float, hand_angle: float) -> Vector:
    """Return the wrist, given the tip and two angles of the hand, eqs. (7)-(10).

    Args:
        tip: Tip of the hand, ``(3,)``.
        hand_length: Length from wrist to tip, eq. (3).
        wrist_angle: Angle of the hand from the vertical, eq. (1) [rad].
        hand_angle: Angle of the hand about the vertical, from the x axis, eq. (2) [rad].

    Returns:
        The wrist, ``(3,)``.
    """
    sine = math.sin(wrist_angle)
    direction = [sine * math.cos(hand_angle), sine * math.sin(hand_angle), math.cos(wrist_angle)]
    return tip + hand_length * np.array(direction)


class Circle(NamedTuple):
    """The circle of possible elbow positions, eqs. (18)-(36).

    Attributes:
        plane: Coefficients of x, y and z in the equation of its plane, and the right-hand side, eq. (19), ``(4,)``.
        v1: Vector from shoulder to wrist, doubled, eq. (20), ``(3,)``.
        a1: First axis in the plane, eq. (21), ``(3,)``; zero for a wrist vertically above or below the shoulder.
        b1: Second axis in the plane, a1 × v1, eq. (22), ``(3,)``.
        an1: a1 normalized, the direction of t = 0, eq. (25), ``(3,)``.
        bn1: b1 normalized, the direction of t = π/2, eq. (27), ``(3,)``.
        beta: Position of the center as a fraction of the vector from shoulder to wrist, eq. (31).
        center: Center, eq. (33), ``(3,)``.
        distance: Distance from shoulder to center, eq. (34).
        radius: Radius, eq. (35); NaN for a wrist out of reach, where the radicand is negative.
    """

    plane: Float[np.ndarray, "4"]
    v1: Vector
    a1: Vector
    b1: Vector
    an1: Vector
    bn1: Vector
    beta: float
    center: Vector
    distance: float
    radius: float

    def point(self, t: float) -> Vector:
        """Return the elbow at a point of the circle, eq. (37).

        Args:
            t: The paper's parameter, the swivel [rad].

        Returns:
            The elbow, ``(3,)``.
        """
        return self.center + self.radius * (math.cos(t) * self.an1 + math.sin(t) * self.bn1)


def elbow_circle(wrist: Vector, upper_arm: float, forearm: float) -> Circle:
    """Return the circle of possible elbow positions for a wrist, eqs. (18)-(36).

    Like the paper, it does not check for division by zero or roots of negative numbers, which give NaN.

    Args:
        wrist: The wrist, ``(3,)``.
        upper_arm: Length from shoulder to elbow, d1.
        forearm: Length from elbow to wrist, d2.

    Returns:
        The circle, with every intermediate result that the paper prints.
    """
    distance2 = float(wrist @ wrist)
    v1 = 2.0 * wrist
    a1 = np.array([-v1[1], v1[0], 0.0])
    b1 = np.cross(a1, v1)
    # The paper divides the equation of the plane, here 6x + 6y - 6z = 27, by three before printing it as (19).
    plane = np.append(v1, upper_arm**2 - forearm**2 + distance2) / 3.0
    beta = (upper_arm**2 - forearm**2 + distance2) / (2.0 * distance2)
    center = beta * wrist
    distance = float(np.linalg.norm(center))
    with np.errstate(invalid="ignore"):
        an1, bn1 = a1 / np.linalg.norm(a1), b1 / np.linalg.norm(b1)
        radius = float(np.sqrt(upper_arm**2 - distance**2))
    return Circle(plane, v1, a1, b1, an1, bn1, beta, center, distance, radius)


class ShoulderAngles(NamedTuple):
    """Direction of the upper arm in spherical coordinates.

    Attributes:
        from_vertical: Angle from the downward vertical [rad].
        azimuth: Angle about the vertical, from the x axis [rad].
    """

    from_vertical: float
    azimuth: float


class ArmPoints(NamedTuple):
    """Positions along the arm.

    Attributes:
        elbow: Elbow, ``(3,)``.
        wrist: Wrist, ``(3,)``.
        tip: Tip of the hand, ``(3,)``.
    """

    elbow: Vector
    wrist: Vector
    tip: Vector


def printed_shoulder_angles(elbow: Vector, upper_arm: float) -> ShoulderAngles:
    """Return the shoulder angles by arcsine and arccosine, eqs. (41)-(44).

    They are correct only for an elbow below the shoulder with y >= 0.

    Args:
        elbow: The elbow, ``(3,)``.
        upper_arm: Length from shoulder to elbow, d1.

    Returns:
        Angle from the downward vertical in [0, π/2] and azimuth in [0, π] [rad].
    """
    from_vertical = math.asin(math.sqrt(upper_arm**2 - elbow[2] ** 2) / upper_arm)
    return ShoulderAngles(from_vertical, math.acos(elbow[0] / math.hypot(elbow[0], elbow[1])))


def shoulder_angles(elbow: Vector) -> ShoulderAngles:
    """Return the shoulder angles, correct in every quadrant.

    Args:
        elbow: The elbow, ``(3,)``.

    Returns:
        Angle from the downward vertical in [0, π] and azimuth in (-π, π] [rad].
    """
    return ShoulderAngles(math.atan2(math.hypot(elbow[0], elbow[1]), -elbow[2]), math.atan2(elbow[1], elbow[0]))


def elbow_from_shoulder_angles(from_vertical: float, azimuth: float, upper_arm: float) -> Vector:
    """Return the elbow at given shoulder angles.

    Args:
        from_vertical: Angle from the downward vertical [rad].
        azimuth: Angle about the vertical, from the x axis [rad].
        upper_arm: Length from shoulder to elbow.

    Returns:
        The elbow, ``(3,)``.
    """
    sine = math.sin(from_vertical)
    return upper_arm * np.array([sine * math.cos(azimuth), sine * math.sin(azimuth), -math.cos(from_vertical)])


def line_plane_angle(direction: Vector, normal: Vector) -> float:
    """Return the angle between a line and a plane, eq. (75).

    Args:
        direction: Direction of the line, ``(3,)``.
        normal: Normal of the plane, ``(3,)``.

    Returns:
        The angle in [0, π/2] [rad].
    """
    return math.asin(abs(direction @ normal) / float(np.linalg.norm(direction) * np.linalg.norm(normal)))


def forearm_roll(elbow: Vector, wrist: Vector, tip: Vector) -> float:
    """Return the roll of the forearm: the dihedral angle from the arm plane to the hand plane.

    It replaces the paper's sum of 90 degrees and the line-plane angle α of eq. (78), to which it is related by
    sin α = abs(sin(roll) sin(flexion)).

    Args:
        elbow: The elbow, ``(3,)``.
        wrist: The wrist, ``(3,)``.
        tip: Tip of the hand, ``(3,)``.

    Returns:
        The angle in (-π, π] [rad]; zero for a hand that bends in the same sense as the elbow.
    """
    forearm, hand = _unit(wrist - elbow), tip - wrist
    normal = _unit(np.cross(elbow, forearm))
    return math.atan2(hand @ normal, hand @ np.cross(normal, forearm))


def interior_wrist_angle(elbow: Vector, wrist: Vector, tip: Vector) -> float:
    """Return the angle at the wrist between forearm and hand, with the signed cosine of eqs. (85)-(86).

    Eqs. (79) and (84) take the absolute value of the cosine, which would fold every obtuse angle.

    Args:
        elbow: The elbow, ``(3,)``.
        wrist: The wrist, ``(3,)``.
        tip: Tip of the hand, ``(3,)``.

    Returns:
        The angle in [0, π] [rad]; π for a hand in line with the forearm.
    """
    return math.acos(_unit(elbow - wrist) @ _unit(tip - wrist))


def chain(q: Float[np.ndarray, "6"], upper_arm: float, forearm: float, hand: float) -> ArmPoints:
    """Return elbow, wrist and tip of the chain Rz(q1) Ry(q2) Rz(q3) Ry(q4) Rz(q5) Ry(q6) with links along z.

    This forward kinematics is independent of the library's.

    Args:
        q: Joint angles, ``(6,)`` [rad].
        upper_arm: Length from shoulder to elbow.
        forearm: Length from elbow to wrist.
        hand: Length from wrist to tip.

    Returns:
        The three points.
    """
    z = np.array([0.0, 0.0, 1.0])
    to_elbow = _rz(q[0]) @ _ry(q[1]) @ _rz(q[2])
    to_wrist = to_elbow @ _ry(q[3])
    elbow = to_elbow @ (upper_arm * z)
    wrist = elbow + to_wrist @ (forearm * z)
    return ArmPoints(elbow, wrist, wrist + to_wrist @ _rz(q[4]) @ _ry(q[5]) @ (hand * z))


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v)


def _rz(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _ry(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
