"""The closed form once more, one posture at a time in 60 digits: an oracle that shares no code with the solver.

Written from the formulas (law of cosines, circle of the elbow, ZYZ triples) in their textbook form, arccos and all; 60
digits leave plenty where float64 loses half of its own. Inputs are the very float64 numbers the solver gets. Axes and
rotations are first made exactly orthonormal: in float64 they are so only to rounding, and what the formulas make of the
rest is arbitrary.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np
from mpmath import mp, mpf

from jaxik.arm.arm import Arm
from jaxik.arm.swivel_reference import PaperReference

DIGITS = 60
STEP = (
    mpf(10) ** -26
)  # of central differences: error about (STEP / distance to the singularity)², and 1e-34 of rounding
END = mpf(10) ** -36  # relative distance from full stretch to which a wrist out of reach is pulled

Vector = list
Matrix = list  # of rows


@dataclass(frozen=True)
class MpArm:
    """An arm in 60 digits, its axes exactly orthogonal where the class asks for it."""

    axes: list[Vector]
    shoulder: Vector
    elbow: Vector
    wrist: Vector
    tool_position: Vector
    tool_rotation: Matrix
    reference: tuple[Vector, Vector]
    paper: bool
    n_joints: int


@mp.workdps(DIGITS)
def mp_arm(arm: Arm) -> MpArm:
    """The arm that the solver's float64 one stands for."""
    axes = [unit(vector(a)) for a in np.asarray(arm.axes)]
    rotation = orthonormal(np.asarray(arm.tool_rotation))
    if arm.n_joints == 6:
        axes.append([row[2] for row in rotation])
    for middle, outer in ((1, (0, 2)), (5, (4, 6))):
        for i in outer:
            axes[i] = unit(across(axes[i], axes[middle]))
    first, second = (unit(vector(v)) for v in arm.reference.vectors())
    return MpArm(
        axes,
        *(vector(v) for v in (arm.shoulder, arm.elbow, arm.wrist, arm.tool_position)),
        rotation,
        (first, unit(across(second, first))),
        isinstance(arm.reference, PaperReference),
        arm.n_joints,
    )


def all_branches(
    arm: MpArm, position: Vector, rotation: Matrix | None, direction: Vector | None, angle
) -> list[Vector]:
    """The eight joint vectors; q7 of a 7-joint arm with a direction alone is left at 0."""
    if rotation is not None:
        hand = matmul(rotation, transpose(arm.tool_rotation))  # the rotation of link 7
        offset = matvec(hand, minus(arm.tool_position, arm.wrist))
    else:
        hand, direction = None, unit(direction)
        offset = scaled(direction, norm(minus(arm.tool_position, arm.wrist)))
    w = minus(minus(position, offset), arm.shoulder)
    n = unit(w)
    r, b = zero_and_quarter(arm, n)
    e = plus(scaled(r, mp.cos(angle)), scaled(b, mp.sin(angle)))
    plane = columns(n, e, cross(n, e))
    branches = {}
    for elbow_bit, q4 in enumerate(elbow_angles(arm, norm(w))):
        turn4 = rotation_about(arm.axes[3], q4)
        line = unit(plus(minus(arm.elbow, arm.shoulder), matvec(turn4, minus(arm.wrist, arm.elbow))))
        out = unit(across(minus(arm.elbow, arm.shoulder), line))
        shoulder = matmul(plane, transpose(columns(line, out, cross(line, out))))
        undone = transpose(matmul(shoulder, turn4))
        for shoulder_bit in (0, 1):
            for wrist_bit in (0, 1):
                q = [*triple_angles(arm.axes[:3], shoulder, shoulder_bit), q4]
                if hand is not None:
                    q += triple_angles(arm.axes[4:], matmul(undone, hand), wrist_bit)
                else:
                    q += pointing_angles(arm.axes[4:], matvec(undone, direction), wrist_bit)
                    q += [mpf(0)] * (arm.n_joints - 6)
                branches[4 * shoulder_bit + 2 * elbow_bit + wrist_bit] = q
    return [branches[i] for i in range(8)]


