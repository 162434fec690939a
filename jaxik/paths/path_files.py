"""Path files: comma-separated poses or pointing targets, and the messages of ROS 2 that hold poses."""

import math
import os
from collections.abc import Mapping, Sequence
from decimal import Decimal
from pathlib import Path as FilePath

import jax.numpy as jnp
import numpy as np

from jaxik.atomic_file import write_atomically
from jaxik.errors import FileFormatError
from jaxik.paths.file_limits import LARGEST, UNIT_TOLERANCE
from jaxik.paths.path import Path
from jaxik.paths.ros_path import is_message_file, load_message, save_message
from jaxik.tables import Row, decoded, divided, number, plain_number, trimmed
from jaxik.targets import Pointing, Pose, matrix_from_wxyz, wxyz_from_matrix

POSE_HEADER = ("time", "x", "y", "z", "qw", "qx", "qy", "qz")
POINTING_HEADER = ("time", "x", "y", "z", "dx", "dy", "dz")
_INDEX = ("", "index", "unnamed: 0")  # names that data frames give to the numbers of their rows


def load_path(file: str | os.PathLike[str], *, columns: Mapping[str, str] | None = None) -> Path:
    """Load a path from a comma-separated file, or from a message of ROS 2.

    The first line names the columns: ``time,x,y,z,qw,qx,qy,qz`` for poses (quaternion with the scalar first) or
    ``time,x,y,z,dx,dy,dz`` for pointing targets; seconds and meters. Without the column ``time`` the path is paced, see
    :meth:`jaxik.Path.paced`. Lines that are empty or begin with ``#`` are skipped. Quaternions and directions are
    normalized.

    Times count from the first row, so that time stamps since 1970 lose nothing in float32. Tables of other programs
    are read too: semicolons (then with decimal commas) or tabs instead of commas, quoted cells, UTF-16, the row numbers
    of a data frame in front of the columns, and numbers instead of names, which stand for the columns above in order.
    With ``columns`` the file's own names are taken, and its further columns are left out.

    A file ending in ``.yaml`` or ``.ros.json`` holds a nav_msgs/Path or a geometry_msgs/PoseArray.

    Args:
        file: File name.
        columns: Names in the file of the columns above, such as ``{"time": "t", "x": "tool_x"}``; those that are not
            named here have the names above. None for a file with the names above only.

    Returns:
        The path, where the file has it, in JAX's default float type.

    Raises:
        FileFormatError: The file is not such a table; the message names file, line, and what was expected.
        OSError: The file cannot be read.
        ValueError: ``columns`` names a column that is none of the above.
    """
    name = os.fspath(file)
    if is_message_file(name):
        return load_message(name)
    try:
        divider, table = divided(_read_text(name))
        if columns is not None and table:
            table = _selected(table, columns)
        names, shift = _columns(table[0].cells, table[1:], divider) if table else ((), 0)
    except FileFormatError:
        raise
    except ValueError as error:
        raise FileFormatError(f"{name}: {error}") from None
    if not table:
        raise FileFormatError(f"{name}: the file is empty; expected the header {','.join(POSE_HEADER)}")
    header, *rows = table
    if not names:
        raise FileFormatError(
            f"{name}:{header.number}: expected the header {','.join(POSE_HEADER)} or {','.join(POINTING_HEADER)}; "
            f"got {divider.join(header.cells)[:80]!r}"
        )
    if len(rows) < 2:
        raise FileFormatError(f"{name}: a path needs at least 2 rows below the header; got {len(rows)}")
    values = np.asarray([_numbers(f"{name}:{row.number}", row.cells[shift:], names, divider) for row in rows])
    order = [names.index(c) for c in (POSE_HEADER if "qw" in names else POINTING_HEADER)[1:]]
    position, turn = np.split(values[:, order], [3], axis=1)
    turn = turn / np.linalg.norm(turn, axis=1, keepdims=True)
    if "qw" in names:
        target = Pose(jnp.asarray(position), jnp.asarray(matrix_from_wxyz(turn)))
    else:
        target = Pointing(jnp.asarray(position), jnp.asarray(turn))
    if "time" in names:
        path = Path(target, jnp.asarray(_times(name, rows, shift + names.index("time"), divider)))
    else:
        path = Path.paced(target)
    try:
        return path.checked()
    except ValueError as error:  # of numbers that are told apart in the file, but not in JAX's float type
        raise FileFormatError(f"{name}: {error}") from None


def save_path(path: Path, file: str | os.PathLike[str]) -> None:
    """Save a path so that :func:`load_path` reads it back, with times from the first waypoint on.

    Args:
        path: The path.
        file: File name; an existing file is replaced as a whole, so that a reader never sees half of it. With the
            ending ``.yaml`` or ``.ros.json`` a nav_msgs/Path of ROS 2 is written, which holds poses only.

    Raises:
        ValueError: The path is not valid, see :meth:`jaxik.Path.checked`; or pointing targets are to be a message.
        OSError: The file cannot be written.
    """
    if not isinstance(path, Path):
        raise ValueError(f"expected a jaxik.Path, got {type(path).__name__}; the order is save_path(path, file)")
    path = path.checked()
    if is_message_file(os.fspath(file)):
        return save_message(path, os.fspath(file))
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
        return decoded(FilePath(name).read_bytes())
    except ValueError as error:
        raise FileFormatError(f"{name}: expected a text file of comma-separated numbers; {error}") from None


