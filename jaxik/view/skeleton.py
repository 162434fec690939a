"""Where every link of an arm is: host arithmetic for drawing, with nothing to compile before the first picture."""

from dataclasses import dataclass

import numpy as np

from jaxik.arm import Arm


@dataclass(frozen=True)
class Skeleton:
    """What drawing needs of an arm, as float64 host arrays at zero joint angles.

    Attributes:
        axes: Unit joint axes, ``(joint, 3)``.
        centers: A point on each axis, ``(joint, 3)`` [m].
        points: Shoulder, elbow, wrist and tool, ``(4, 3)`` [m].
    """

    axes: np.ndarray
    centers: np.ndarray
    points: np.ndarray

    @classmethod
    def of(cls, arm: Arm) -> "Skeleton":
        """The skeleton of an arm."""
        points = np.stack([np.asarray(p, float) for p in (arm.shoulder, arm.elbow, arm.wrist, arm.tool_position)])
        axes = np.asarray(arm.axes, float)
        return cls(axes, points[[0, 0, 0, 1, 2, 2, 2][: len(axes)]], points)

    @property
    def length(self) -> float:
        """Shoulder to elbow to wrist to tool [m]: what sizes of drawn things are relative to."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=-1).sum())

    def motions(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How the base and each link have moved from zero joint angles.

        Args:
            q: Joint angles, ``(*batch, joint)`` [rad].

        Returns:
            Rotations ``(*batch, joint + 1, 3, 3)`` and translations ``(*batch, joint + 1, 3)`` [m]: a point ``p`` of
            link i goes to ``R[i] @ p + t[i]``; link 0 is the base, link i is what joint i carries.
        """
        q = np.asarray(q, float)
        batch, joints = q.shape[:-1], len(self.axes)
        turn, shift = np.broadcast_to(np.eye(3), (*batch, 3, 3)), np.zeros((*batch, 3))
        turns, shifts = [turn], [shift]
        for j in range(joints):
            own = _rotation(self.axes[j], q[..., j])
            shift = shift + _apply(turn, self.centers[j] - _apply(own, self.centers[j]))
            turn = turn @ own
            turns.append(turn)
            shifts.append(shift)
        return np.stack(turns, -3), np.stack(shifts, -2)

    def posture(self, q: np.ndarray) -> np.ndarray:
        """Shoulder, elbow, wrist and tool at joint angles ``(*batch, joint)`` [rad]: ``(*batch, 4, 3)`` [m]."""
        turns, shifts = self.motions(q)
        carriers = [0, 3, 4, len(self.axes)]
        moved = [_apply(turns[..., i, :, :], p) + shifts[..., i, :] for i, p in zip(carriers, self.points, strict=True)]
        return np.stack(moved, -2)


def wxyz(rotation: np.ndarray) -> np.ndarray:
    """Unit quaternion of a rotation matrix ``(3, 3)``, scalar first and not negative.

    By the largest of the four components, so that no angle divides by a small number (Shepperd 1978).
    """
    r = rotation
    a, b, c = np.diagonal(r)
    squares = np.array([a + b + c, a - b - c, b - a - c, c - a - b])
    k = int(np.argmax(squares))
    w, x, y, z = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], 1 + squares[k]
    xy, xz, yz = r[0, 1] + r[1, 0], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1]
    found = np.array([(z, w, x, y), (w, z, xy, xz), (x, xy, z, yz), (y, xz, yz, z)][k])
    found = found / np.linalg.norm(found)
    return found if found[0] >= 0 else -found


def rotation_of(quaternion: np.ndarray) -> np.ndarray:
    """Rotation matrix of a quaternion ``wxyz`` of any length but zero."""
    w, x, y, z = np.asarray(quaternion, float) / np.linalg.norm(quaternion)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def circle_through(shoulder: np.ndarray, elbow: np.ndarray, wrist: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Where the elbow comes when it turns about the line from shoulder to wrist.

    Args:
        shoulder: ``(3,)`` [m].
        elbow: ``(3,)`` [m].
        wrist: ``(3,)`` [m].
        turns: Right-handed about the direction to the wrist, ``(N,)`` [rad].

    Returns:
        Points ``(N, 3)`` [m]; all the elbow itself where it lies on the line, or wrist and shoulder coincide.
    """
    n = wrist - shoulder
    n = n / max(float(np.linalg.norm(n)), np.finfo(float).tiny)
    center = shoulder + n * ((elbow - shoulder) @ n)
    a = elbow - center
    return center + np.cos(turns)[:, None] * a + np.sin(turns)[:, None] * np.cross(n, a)


def _rotation(axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Rotation matrices about a unit axis, ``(*batch, 3, 3)``."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    sin, cos = np.sin(angle)[..., None, None], np.cos(angle)[..., None, None]
    return np.eye(3) + sin * cross + (1 - cos) * (cross @ cross)


def _apply(turn: np.ndarray, point: np.ndarray) -> np.ndarray:
    return np.einsum("...ij,...j->...i", turn, point)
