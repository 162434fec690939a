"""The file of a guided calibration: continued where it was left, and saved after every answer."""

import errno
import os
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from hardware.errors import CalibrationError
from hardware.estimates import estimated
from hardware.joint_map import NOT_MEASURED, JointMap
from hardware.joint_map_file import load_joint_map, save_joint_map

TEMPLATE = "meccanoid.toml"


class CalibrationFile:
    """A calibration file that a dialogue fills joint by joint.

    Args:
        file: TOML file; one that exists is continued.
        template: Calibration to start a new file from; None for the Meccanoid's, or for the file itself.
        names: Joints to calibrate; none for those that have estimates, or all of a new file.
        practice: True to refuse a file with measured numbers.

    Attributes:
        chosen: Calibration of the joints to calibrate, in order.
        continued: True if the file existed.

    Raises:
        CalibrationError: The file or the template is no calibration, or lacks a joint.
        OSError: The file cannot be written; better known before the work than after it.
    """

    def __init__(
        self, file: str | os.PathLike[str], template: str | None, names: Sequence[str], practice: bool
    ) -> None:
        self._file = Path(file)
        self.continued = self._file.exists()
        if self.continued and template is not None:
            raise CalibrationError(
                f"{self._file} exists and is continued, so --template does not apply; for a new start remove it, or "
                "name another file"
            )
        _check_writable(self._file)
        self._whole = load_joint_map(os.path.abspath(file) if self.continued else template or TEMPLATE)
        if practice and any(joint.measured != NOT_MEASURED for joint in self._whole.joints):
            raise CalibrationError(
                f"{self._file} holds measured numbers, which practice on the simulated board would overwrite; name "
                "another file, or the board with --board"
            )
        if self.continued and not set(names) <= set(self._whole.names):
            more = load_joint_map(TEMPLATE).joints
            added = tuple(joint for joint in more if joint.name in set(names) - set(self._whole.names))
            self._whole = JointMap(self._whole.robot, self._whole.joints + added)
        unfinished = [joint.name for joint in self._whole.joints if joint.estimates()]
        self.chosen = self._whole.select(names or (unfinished if self.continued else self._whole.names))

    def keep(self, joints: JointMap) -> None:
        """Save the calibration of some joints beside that of the others.

        Args:
            joints: New calibration of joints of the file.

        Raises:
            OSError: The file cannot be written.
        """
        new = {joint.name: joint for joint in joints.joints}
        self._whole = replace(self._whole, joints=tuple(new.get(row.name, row) for row in self._whole.joints))
        save_joint_map(self._whole, self._file)

    def summary(self) -> str:
        """Return in one sentence which joints are measured, and which have estimates."""
        count = len(self._whole.joints)
        done = sum(not joint.estimates() for joint in self._whole.joints)
        rest = f"; estimates: {estimated(self._whole)}" if done < count else ""
        return f"{self._file}: {done} of {count} joints measured{rest}"


def _check_writable(file: Path) -> None:
    """Raise OSError if a file could not be written."""
    if file.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), os.fspath(file))
    try:
        with tempfile.TemporaryFile(dir=Path(os.path.realpath(file)).parent):
            pass
    except OSError as error:
        raise OSError(error.errno, error.strerror, os.fspath(file)) from None