def _selected(table: Sequence[Row], renamed: Mapping[str, str]) -> list[Row]:
    """Return the columns of a table that make a path, under the names used here."""
    known = dict.fromkeys((*POSE_HEADER, *POINTING_HEADER))
    for ours in renamed:
        if ours not in known:
            raise ValueError(f"columns name {', '.join(known)}; got {ours!r}")
    header = [cell.strip() for cell in table[0].cells]
    places = {}
    for ours in known:
        theirs = renamed.get(ours, ours)
        if header.count(theirs) == 1:
            places[ours] = header.index(theirs)
        elif ours in renamed:
            raise ValueError(f"expected one column {theirs!r} in the header; got {', '.join(header)[:120]}")
    wide = max(places.values(), default=0)
    short = next((row for row in table[1:] if len(row.cells) <= wide), None)
    if short is not None:
        raise ValueError(f"line {short.number}: expected {len(header)} cells; got {len(short.cells)}")
    chosen = _shape_of(places)
    return [Row(table[0].number, list(chosen))] + [
        Row(row.number, [row.cells[places[column]] for column in chosen]) for row in table[1:]
    ]


def _shape_of(found: Mapping[str, int]) -> tuple[str, ...]:
    """Return the columns of poses if all of them are there, else those of pointing targets, else all that are."""
    for header in (POSE_HEADER, POINTING_HEADER):
        if all(column in found for column in header[1:]):
            return header if "time" in found else header[1:]
    return tuple(found)


def _columns(header: Sequence[str], rows: Sequence[Row], divider: str) -> tuple[tuple[str, ...], int]:
    """Return the names of the columns, empty if unknown, and how many columns of row numbers stand before them."""
    names = tuple(cell.strip().lower() for cell in trimmed(list(header)))
    shift = int(bool(names) and names[0] in _INDEX)
    names = names[shift:]
    for known in (POSE_HEADER, POINTING_HEADER):
        for expected in (known, known[1:]):
            if sorted(names) == sorted(expected):
                return names, shift
    if names != tuple(map(str, range(len(names)))):
        return (), 0
    if len(names) == 7:
        return _seven(rows, shift, divider), shift
    return {8: POSE_HEADER, 6: POINTING_HEADER[1:]}.get(len(names), ()), shift


def _seven(rows: Sequence[Row], shift: int, divider: str) -> tuple[str, ...]:
    """Return the names of seven columns without names: poses if four numbers are a quaternion, else timed pointings."""
    try:
        table = np.array([[number(cell, divider) for cell in row.cells[shift : shift + 7]] for row in rows])
    except ValueError:  # the line is named where its numbers are read
        return POSE_HEADER[1:]
    with np.errstate(all="ignore"):  # of numbers that are refused where they are read
        unit = np.abs(np.linalg.norm(table[:, 3:], axis=1) - 1) <= UNIT_TOLERANCE
        rising = np.diff(table[:, 0]) > 0
    poses = bool(len(rows) and unit.all())
    if poses and (table[:, 3] == 0).all() and rising.all():
        raise ValueError(
            "seven columns without names may be poses or times and pointing targets; name them in a header"
        )
    return POSE_HEADER[1:] if poses else POINTING_HEADER


def _numbers(where: str, cells: Sequence[str], columns: tuple[str, ...], divider: str) -> list[float]:
    """Return a row's finite numbers, with a unit quaternion or a direction of some length."""
    if len(cells) < len(columns) or trimmed(list(cells[len(columns) :])):
        raise FileFormatError(f"{where}: expected {len(columns)} numbers ({','.join(columns)}); got {len(cells)}")
    row = []
    for column, cell in zip(columns, cells, strict=False):
        try:
            row.append(number(cell, divider))
        except ValueError:
            raise FileFormatError(f"{where}: expected a number for {column}; got {cell[:40]!r}") from None
        if not abs(row[-1]) <= LARGEST:
            raise FileFormatError(f"{where}: expected a finite number for {column}; got {cell[:40]!r}")
    turn = [x for column, x in zip(columns, row, strict=True) if column[0] in "qd"]
    size = math.hypot(*turn)
    if "qw" in columns and abs(size - 1) > UNIT_TOLERANCE:
        raise FileFormatError(f"{where}: expected a unit quaternion qw,qx,qy,qz; its length is {size:.6g}")
    if "dx" in columns and size < UNIT_TOLERANCE:
        raise FileFormatError(f"{where}: expected a direction dx,dy,dz with some length; its length is {size:.6g}")
    return row


def _times(name: str, rows: Sequence[Row], at: int, divider: str) -> np.ndarray:
    """Return the times since the first row, ``(K,)`` [s], subtracted as they are printed, before any rounding."""
    texts = [plain_number(row.cells[at], divider) for row in rows]
    start = Decimal(texts[0])
    times = [float(Decimal(text) - start) for text in texts]
    for row, before, text, earlier, time in zip(rows[1:], texts, texts[1:], times, times[1:], strict=False):
        if time <= earlier:
            raise FileFormatError(
                f"{name}:{row.number}: expected a time after {float(before)!r} s; got {float(text)!r} s"
            )
    return np.asarray(times)
