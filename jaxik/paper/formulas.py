"""The paper's formulas as printed, faults included, and beside each faulty one what holds.

Plain numpy in float64, sharing no code with the solver, so that the two can be held side by side. Lengths are the
paper's unitless numbers; the base frame has its origin in the shoulder and z up. One posture at a time, no batches, no
derivatives: for work there is :func:`jaxik.solve_ik`. Equation numbers are those of the source named in
:mod:`jaxik.paper`.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

Vector = Float[np.ndarray, "3"]


def wrist_from_hand(tip: Vector, hand_length: float, wrist_angle: float, hand_angle: float) -> Vector:
    """Wrist from the tip and two angles of the hand, eqs. (7)-(10).

    Args:
        tip: Tip of the hand, ``(3,)``.
        hand_length: Wrist to tip, eq. (3).
        wrist_angle: From the vertical, eq. (1) [rad].
        hand_angle: About the vertical, from x, eq. (2) [rad].

    Returns:
        The wrist, ``(3,)``.
    """
    aside = math.sin(wrist_angle)
    direction = [aside * math.cos(hand_angle), aside * math.sin(hand_angle), math.cos(wrist_angle)]
    return tip + hand_length * np.array(direction)


class Circle(NamedTuple):
    """The circle on which the elbow can lie, eqs. (18)-(36).

    Attributes:
        plane: Coefficients of x, y and z of the plane that holds it, and the right-hand side, eq. (19).
        v1: Along shoulder to wrist, eq. (20).
        a1: First axis in the plane before normalizing, eq. (21); zero for a wrist straight above or below the shoulder.
        b1: Second axis, a1 × v1, eq. (22).
        an1: a1 normalized, eq. (25): where t = 0.
        bn1: b1 normalized, eq. (27): where t = pi/2.
        beta: Share of shoulder to wrist at which the center lies, eq. (31).
        center: Eq. (33).
        distance: Shoulder to center, eq. (34).
        radius: Eq. (35); NaN for a wrist out of reach, where the radicand is negative.
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
        """The elbow at the paper's parameter t [rad], eq. (37)."""
        return self.center + self.radius * (math.cos(t) * self.an1 + math.sin(t) * self.bn1)


def elbow_circle(wrist: Vector, upper_arm: float, forearm: float) -> Circle:
    """Where the elbow can be for a wrist, eqs. (18)-(36).

    NaN where the paper's text divides by zero or takes the root of a negative number: it checks neither.

    Args:
        wrist: The wrist, ``(3,)``.
        upper_arm: Shoulder to elbow, d1.
        forearm: Elbow to wrist, d2.

    Returns:
        The circle, with every intermediate that the paper prints.
    """
    distance2 = float(wrist @ wrist)
    v1 = 2.0 * wrist
    a1 = np.array([-v1[1], v1[0], 0.0])
    b1 = np.cross(a1, v1)
    # The paper divides the plane's equation, here 6x + 6y - 6z = 27, by three before it prints it as (19).
    plane = np.append(v1, upper_arm**2 - forearm**2 + distance2) / 3.0
    beta = (upper_arm**2 - forearm**2 + distance2) / (2.0 * distance2)
    center = beta * wrist
    distance = float(np.linalg.norm(center))
    with np.errstate(invalid="ignore"):
        an1, bn1 = a1 / np.linalg.norm(a1), b1 / np.linalg.norm(b1)
        radius = float(np.sqrt(upper_arm**2 - distance**2))
    return Circle(plane, v1, a1, b1, an1, bn1, beta, center, distance, radius)


def printed_shoulder_angles(elbow: Vector, upper_arm: float) -> tuple[float, float]:
    """Shoulder angles by arcsine and arccosine, eqs. (41)-(44): right for an elbow below the shoulder with y >= 0 only.

    Args:
        elbow: The elbow, ``(3,)``.
        upper_arm: Shoulder to elbow, d1.

    Returns:
        Angle from the vertical that hangs down, in [0, pi/2], and from the x axis about it, in [0, pi] [rad].
    """
    from_vertical = math.asin(math.sqrt(upper_arm**2 - elbow[2] ** 2) / upper_arm)
    return from_vertical, math.acos(elbow[0] / math.hypot(elbow[0], elbow[1]))


