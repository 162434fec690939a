"""Log of a playback in a file: commanded and measured joint angles of every status, as npz or csv.

The csv has the columns ``time``, ``phase``, ``commanded:<joint>`` and ``measured:<joint>`` [s, rad], with nothing in
place of what a servo without read-back does not tell. The npz has ``time``, ``phase``, ``commanded``, ``measured`` and
``joint_names``, as :class:`hardware.PlayLog`.
"""

import csv
import io
import os
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from hardware.report import LogRow
from jaxik.errors import FileFormatError

_ENDINGS = (".csv", ".npz")


class PlayLogFile:
    """A log that is written row by row, in constant memory, under a temporary name until it is complete.

    To be used in a ``with`` statement. Trouble while writing never ends a playback; see :attr:`trouble`.

    Args:
        file: File name, ending in ``.csv`` or ``.npz``; meanwhile it is written to the same name with ``.part``.
        joint_names: Joint names in order.

    Attributes:
        trouble: Sentence about what was not written and why; None if all is well.

    Raises:
        FileFormatError: Another ending.
        OSError: The file cannot be written there.
    """

    def __init__(self, file: str | os.PathLike[str], joint_names: tuple[str, ...]) -> None:
        self._file, self._part = Path(file), Path(f"{os.fspath(file)}.part")
        if self._file.suffix.lower() not in _ENDINGS:
            raise FileFormatError(
                f"{file}: expected a log's name to end in {' or '.join(_ENDINGS)}; got {self._file.suffix!r}"
            )
        if self._file.is_dir():
            raise IsADirectoryError(f"{file} is a folder; name a file in it for the log")
        self.trouble: str | None = None
        self._names, self._phases = joint_names, [""]
        self._as_csv = self._file.suffix.lower() == ".csv"
        try:
            self._out = self._part.open("wb", buffering=0)  # a crash leaves every row
        except OSError as error:
            raise OSError(error.errno, error.strerror, os.fspath(file)) from None
        if self._as_csv:
            columns = [f"{kind}:{name}" for kind in ("commanded", "measured") for name in joint_names]
            self._put(_line(["time", "phase", *columns]))

    def add(self, row: LogRow) -> None:
        """Write a row."""
        if self._as_csv:
            numbers = [*row.commanded.tolist(), *row.measured.tolist()]
            self._put(_line([row.time, row.phase, *("" if x != x else x for x in numbers)]))
        else:
            self._put(np.concatenate([[row.time, self._code(row.phase)], row.commanded, row.measured]).tobytes())

    def _put(self, data: bytes) -> None:
        if self.trouble is not None:
            return
        try:
            self._out.write(data)
        except (OSError, ValueError) as error:  # a row that comes too late finds the file closed
            self.trouble = f"the log {self._file} ends early: {error}; what there is of it is in {self._part}"

    def _code(self, phase: str) -> int:
        if phase not in self._phases:
            self._phases.append(phase)
        return self._phases.index(phase)

    def __enter__(self) -> "PlayLogFile":
        """Return the log itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Give the file its name."""
        try:
            self._out.close()
            if self.trouble is not None:
                return
            if not self._as_csv:
                self._pack()
            os.replace(self._part, self._file)
        except OSError as trouble:
            self.trouble = f"the log could not be written to {self._file}: {trouble}; it is in {self._part}"

    def _pack(self) -> None:
        """Make an npz of the rows, without loading them."""
        joints = len(self._names)
        width = 2 + 2 * joints
        empty = self._part.stat().st_size == 0
        rows = np.zeros((0, width)) if empty else np.memmap(self._part, np.float64, "r").reshape(-1, width)
        packed = Path(f"{self._part}.npz")
        np.savez(
            packed,
            time=rows[:, 0],
            phase=np.array(self._phases)[rows[:, 1].astype(int)],
            commanded=rows[:, 2 : 2 + joints],
            measured=rows[:, 2 + joints :],
            joint_names=np.array(self._names),
        )
        del rows  # Windows does not replace a file that is mapped
        os.replace(packed, self._part)


def _line(cells: list[Any]) -> bytes:
    """Return a line of a csv file."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(cells)
    return text.getvalue().encode()
