"""Text and tables as other programs write them: encodings, separators, quotes, decimal commas."""

import codecs
import csv
import io
import os
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxik.errors import FileFormatError

SEPARATORS = (",", ";", "\t")

_UTF16_MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
_DECIMAL_COMMA = re.compile(r"\s*([+-]?\d*),(\d*(?:[eE][+-]?\d+)?)\s*")


class Row(NamedTuple):
    """A row of a table.

    Attributes:
        number: Line of the file in which the row ends, counted from 1.
        cells: Cells without quotes.
    """

    number: int
    cells: list[str]


def decoded(data: bytes) -> str:
    """Return text in UTF-8 or UTF-16, with or without a byte order mark, else in Windows' western encoding.

    Args:
        data: Content of a text file.

    Raises:
        ValueError: It is text in none of them.
    """
    if data.startswith(_UTF16_MARKS):
        encodings = ("utf-16",)
    elif b"\0" in data[:2]:  # every second byte of a text in Latin letters
        encodings = ("utf-16-le" if data[1:2] == b"\0" else "utf-16-be",)
    else:
        encodings = ("utf-8-sig", "cp1252")
    for encoding in encodings:
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            continue
        # Tables and descriptions hold ASCII digits and names; bytes that hold none are no text.
        if "\0" not in text and (not text or any(c < "\x80" for c in text)):
            return text.removeprefix("\ufeff")
    raise ValueError("it is neither UTF-8 nor UTF-16")


def separator(header: str) -> str:
    """Return the separator that divides a header into most cells: comma, semicolon or tab.

    Args:
        header: Line with the names of the columns.
    """
    return max(SEPARATORS, key=header.count)


def divided(text: str) -> tuple[str, list[Row]]:
    """Return the separator of a table and its rows, the header first.

    Args:
        text: The table; empty lines and lines that begin with ``#`` are skipped.

    Raises:
        ValueError: A quoted cell does not end.
    """
    lines = (line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#"))
    divider = separator(next(lines, ""))
    return divider, list(table_rows(text, divider))


def table_rows(text: str, divider: str, *, first_line: int = 1, comments: bool = True) -> Iterator[Row]:
    """Iterate over the rows of a table, without those that are empty.

    Args:
        text: The table.
        divider: Separator of the cells.
        first_line: Number of the text's first line in the file.
        comments: Skip lines that begin with ``#``.

    Raises:
        ValueError: A quoted cell does not end.
    """
    reader = csv.reader(io.StringIO(text, newline=None), delimiter=divider)
    try:
        for cells in reader:
            if any(map(str.strip, cells)) and not (comments and cells[0].lstrip().startswith("#")):
                yield Row(first_line - 1 + reader.line_num, cells)
    except csv.Error as error:
        raise ValueError(f"line {first_line - 1 + reader.line_num}: {error}; check the quotes") from None


def trimmed(cells: list[str]) -> list[str]:
    """Return the cells without the empty ones at the end, which separators at the end of a line leave.

    Args:
        cells: Cells of a row.
    """
    count = len(cells)
    while count and not cells[count - 1].strip():
        count -= 1
    return cells[:count]


def number(cell: str, divider: str) -> float:
    """Return the number in a cell; beside separators other than the comma, the comma is a decimal sign.

    Args:
        cell: The cell.
        divider: Separator of the cells.

    Raises:
        ValueError: It is no number.
    """
    try:
        return float(plain_number(cell, divider))
    except ValueError:
        raise ValueError(f"expected a number; got {cell[:40]!r}") from None


def plain_number(cell: str, divider: str) -> str:
    """Return the text of a number with a decimal point (see :func:`number`).

    Raises:
        ValueError: It contains what Python alone takes for a number.
    """
    if divider != "," and (found := _DECIMAL_COMMA.fullmatch(cell)):
        return f"{found[1]}.{found[2]}"
    if "_" in cell:
        raise ValueError(f"expected a number; got {cell[:40]!r}")
    return cell


def load_columns(
    file: str | os.PathLike[str], find: Callable[[list[str]], Sequence[int] | None], expected: str
) -> tuple[np.ndarray, list[int]]:
    """Read finite numbers from some columns of a table.

    Args:
        file: File name.
        find: Function of the header's cells that returns the columns to read; None if it lacks one of them.
        expected: Description of the columns, for messages.

    Returns:
        The numbers, ``(row, column)``, and the line of each row.

    Raises:
        FileFormatError: The file has another format; the message names file, line and expected content.
        OSError: The file cannot be read.
    """
    name = os.fspath(file)
    try:
        divider, table = divided(decoded(Path(name).read_bytes()))
    except ValueError as error:
        raise FileFormatError(f"{name}: expected a table with {expected}; {error}") from None
    if not table:
        raise FileFormatError(f"{name}: expected {expected}, got an empty file")
    header = [cell.strip() for cell in trimmed(table[0].cells)]
    places = find(header)
    if places is None:
        raise FileFormatError(f"{name}:{table[0].number}: expected {expected}, got {', '.join(header)[:120]!r}")
    values = np.empty((len(table) - 1, len(places)))
    for i, row in enumerate(table[1:]):
        where, cells = f"{name}:{row.number}: expected", trimmed(row.cells)
        shown = f"got {divider.join(cells)[:60]!r}"
        if not max(places) < len(cells) <= len(header):
            raise FileFormatError(f"{where} {len(header)} numbers, got {len(cells)}")
        try:
            values[i] = [number(cells[place], divider) for place in places]
        except ValueError:
            raise FileFormatError(f"{where} numbers, {shown}") from None
        if not np.isfinite(values[i]).all():
            raise FileFormatError(f"{where} finite numbers, {shown}")
    return values, [row.number for row in table[1:]]
