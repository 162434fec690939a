"""Probe points: joint readings with measured tip positions, the data of a calibration."""

import math
import os
from typing import NamedTuple

import numpy as np

from jaxik.errors import FileFormatError
from jaxik.tables import load_columns

_TIP = ("x", "y", "z")


class ProbePoints(NamedTuple):
    """Joint readings and measured tip positions of N probe points.

    Attributes:
        q: Joint readings, ``(N, joint)`` [rad].
        tip: Measured tool points in the base frame, ``(N, 3)`` [m].
    """

    q: np.ndarray
    tip: np.ndarray


def load_probe_points(file: str | os.PathLike[str], joint_names: tuple[str, ...]) -> ProbePoints:
    """Read a comma-separated file of probe points.

    The first line names the columns, in any order: each joint by its name or as ``q1``, ``q2``, ..., and ``x``, ``y``,
    ``z`` of the tip. Units are radians and meters; a joint column whose name ends in ``_deg`` holds degrees. Empty
    lines and lines that begin with ``#`` are skipped. Spreadsheets may separate by semicolons, with decimal commas.

    Args:
        file: File name.
        joint_names: Names of the arm's joints, in order.

    Returns:
        The probe points in float64.

    Raises:
        FileFormatError: The file has another format; the message names file, line and expected content.
        OSError: The file cannot be read.
    """
    factors: list[float] = []

    def find(header: list[str]) -> list[int] | None:
        columns = [_column(header, (joint, f"q{i}")) for i, joint in enumerate(joint_names, 1)]
        columns += [_column(header, (axis,)) for axis in _TIP]
        known = [column for column in columns if column is not None]
        factors[:] = [factor for _, factor in known]
        return [place for place, _ in known] if len(known) == len(columns) == len(header) else None

    expected = f"the columns {', '.join(joint_names)} (or q1 to q{len(joint_names)}; _deg for degrees) and x, y, z"
    values, lines = load_columns(file, find, expected)
    if not lines:
        raise FileFormatError(f"{os.fspath(file)}: expected probe points below the header, got none")
    values = values * np.array(factors)
    return ProbePoints(values[:, :-3], values[:, -3:])


def _column(header: list[str], names: tuple[str, ...]) -> tuple[int, float] | None:
    """Index of the column with one of the given names, and the factor to radians or meters."""
    for name in names:
        if header.count(name) == 1:
            return header.index(name), 1.0
        if name not in _TIP and header.count(f"{name}_deg") == 1:
            return header.index(f"{name}_deg"), math.pi / 180
    return None