def elbow_angles(arm: MpArm, distance) -> tuple:
    """Both q4 for a distance from shoulder to wrist; the nearest possible distance where it is out of reach."""
    a4, u, v = arm.axes[3], minus(arm.elbow, arm.shoulder), minus(arm.wrist, arm.elbow)
    v_across = across(v, a4)
    c0 = dot(u, u) + dot(v, v) + 2 * dot(u, a4) * dot(a4, v)
    cc, cs = 2 * dot(u, v_across), 2 * dot(u, cross(a4, v))
    cosine = (distance**2 - c0) / mp.hypot(cc, cs)
    cosine = min(max(cosine, END - 1), 1 - END)
    straight = mp.atan2(cs, cc)
    return straight + mp.acos(cosine), straight - mp.acos(cosine)


def zero_and_quarter(arm: MpArm, n: Vector) -> tuple[Vector, Vector]:
    """The directions on the elbow's circle at swivel 0 and at +90 degrees."""
    first, second = arm.reference
    if arm.paper:
        r = unit(cross(first, n))
        return r, cross(r, n)
    k = cross(minus(n, first), second)
    r = unit(cross(k, n))
    return r, cross(n, r)


def triple_angles(axes: list[Vector], rotation: Matrix, bit: int) -> Vector:
    """The three angles about orthogonal axes; bit 0 is the solution whose middle ZYZ angle has a positive sine."""
    frame, delta = triple_frame(axes)
    m = matmul(matmul(transpose(frame), rotation), matmul(frame, about_y(delta)))
    s = 1 - 2 * bit
    middle = mp.atan2(s * mp.hypot(m[0][2], m[1][2]), m[2][2])
    return [mp.atan2(s * m[1][2], s * m[0][2]), middle - delta, mp.atan2(s * m[2][1], -s * m[2][0])]


def pointing_angles(axes: list[Vector], direction: Vector, bit: int) -> Vector:
    """The first two angles of a triple from the direction of its last axis."""
    frame, delta = triple_frame(axes)
    x, y, z = matvec(transpose(frame), direction)
    s = 1 - 2 * bit
    return [mp.atan2(s * y, s * x), mp.atan2(s * mp.hypot(x, y), z) - delta]


def triple_frame(axes: list[Vector]) -> tuple[Matrix, mpf]:
    """C with C z = axis 1, C y = axis 2, and the angle delta with axis 3 = C Ry(delta) z."""
    a, b, c = axes
    x = cross(b, a)
    return columns(x, b, a), mp.atan2(dot(c, x), dot(c, a))


@mp.workdps(DIGITS)
def forward(arm: MpArm, q: Vector) -> tuple[Vector, Matrix, Vector, Vector]:
    """Tool position, tool rotation, elbow and wrist by the product of exponentials."""
    points = {"elbow": arm.elbow, "wrist": arm.wrist, "tool": arm.tool_position}
    rotation = arm.tool_rotation
    for i in reversed(range(arm.n_joints)):
        turn = rotation_about(arm.axes[i], q[i])
        center = arm.shoulder if i < 3 else arm.elbow if i == 3 else arm.wrist
        carried = ("tool",) if i > 3 else ("tool", "wrist") if i == 3 else ("tool", "wrist", "elbow")
        for name in carried:
            points[name] = plus(center, matvec(turn, minus(points[name], center)))
        rotation = matmul(turn, rotation)
    return points["tool"], rotation, points["elbow"], points["wrist"]


@mp.workdps(DIGITS)
def swivel(arm: MpArm, q: Vector):
    """Swivel angle of a joint vector whose elbow is not straight, from where the elbow is."""
    _, _, elbow, wrist = forward(arm, q)
    n = unit(minus(wrist, arm.shoulder))
    e = unit(across(minus(elbow, arm.shoulder), n))
    r, b = zero_and_quarter(arm, n)
    return mp.atan2(dot(e, b), dot(e, r))


def solutions(arm: Arm | MpArm, position, orientation, swivel_angle) -> np.ndarray:
    """All branches of one float64 target, ``(8, n_joints)`` of mpf; orientation is a rotation or a direction."""
    with mp.workdps(DIGITS):
        exact = arm if isinstance(arm, MpArm) else mp_arm(arm)
        return _solutions(exact, vector(position), np.asarray(orientation), mpf(float(swivel_angle)))


