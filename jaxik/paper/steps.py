"""The worked example as a list: printed and exact result of each equation, and the errata."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jaxik.paper import formulas


class ExampleData(NamedTuple):
    """Data of the worked example, in the paper's unitless lengths, with the shoulder at the origin.

    Attributes:
        tip: Tip of the hand, eqs. (4)-(6).
        wrist: Wrist, eqs. (12), (13).
        upper_arm: Length from shoulder to elbow, d1, eq. (14).
        forearm: Length from elbow to wrist, d2, eq. (15).
        hand: Length from wrist to tip.
        swivel: The paper's t, chosen after Figure 18 [rad].
    """

    tip: tuple[float, float, float] = (3.0, 4.0, -3.0)
    wrist: tuple[float, float, float] = (3.0, 3.0, -3.0)
    upper_arm: float = 3.0
    forearm: float = 3.0
    hand: float = 1.0
    swivel: float = math.pi


EXAMPLE = ExampleData()
TIP, WRIST, UPPER_ARM, FOREARM, HAND, SWIVEL = EXAMPLE

_CONVERTED = "converted to degrees after rounding to 0.01 rad"


@dataclass(frozen=True)
class Step:
    """One result of the worked example.

    Attributes:
        equation: Equation number in the paper, such as "24", "38-40" or "text after 78".
        name: Name of the quantity.
        formula: Formula of the quantity.
        unit: "deg", or "" for the paper's unitless lengths and for numbers.
        printed: Printed numbers.
        digits: Printed digits after the decimal point.
        exact: Exact numbers: the equation evaluated in float64 without intermediate rounding.
        erratum: Reason why the printed numbers are not the rounded exact ones, or None if they are.
        retraced: For an erratum, the printed number recomputed from previously printed numbers, or None.
    """

    equation: str
    name: str
    formula: str
    unit: str
    printed: tuple[float, ...]
    digits: int
    exact: tuple[float, ...]
    erratum: str | None = None
    retraced: float | None = None

    @property
    def is_rounding(self) -> bool:
        """True if every printed number is the exact one rounded or truncated to the printed digits."""
        ulp = 10.0**-self.digits
        # Both numbers have errors of a few eps; 1e-9 of a digit is far above that and far below a digit.
        cut = [(abs(e) - abs(p)) / ulp for p, e in zip(self.printed, self.exact, strict=True)]
        same_sign = all(p * e >= 0.0 for p, e in zip(self.printed, self.exact, strict=True))
        return same_sign and all(-0.5 - 1e-9 <= c < 1.0 - 1e-9 for c in cut)


def worked_example() -> tuple[Step, ...]:
    """Compute the worked example, eqs. (7)-(86), step by step from its data, for comparison with the printed numbers.

    Returns:
        One :class:`Step` per printed result, in the order of the paper.

    Example:
        >>> [step.equation for step in worked_example() if step.erratum and "wrist x" in step.erratum]
        ['45']
    """
    wrist, tip = np.array(WRIST), np.array(TIP)
    circle = formulas.elbow_circle(wrist, UPPER_ARM, FOREARM)
    elbow = circle.point(SWIVEL)
    return (
        *_circle_steps(tip, wrist, circle, elbow),
        *_shoulder_and_elbow_steps(wrist, circle, elbow),
        *_hand_steps(tip, wrist, circle, elbow),
    )


def _circle_steps(tip: np.ndarray, wrist: np.ndarray, circle: formulas.Circle, elbow: np.ndarray) -> tuple[Step, ...]:
    """Eqs. (7)-(40): wrist, circle, elbow."""
    return (
        _step(
            "7-10", "wrist used from (12) on", "tip + hand (sin cos, sin sin, cos) of angles 0, hand 2",
            (3, 3, -3), 0, formulas.wrist_from_hand(tip, 2.0, 0.0, 0.0),
            erratum="eqs. (1)-(6) put the wrist at (3, 4, -1); from (12) on it is (3, 3, -3): hand of 1 along +y",
        ),
        _step("19", "plane of both spheres (x, y, z | rhs)", "difference of spheres (16), (17), over 3",
              (2, 2, -2, 9), 0, circle.plane),
        _step("20", "v1", "2 wrist", (6, 6, -6), 0, circle.v1),
        _step("21", "a1", "(-v1_y, v1_x, 0)", (-6, 6, 0), 0, circle.a1),
        _step("22", "b1", "a1 × v1", (-36, -36, -72), 0, circle.b1),
        _step("24", "|a1|", "length of a1", 8.49, 2, float(np.linalg.norm(circle.a1))),
        _step("25", "a1 normalized", "a1 / |a1|", (-0.71, 0.71, 0), 2, circle.an1),
        _step("27", "b1 normalized", "b1 / |b1|", (-0.41, -0.41, -0.82), 2, circle.bn1),
        _step("31", "beta", "(d1² - d2² + |wrist|²) / (2 |wrist|²)", 0.5, 1, circle.beta),
        _step("33", "center of the circle M", "beta wrist", (1.5, 1.5, -1.5), 1, circle.center),
        _step("34", "shoulder to center d", "|M|", 2.6, 1, circle.distance),
        _step("35", "radius of the circle r3", "sqrt(d1² - d²)", 1.5, 1, circle.radius),
        _step("38-40", "elbow", "M + r3 (cos t a1 + sin t b1), both normalized, at t = pi",
              (2.56, 0.44, -1.5), 2, elbow),
    )  # fmt: skip


def _shoulder_and_elbow_steps(wrist: np.ndarray, circle: formulas.Circle, elbow: np.ndarray) -> tuple[Step, ...]:
    """Eqs. (41)-(49): two shoulder angles and the interior elbow angle."""
    from_z = math.sqrt(UPPER_ARM**2 - elbow[2] ** 2)
    on_xy = math.hypot(elbow[0], elbow[1])
    from_vertical, azimuth = (math.degrees(a) for a in formulas.printed_shoulder_angles(elbow, UPPER_ARM))
    to_wrist, to_shoulder = float(np.linalg.norm(wrist - circle.center)), circle.distance
    part_2 = math.degrees(math.asin(to_wrist / FOREARM))
    part_1 = math.degrees(math.asin(to_shoulder / UPPER_ARM))
    wrong_wrist = np.array([2.0, 3.0, -3.0])
    return (
        _step("41", "elbow from the z axis", "sqrt(d1² - elbow_z²)", 2.6, 1, from_z),
        _step("42", "shoulder, from the vertical", "asin((41) / d1)", 60.16, 2, from_vertical, "deg",
              f"{_CONVERTED}, 1.05", _via_radians(math.asin(2.6 / 3))),
        _step("43", "upper arm on the XY plane", "hypot(elbow_x, elbow_y)", 2.59, 2, on_xy),
        _step("44", "shoulder, about the vertical", "acos(elbow_x / (43))", 8.59, 2, azimuth, "deg",
              "the arccosine near 1 amplifies the rounding error of its argument 2.56 / 2.59, and it loses the sign",
              _via_radians(math.acos(2.56 / 2.59))),
        _step("45", "center to wrist", "|wrist - M|", 2.17, 2, to_wrist, "",
              "computed with wrist x = 2 instead of the 3 of (12)", float(np.linalg.norm(wrong_wrist - circle.center))),
        _step("46", "interior elbow angle, part of the forearm", "asin((45) / d2)", 45.41, 2, part_2, "deg",
              "follows from (45), with a wrong digit: 0.81 rad is 46.41 deg",
              _via_radians(math.asin(2.17 / 3)) - 1.0),
        _step("47", "shoulder to center", "|M|", 2.59, 2, to_shoulder),
        _step("48", "interior elbow angle, part of the upper arm", "asin((47) / d1)", 60.16, 2, part_1, "deg",
              f"{_CONVERTED}, 1.05", _via_radians(math.asin(to_shoulder / 3))),
        _step("49", "interior elbow angle", "(46) + (48)", 105.57, 2, part_1 + part_2, "deg",
              "follows from (46); the law of cosines gives 120 deg", 45.41 + 60.16),
    )  # fmt: skip


def _hand_steps(tip: np.ndarray, wrist: np.ndarray, circle: formulas.Circle, elbow: np.ndarray) -> tuple[Step, ...]:
    """Eqs. (50)-(86): the arm's plane, the wrist's roll and the angle between forearm and hand."""
    normal = np.cross(elbow, circle.center)
    line_plane = math.degrees(formulas.line_plane_angle(wrist - tip, normal))
    roll = math.degrees(formulas.forearm_roll(elbow, wrist, tip))
    interior = math.degrees(formulas.interior_wrist_angle(elbow, wrist, tip))
    sine = math.sin(math.radians(line_plane))
    return (
        _step("51", "P1P2", "elbow - shoulder", (2.56, 0.44, -1.5), 2, elbow),
        _step("52", "P1P3", "M - shoulder", (1.5, 1.5, -1.5), 1, circle.center),
        _step("58", "normal of the arm's plane N", "elbow × M", (1.59, 1.59, 3.18), 2, normal),
        _step("67", "direction of the hand's line", "wrist - tip", (0, -1, 0), 0, wrist - tip),
        _step("76, denominator", "|N|", "length of N", 3.89, 2, float(np.linalg.norm(normal))),
        _step("76", "sine of the line-plane angle", "|hand · N| / (|hand| |N|)", 0.41, 2, sine),
        _step("77", "90 deg minus the line-plane angle", "acos((76))", 65.89, 2, 90.0 - line_plane, "deg",
              f"{_CONVERTED}, 1.15", _via_radians(math.acos(0.41))),
        _step("78", "line-plane angle", "90 deg - (77)", 24.11, 2, line_plane, "deg",
              f"follows from (77): {_CONVERTED}", 90.0 - 65.89),
        _step("text after 78", "roll of the wrist's servo", "90 deg + (78)", 114.11, 2, 90.0 + line_plane, "deg",
              "the line-plane angle is not the roll; the tip is reached by the dihedral angle between the arm plane "
              f"and the hand plane, {roll:.3f} deg", 90.0 + 24.11),
        _step("82", "v1 of the wrist's angle", "elbow - wrist", (-0.44, -2.56, 1.5), 2, elbow - wrist),
        _step("83", "v2 of the wrist's angle", "tip - wrist", (0, 1, 0), 0, tip - wrist),
        _step("85", "cosine of the interior wrist angle", "v1 · v2 / (|v1| |v2|)", -0.85, 2,
              math.cos(math.radians(interior))),
        _step("86", "interior wrist angle", "acos((85))", 148.40, 2, interior, "deg",
              f"{_CONVERTED}, 2.59", _via_radians(math.acos(-0.85))),
    )  # fmt: skip


def _step(
    equation: str,
    name: str,
    formula: str,
    printed: float | tuple[int | float, ...],
    digits: int,
    exact: float | np.ndarray,
    unit: str = "",
    erratum: str | None = None,
    retraced: float | None = None,
) -> Step:
    numbers = tuple(float(x) for x in np.atleast_1d(printed)), tuple(float(x) for x in np.atleast_1d(exact))
    return Step(equation, name, formula, unit, numbers[0], digits, numbers[1], erratum, retraced)


def _via_radians(angle: float) -> float:
    """Convert an angle to degrees as the paper does, after rounding to 0.01 rad."""
    return math.degrees(round(angle, 2))
