"""Path files: comma-separated poses or pointing targets."""

import csv
import math
import os
from pathlib import Path as FilePath

import jax.numpy as jnp
import numpy as np

from jaxik.atomic_file import write_atomically
from jaxik.errors import FileFormatError
from jaxik.paths.path import Path
from jaxik.targets import Pointing, Pose, matrix_from_wxyz, wxyz_from_matrix

POSE_HEADER = ("time", "x", "y", "z", "qw", "qx", "qy", "qz")
POINTING_HEADER = ("time", "x", "y", "z", "dx", "dy", "dz")
_UNIT_TOLERANCE = 1e-3  # three decimals are the coarsest rounding seen in published paths; more is a mistake


def load_path(file: str | os.PathLike[str]) -> Path:
    """Load a path from a comma-separated file.

    The first line names the columns: ``time,x,y,z,qw,qx,qy,qz`` for poses (quaternion with the scalar first) or
    ``time,x,y,z,dx,dy,dz`` for pointing targets; seconds and meters. Without the column ``time`` the path is paced, see
    :meth:`jaxik.Path.paced`. Lines that are empty or begin with ``#`` are skipped. Quaternions and directions are
    normalized.

    Args:
        file: File name.

    Returns:
        The path, in JAX's default float type.

    Raises:
        FileFormatError: The file is not such a table; the message names file, line, and what was expected.
        OSError: The file cannot be read.
    """
    name = os.fspath(file)
    text = _read_text(name)
    lines = [
        (number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip() and line.strip()[0] != "#"
    ]
    if not lines:
        raise FileFormatError(f"{name}: the file is empty; expected the header {','.join(POSE_HEADER)}")
    header = tuple(cell.strip().lower() for cell in next(csv.reader([lines[0][1]])))
    timed = header[:1] == ("time",)
    if (header if timed else ("time", *header)) not in (POSE_HEADER, POINTING_HEADER):
        raise FileFormatError(
            f"{name}:{lines[0][0]}: expected the header {','.join(POSE_HEADER)} or {','.join(POINTING_HEADER)}; "
            f"got {lines[0][1].strip()[:80]!r}"
        )
    if len(lines) < 3:
        raise FileFormatError(f"{name}: a path needs at least 2 rows below the header; got {len(lines) - 1}")
    rows = []
    for number, line in lines[1:]:
        row = _row(f"{name}:{number}", line, header)
        if timed and rows and row[0] <= rows[-1][0]:
            raise FileFormatError(f"{name}:{number}: expected a time after {rows[-1][0]!r} s; got {row[0]!r} s")
        rows.append(row)
    table = np.asarray(rows)
    position, turn = np.split(table[:, int(timed) :], [3], axis=1)
    turn = turn / np.linalg.norm(turn, axis=1, keepdims=True)
    if "qw" in header:
        target = Pose(jnp.asarray(position), jnp.asarray(matrix_from_wxyz(turn)))
    else:
        target = Pointing(jnp.asarray(position), jnp.asarray(turn))
    return Path(target, jnp.asarray(table[:, 0])) if timed else Path.paced(target)


def save_path(path: Path, file: str | os.PathLike[str]) -> None:
    """Save a path so that :func:`load_path` reads it back.

    Args:
        path: The path.
        file: File name; an existing file is replaced as a whole, so that a reader never sees half of it.

    Raises:
        ValueError: The path is not valid, see :meth:`jaxik.Path.checked`.
        OSError: The file cannot be written.
    """
    if not isinstance(path, Path):
        raise ValueError(f"expected a jaxik.Path, got {type(path).__name__}; the order is save_path(path, file)")
    path = path.checked()
    if isinstance(path.target, Pose):
        header, turn = POSE_HEADER, wxyz_from_matrix(np.asarray(path.target.rotation, float))
    else:
        header, turn = POINTING_HEADER, np.asarray(path.target.direction, float)
        turn = turn / np.linalg.norm(turn, axis=-1, keepdims=True)
    table = np.concatenate([np.asarray(path.time, float)[:, None], np.asarray(path.target.position, float), turn], 1)
    rows = (",".join(map(repr, map(float, row))) for row in table)
    write_atomically(file, "\n".join([",".join(header), *rows, ""]))


def _read_text(name: str) -> str:
    """Return the file's text."""
    try:
        return FilePath(name).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{name}: expected a text file of comma-separated numbers; it is not UTF-8") from error


def _row(where: str, line: str, header: tuple[str, ...]) -> list[float]:
    """Return a line's finite numbers, with a unit quaternion or a direction of some length."""
    cells = [cell.strip() for cell in line.split(",")]
    if len(cells) != len(header):
        raise FileFormatError(f"{where}: expected {len(header)} numbers ({','.join(header)}); got {len(cells)}")
    row = []
    for column, cell in zip(header, cells, strict=True):
        try:
            row.append(float(cell))
        except ValueError:
            raise FileFormatError(f"{where}: expected a number for {column}; got {cell[:40]!r}") from None
        if not math.isfinite(row[-1]):
            raise FileFormatError(f"{where}: expected a finite number for {column}; got {cell[:40]!r}")
    size = math.sqrt(sum(x * x for x in row[header.index("z") + 1 :]))
    if "qw" in header and abs(size - 1) > _UNIT_TOLERANCE:
        raise FileFormatError(f"{where}: expected a unit quaternion qw,qx,qy,qz; its length is {size:.6g}")
    if "dx" in header and size < _UNIT_TOLERANCE:
        raise FileFormatError(f"{where}: expected a direction dx,dy,dz with some length; its length is {size:.6g}")
    return row
