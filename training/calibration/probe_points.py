"""Touches: what a calibration learns from. Joint readings, and where the tool's tip was measured to be."""

import csv
import math
import os
from typing import NamedTuple

import numpy as np

from jaxik.errors import FileFormatError

_TIP = ("x", "y", "z")


class Touches(NamedTuple):
    """Readings and measured tips, N of each.

    Attributes:
        q: Joint readings, ``(N, joint)`` [rad].
        tip: Measured tool points in the base frame, ``(N, 3)`` [m].
    """

    q: np.ndarray
    tip: np.ndarray


def load_touches(file: str | os.PathLike[str], joint_names: tuple[str, ...]) -> Touches:
    """Reads a comma-separated file of touches.

    The first line names the columns, in any order: every joint by its name, or as ``q1``, ``q2``, ...; and ``x``,
    ``y``, ``z`` of the tip. Radians and metres; a joint's column whose name ends in ``_deg`` holds degrees. Lines that
    are empty or begin with ``#`` are skipped.

    Args:
        file: File name.
        joint_names: The arm's joints, in order.

    Returns:
        The touches, in float64.

    Raises:
        FileFormatError: The file is not such a table; the message names file, line and what was expected.
        OSError: The file cannot be read.
    """
    name = os.fspath(file)
    with open(name, encoding="utf-8", newline="") as stream:
        try:
            text = stream.read()
        except UnicodeDecodeError as error:
            raise FileFormatError(f"{name}: not UTF-8 text (byte {error.start}), so not a table of touches") from None
    lines = [(i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip() and line.strip()[0] != "#"]
    expected = f"the columns {', '.join(joint_names)} (or q1 to q{len(joint_names)}; _deg for degrees) and x, y, z"
    if not lines:
        raise FileFormatError(f"{name}: the file is empty; expected {expected}")
    header = [cell.strip() for cell in next(csv.reader([lines[0][1]]))]
    columns = [_column(header, (joint, f"q{i}")) for i, joint in enumerate(joint_names, 1)]
    columns += [_column(header, (axis,)) for axis in _TIP]
    if any(column is None for column in columns) or len(header) != len(columns):
        raise FileFormatError(f"{name}:{lines[0][0]}: expected {expected}; got {', '.join(header)[:120]!r}")
    places, factors = zip(*(column for column in columns if column is not None), strict=True)
    rows = [_row(f"{name}:{i}", line, len(header)) for i, line in lines[1:]]
    if not rows:
        raise FileFormatError(f"{name}: no touches below the header")
    table = np.array(rows)[:, list(places)] * np.array(factors)
    return Touches(table[:, :-3], table[:, -3:])


def _column(header: list[str], names: tuple[str, ...]) -> tuple[int, float] | None:
    """Place of a column that goes by one of some names, and the factor to radians or metres."""
    for name in names:
        if header.count(name) == 1:
            return header.index(name), 1.0
        if name not in _TIP and header.count(f"{name}_deg") == 1:
            return header.index(f"{name}_deg"), math.pi / 180
    return None


def _row(where: str, line: str, count: int) -> list[float]:
    """One line's numbers."""
    cells = next(csv.reader([line]))
    if len(cells) != count:
        raise FileFormatError(f"{where}: expected {count} numbers; got {len(cells)}")
    try:
        row = [float(cell) for cell in cells]
    except ValueError:
        raise FileFormatError(f"{where}: expected numbers; got {line.strip()[:60]!r}") from None
    if not all(map(math.isfinite, row)):
        raise FileFormatError(f"{where}: a number is not finite")
    return row