def shoulder_angles(elbow: Vector) -> tuple[float, float]:
    """The same two angles in every quadrant.

    Args:
        elbow: The elbow, ``(3,)``.

    Returns:
        Angle from the vertical that hangs down, in [0, pi], and from the x axis about it, in (-pi, pi] [rad].
    """
    return math.atan2(math.hypot(elbow[0], elbow[1]), -elbow[2]), math.atan2(elbow[1], elbow[0])


def elbow_from_shoulder_angles(from_vertical: float, azimuth: float, upper_arm: float) -> Vector:
    """Where an upper arm at two shoulder angles ends.

    Args:
        from_vertical: From the vertical that hangs down [rad].
        azimuth: About it, from x [rad].
        upper_arm: Shoulder to elbow.

    Returns:
        The elbow, ``(3,)``.
    """
    aside = math.sin(from_vertical)
    return upper_arm * np.array([aside * math.cos(azimuth), aside * math.sin(azimuth), -math.cos(from_vertical)])


def line_plane_angle(direction: Vector, normal: Vector) -> float:
    """Angle between a line and a plane given by its normal, eq. (75), in [0, pi/2] [rad].

    Args:
        direction: Along the line, ``(3,)``.
        normal: Across the plane, ``(3,)``.

    Returns:
        The angle [rad].
    """
    return math.asin(abs(direction @ normal) / float(np.linalg.norm(direction) * np.linalg.norm(normal)))


def forearm_roll(elbow: Vector, wrist: Vector, tip: Vector) -> float:
    """The roll the wrist's servo needs: the dihedral angle about the forearm from the arm plane to the hand plane.

    It takes the place of the paper's sum of 90 degrees and the line-plane angle alpha of eq. (78), to which it is
    related by sin(alpha) = abs(sin(roll) sin(flexion)).

    Args:
        elbow: The elbow, ``(3,)``.
        wrist: The wrist, ``(3,)``.
        tip: Tip of the hand, ``(3,)``.

    Returns:
        The angle in (-pi, pi] [rad]; zero for a hand that bends on in the sense of the elbow.
    """
    forearm, hand = _unit(wrist - elbow), tip - wrist
    normal = _unit(np.cross(elbow, forearm))
    return math.atan2(hand @ normal, hand @ np.cross(normal, forearm))


def interior_wrist_angle(elbow: Vector, wrist: Vector, tip: Vector) -> float:
    """Angle at the wrist between forearm and hand, with the signed cosine of eqs. (85)-(86).

    Eqs. (79) and (84) put an absolute value there, which would fold every obtuse angle.

    Args:
        elbow: The elbow, ``(3,)``.
        wrist: The wrist, ``(3,)``.
        tip: Tip of the hand, ``(3,)``.

    Returns:
        The angle in [0, pi] [rad]; pi for a hand in line with the forearm.
    """
    return math.acos(_unit(elbow - wrist) @ _unit(tip - wrist))


def chain(q: Float[np.ndarray, "6"], upper_arm: float, forearm: float, hand: float) -> tuple[Vector, Vector, Vector]:
    """Elbow, wrist and tip of Rz(q1) Ry(q2) Rz(q3) Ry(q4) Rz(q5) Ry(q6), links along z: forward kinematics by itself.

    Args:
        q: Joint angles, ``(6,)`` [rad].
        upper_arm: Shoulder to elbow.
        forearm: Elbow to wrist.
        hand: Wrist to tip.

    Returns:
        The three points, ``(3,)`` each.
    """
    z = np.array([0.0, 0.0, 1.0])
    to_elbow = _rz(q[0]) @ _ry(q[1]) @ _rz(q[2])
    to_wrist = to_elbow @ _ry(q[3])
    elbow = to_elbow @ (upper_arm * z)
    wrist = elbow + to_wrist @ (forearm * z)
    return elbow, wrist, wrist + to_wrist @ _rz(q[4]) @ _ry(q[5]) @ (hand * z)


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v)


def _rz(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _ry(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
