"""File of a recording by hand, which is kept whatever happens: a crash, a full disk, a folder that is gone."""

import os
import tempfile
from pathlib import Path
from time import strftime

import numpy as np

from hardware.joint_map import JointMap
from jaxik.errors import FileFormatError
from jaxik.trajectories import Trajectory

_ENDINGS = (".npz", ".csv", ".json")


class RecordingFile:
    """Trajectory file that a recording is going to be written to.

    Meanwhile every posture goes at once to a file beside it, a trajectory too, which is deleted when the recording is
    safe.

    Args:
        file: File name, ending in ``.npz``, ``.csv`` or ``.json``.
        joints: Calibration of the robot.

    Attributes:
        raw: File with the postures as they came, before smoothing.

    Raises:
        FileFormatError: Another ending.
        OSError: Nothing can be written there.
    """

    def __init__(self, file: str | os.PathLike[str], joints: JointMap) -> None:
        self.file, self._joints = Path(file), joints
        if self.file.suffix.lower() not in _ENDINGS:
            raise FileFormatError(
                f"{file}: expected a trajectory's name to end in {', '.join(_ENDINGS)}; got {self.file.suffix!r}"
            )
        if self.file.is_dir():
            raise IsADirectoryError(f"{file} is a folder; name a file in it")
        self.raw = self.file.with_name(f"{self.file.stem}.part.csv")
        try:
            self._out = self.raw.open("w", encoding="utf-8")  # finds out now whether the place can be written to
        except OSError as error:
            raise OSError(error.errno, error.strerror, os.fspath(file)) from None
        self._begun = self._failed = False

    def add(self, time: float, posture: np.ndarray) -> None:
        """Keep a posture; a disk that is full is no reason to end a recording.

        Args:
            time: Time since the start [s].
            posture: Joint angles, ``(joint,)`` [rad].
        """
        if self._failed:
            return
        try:
            if not self._begun:
                self._out.close()
                notes = ("recorded by hand, as measured: neither smoothed nor within limits",)
                Trajectory(
                    np.array([time]), posture[None], self._joints.names, arm_name=self._joints.robot, notes=notes
                ).save(self.raw)
                self._out = self.raw.open("a", buffering=1, encoding="utf-8")
                self._begun = True
            else:
                self._out.write(",".join(map(repr, [time, *posture.tolist()])) + "\n")
        except (OSError, ValueError):
            self._failed = True  # the posture is still in memory

    def save(self, trajectory: Trajectory) -> Path:
        """Write the finished recording to the file, or elsewhere if that fails.

        Args:
            trajectory: The recording.

        Returns:
            File that it is in.

        Raises:
            OSError: It could be written nowhere; says where the raw postures are.
        """
        name = f"jaxik-recording-{strftime('%Y%m%d-%H%M%S')}{self.file.suffix}"
        trouble: OSError | None = None
        for place in (self.file, Path.home() / name, Path(tempfile.gettempdir()) / name):
            try:
                trajectory.save(place)
            except OSError as error:
                trouble = trouble or error
            else:
                self._discard()
                return place
        raise OSError(f"{self.file}: {trouble}; the recording is, as far as it could be written, in {self.raw}")

    def close(self) -> None:
        """Leave the raw postures where they are if there are any."""
        if self._begun:
            self._out.close()
        else:
            self._discard()

    def _discard(self) -> None:
        try:
            self._out.close()
            self.raw.unlink(missing_ok=True)
        except OSError:
            pass  # an extra file does no harm
