"""Recorded human arms: files of elbow and hand relative to the shoulder, and the arm that fits them.

Files have the columns of the tracker recordings in github hai-vr/hvr-ik (Apache-2.0): ``elbow_x,elbow_y,elbow_z,
hand_x,hand_y,hand_z`` and ``hand_qx,hand_qy,hand_qz,hand_qw``; other columns are ignored. Their axes are left-handed,
with x to the right along the arm in T-pose, y up and z forward; the straight arm has a length of about one unit.
"""

import os
from typing import NamedTuple

import numpy as np

from jaxik.arm import ArmModel, StereographicReference, floats, make_arm
from jaxik.errors import FileFormatError
from jaxik.tables import load_columns
from jaxik.targets import matrix_from_wxyz

_COLUMNS = (
    *(f"elbow_{a}" for a in "xyz"),
    *(f"hand_{a}" for a in "xyz"),
    *(f"hand_q{a}" for a in "xyzw"),
)
# From the file's axes (right, up, forward) to jaxik's (forward, left, up); the determinant of -1 changes handedness.
_AXES = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
# The recorded hand points along x; the tool points along z, with x toward the thumb.
_HAND = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
_UNIT_TOLERANCE = 1e-2  # far above the rounding to six decimals


class HumanFrames(NamedTuple):
    """Frames of a right arm in jaxik's axes (x forward, y left, z up), shoulder at the origin.

    Attributes:
        elbow: Elbow, ``(N, 3)``, in the recording's unit of length.
        hand: Wrist, between forearm and hand, ``(N, 3)``, in the same unit.
        rotation: Rotation of the hand with z along the hand and x toward the thumb, ``(N, 3, 3)``.
    """

    elbow: np.ndarray
    hand: np.ndarray
    rotation: np.ndarray

    def __getitem__(self, rows: slice) -> "HumanFrames":  # type: ignore[override]
        """Return consecutive frames."""
        return HumanFrames(self.elbow[rows], self.hand[rows], self.rotation[rows])

    @property
    def count(self) -> int:
        """Number of frames."""
        return len(self.elbow)


def load_human(file: str | os.PathLike[str]) -> HumanFrames:
    """Read recorded frames.

    Args:
        file: Comma-separated file with the columns ``elbow_x`` to ``elbow_z``, ``hand_x`` to ``hand_z`` and
            ``hand_qx`` to ``hand_qw``, see docs/learning.md.

    Returns:
        The frames in temporal order.

    Raises:
        FileFormatError: The file has another format; the message names file, line and expected content.
        OSError: The file cannot be read.
    """
    name = os.fspath(file)

    def find(header: list[str]) -> list[int] | None:
        return [header.index(column) for column in _COLUMNS] if set(_COLUMNS) <= set(header) else None

    values, lines = load_columns(name, find, f"the columns {', '.join(_COLUMNS)}")
    if len(values) < 2:
        raise FileFormatError(f"{name}: expected at least 2 frames, got {len(values)}")
    norm = np.linalg.norm(values[:, 6:], axis=1)
    bad = ~(np.abs(norm - 1) < _UNIT_TOLERANCE)
    if bad.any():
        at = int(np.argmax(bad))
        raise FileFormatError(
            f"{name}:{lines[at]}: expected finite numbers and a unit quaternion, got a quaternion of length "
            f"{norm[at]:.4g}"
        )
    rotation = _AXES @ matrix_from_wxyz(values[:, [9, 6, 7, 8]]) @ _AXES.T @ _HAND
    return HumanFrames(values[:, :3] @ _AXES.T, values[:, 3:6] @ _AXES.T, rotation)


def human_arm(frames: HumanFrames) -> ArmModel:
    """Return a right arm with the median lengths of upper arm and forearm; the tool point is the wrist.

    Medians are robust against slipped trackers: some frames are far from any rigid arm.

    Args:
        frames: The recording.

    Returns:
        The arm in the recording's unit of length.
    """
    upper = float(np.median(np.linalg.norm(frames.elbow, axis=1)))
    fore = float(np.median(np.linalg.norm(frames.hand - frames.elbow, axis=1)))
    down, swing, lift = np.array([0.0, 0.0, -1.0]), np.array([0.0, -1.0, 0.0]), np.array([-1.0, 0.0, 0.0])
    pole = _least_visited(frames.hand)
    zero = np.cross(pole, down if abs(pole[2]) < 0.9 else swing)
    arm = make_arm(
        axes=[swing, lift, -down, swing, -down, lift, swing],
        shoulder=(0, 0, 0),
        elbow=upper * down,
        wrist=(upper + fore) * down,
        tool_position=(upper + fore) * down,
        reference=StereographicReference(pole=floats(pole), zero=floats(zero / np.linalg.norm(zero))),
    )
    return ArmModel(
        arm,
        tuple(f"human_{i}" for i in range(1, 8)),
        "human_arm",
        "Median lengths of recorded frames",
        (f"upper arm {upper:.4f}, forearm {fore:.4f}, in the recording's unit",),
    )


def _least_visited(hand: np.ndarray, count: int = 2000) -> np.ndarray:
    """The direction farthest from all hands: where the swivel's reference may be singular.

    Of a spiral of evenly spread directions (Vogel, "A better way to construct the sunflower head", 1979).
    """
    seen = hand / np.linalg.norm(hand, axis=1, keepdims=True)
    z = 1 - (2 * np.arange(count) + 1) / count
    turn = np.pi * (3 - 5**0.5) * np.arange(count)
    directions = np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], axis=1)
    return directions[np.argmin((directions @ seen.T).max(axis=1))]
