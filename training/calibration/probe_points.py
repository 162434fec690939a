"""Probe points: joint readings with measured tip positions, the data of a calibration."""

import math
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxik.errors import FileFormatError
from jaxik.tables import decoded, divided, number, trimmed

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
    name = os.fspath(file)
    try:
        divider, table = divided(decoded(Path(name).read_bytes()))
    except ValueError as error:
        raise FileFormatError(f"{name}: expected a table of probe points; {error}") from None
    expected = f"the columns {', '.join(joint_names)} (or q1 to q{len(joint_names)}; _deg for degrees) and x, y, z"
    if not table:
        raise FileFormatError(f"{name}: expected {expected}, got an empty file")
    header = [cell.strip() for cell in trimmed(table[0].cells)]
    columns = [_column(header, (joint, f"q{i}")) for i, joint in enumerate(joint_names, 1)]
    columns += [_column(header, (axis,)) for axis in _TIP]
    if any(column is None for column in columns) or len(header) != len(columns):
        raise FileFormatError(f"{name}:{table[0].number}: expected {expected}, got {', '.join(header)[:120]!r}")
    places, factors = zip(*(column for column in columns if column is not None), strict=True)
    rows = [_row(f"{name}:{row.number}", trimmed(row.cells), divider, len(header)) for row in table[1:]]
    if not rows:
        raise FileFormatError(f"{name}: expected probe points below the header, got none")
    values = np.array(rows)[:, list(places)] * np.array(factors)
    return ProbePoints(values[:, :-3], values[:, -3:])


def _column(header: list[str], names: tuple[str, ...]) -> tuple[int, float] | None:
    """Index of the column with one of the given names, and the factor to radians or meters."""
    for name in names:
        if header.count(name) == 1:
            return header.index(name), 1.0
        if name not in _TIP and header.count(f"{name}_deg") == 1:
            return header.index(f"{name}_deg"), math.pi / 180
    return None


def _row(where: str, cells: list[str], divider: str, count: int) -> list[float]:
    """Parse the numbers of one row."""
    if len(cells) != count:
        raise FileFormatError(f"{where}: expected {count} numbers, got {len(cells)}")
    shown = f"{divider.join(cells)[:60]!r}"
    try:
        row = [number(cell, divider) for cell in cells]
    except ValueError:
        raise FileFormatError(f"{where}: expected numbers, got {shown}") from None
    if not all(map(math.isfinite, row)):
        raise FileFormatError(f"{where}: expected finite numbers, got {shown}")
    return row