def derivative(arm: Arm | MpArm, position, orientation, swivel_angle, rate) -> np.ndarray:
    """Joint rates of all branches, ``(8, n_joints)`` in float64, for a moving target at the given float64 inputs.

    Args:
        arm: The arm.
        position: Of the target, ``(3,)``.
        orientation: Rotation ``(3, 3)`` or direction ``(3,)``.
        swivel_angle: Swivel [rad].
        rate: Velocity ``(3,)``, angular velocity ``(3,)`` in the base frame and swivel rate.
    """
    with mp.workdps(DIGITS):
        exact = arm if isinstance(arm, MpArm) else mp_arm(arm)
        velocity, angular, swivel_rate = (vector(np.atleast_1d(r)) for r in rate)
        at = partial(_moved, exact, vector(position), np.asarray(orientation), mpf(float(swivel_angle)))
        ahead, behind = (at(s, velocity, angular, swivel_rate[0]) for s in (STEP, -STEP))
        return np.array(
            [
                [float(wrapped(a - b) / (2 * STEP)) for a, b in zip(p, m, strict=True)]
                for p, m in zip(ahead, behind, strict=True)
            ]
        )


def _moved(arm, position, orientation, angle, step, velocity, angular, swivel_rate):
    size = norm(angular)
    turn = rotation_about(scaled(angular, 1 / size), step * size) if size else eye()
    moved = plus(position, scaled(velocity, step))
    return _solutions(arm, moved, orientation, angle + step * swivel_rate, turn)


def _solutions(arm: MpArm, position: Vector, orientation: np.ndarray, angle, turn: Matrix | None = None) -> np.ndarray:
    turn = eye() if turn is None else turn
    if orientation.ndim == 2:
        branches = all_branches(arm, position, matmul(turn, orthonormal(orientation)), None, angle)
    else:
        branches = all_branches(arm, position, None, matvec(turn, vector(orientation)), angle)
    return np.array(branches, dtype=object)


def orthonormal(matrix: np.ndarray) -> Matrix:
    """The exact rotation nearest to a float64 one."""
    m = [vector(row) for row in matrix]
    for _ in range(4):  # Newton's step for the polar factor squares the error: 1e-8 (float32) to below 1e-60
        gram = matmul(transpose(m), m)
        half = [[((3 if i == j else 0) - gram[i][j]) / 2 for j in range(3)] for i in range(3)]
        m = matmul(m, half)
    return m


def wrapped(angle):
    """An angle brought to [-pi, pi]."""
    return angle - 2 * mp.pi * mp.nint(angle / (2 * mp.pi))


def vector(v) -> Vector:
    return [x if isinstance(x, mpf) else mpf(float(x)) for x in v]


def eye() -> Matrix:
    return [[mpf(i == j) for j in range(3)] for i in range(3)]


def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a, b) -> Vector:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def plus(a, b) -> Vector:
    return [x + y for x, y in zip(a, b, strict=True)]


def minus(a, b) -> Vector:
    return [x - y for x, y in zip(a, b, strict=True)]


def scaled(a, s) -> Vector:
    return [s * x for x in a]


def norm(a):
    return mp.sqrt(dot(a, a))


def unit(a) -> Vector:
    return scaled(a, 1 / norm(a))


def across(v, n) -> Vector:
    """The part of v across the unit vector n."""
    return minus(v, scaled(n, dot(v, n)))


def columns(*c) -> Matrix:
    return [list(row) for row in zip(*c, strict=True)]


def transpose(m) -> Matrix:
    return columns(*m)


def matvec(m, v) -> Vector:
    return [dot(row, v) for row in m]


def matmul(a, b) -> Matrix:
    return columns(*(matvec(a, c) for c in transpose(b)))


def about_y(angle) -> Matrix:
    c, s = mp.cos(angle), mp.sin(angle)
    return [[c, mpf(0), s], [mpf(0), mpf(1), mpf(0)], [-s, mpf(0), c]]


def rotation_about(axis, angle) -> Matrix:
    """Rotation about a unit axis (Rodrigues)."""
    c, s = mp.cos(angle), mp.sin(angle)
    return columns(
        *(plus(plus(scaled(x, c), scaled(cross(axis, x), s)), scaled(axis, dot(axis, x) * (1 - c))) for x in eye())
    )
