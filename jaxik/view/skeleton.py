"""Poses of the links of an arm for drawing, computed on the host without compilation."""

from dataclasses import dataclass

import numpy as np

from jaxik.arm import Arm
from jaxik.targets import matrix_from_rotation_vector


@dataclass(frozen=True)
class Skeleton:
    """Geometry of an arm at zero joint angles, as float64 host arrays.

    Attributes:
        axes: Unit joint axes, ``(joint, 3)``.
        stations: Points that the joints carry along from base to tip, the tool point last, ``(station, 3)`` [m].
        station_of_joint: Index of the station on each joint's axis.
    """

    axes: np.ndarray
    stations: np.ndarray
    station_of_joint: tuple[int, ...]

    @classmethod
    def of(cls, arm: Arm) -> "Skeleton":
        """Return the skeleton of an arm of any class."""
        stations = np.stack([np.asarray(p, float) for p in arm.stations])
        return cls(np.asarray(arm.axes, float), stations, arm.station_of_joint)

    @property
    def centers(self) -> np.ndarray:
        """A point on each axis, ``(joint, 3)`` [m]."""
        return self.stations[list(self.station_of_joint)]

    @property
    def points(self) -> np.ndarray:
        """Shoulder, elbow, wrist and tool, ``(4, 3)`` [m]."""
        on = self.station_of_joint
        return self.stations[[on[1], on[3], on[4], -1]]

    @property
    def carriers(self) -> tuple[int, ...]:
        """Link that carries each station, and the rod that ends there: the last one before the joints on it."""
        return (*(self.station_of_joint.index(i) for i in range(len(self.stations) - 1)), len(self.axes))

    @property
    def length(self) -> float:
        """Length from the first to the last station [m], the scale of the drawing."""
        return float(np.linalg.norm(np.diff(self.stations, axis=0), axis=-1).sum())

    def motions(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the motions of the base and each link from zero joint angles.

        Args:
            q: Joint angles, ``(*batch, joint)`` [rad].

        Returns:
            Rotations ``(*batch, joint + 1, 3, 3)`` and translations ``(*batch, joint + 1, 3)`` [m]: a point ``p`` of
            link i moves to ``R[i] @ p + t[i]``; link 0 is the base, link i follows joint i.
        """
        q = np.asarray(q, float)
        batch, joints = q.shape[:-1], len(self.axes)
        turn, shift = np.broadcast_to(np.eye(3), (*batch, 3, 3)), np.zeros((*batch, 3))
        turns, shifts = [turn], [shift]
        for j in range(joints):
            own = matrix_from_rotation_vector(self.axes[j] * q[..., j, None])
            shift = shift + _apply(turn, self.centers[j] - _apply(own, self.centers[j]))
            turn = turn @ own
            turns.append(turn)
            shifts.append(shift)
        return np.stack(turns, -3), np.stack(shifts, -2)

    def posture(self, q: np.ndarray) -> np.ndarray:
        """Return shoulder, elbow, wrist and tool ``(*batch, 4, 3)`` [m] at joint angles ``(*batch, joint)`` [rad]."""
        turns, shifts = self.motions(q)
        on = self.station_of_joint
        carriers = [self.carriers[i] for i in (on[1], on[3], on[4], -1)]
        moved = [_apply(turns[..., i, :, :], p) + shifts[..., i, :] for i, p in zip(carriers, self.points, strict=True)]
        return np.stack(moved, -2)


def circle_through(shoulder: np.ndarray, elbow: np.ndarray, wrist: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Return the positions of the elbow when it turns about the line from shoulder to wrist.

    Args:
        shoulder: Shoulder, ``(3,)`` [m].
        elbow: Elbow, ``(3,)`` [m].
        wrist: Wrist, ``(3,)`` [m].
        turns: Angles, right-handed about the direction to the wrist, ``(N,)`` [rad].

    Returns:
        Points ``(N, 3)`` [m]; all equal to the elbow if it lies on the line or wrist and shoulder coincide.
    """
    n = wrist - shoulder
    n = n / max(float(np.linalg.norm(n)), np.finfo(float).tiny)
    center = shoulder + n * ((elbow - shoulder) @ n)
    a = elbow - center
    return center + np.cos(turns)[:, None] * a + np.sin(turns)[:, None] * np.cross(n, a)


def _apply(turn: np.ndarray, point: np.ndarray) -> np.ndarray:
    return np.einsum("...ij,...j->...i", turn, point)
