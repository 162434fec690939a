"""Positions as servos report them, and whether to believe them: a line may garble an answer so that it looks whole."""

import numpy as np

from hardware.joint_map import JointMap

_DOUBTFUL_RAD = 0.1  # a reading this far beyond what the joint's rate allows is asked again


class PlausiblePositions:
    """Filter of readings: one far from the latest, and from the last one that counted, counts if the next one agrees.

    Args:
        joints: Calibration of the joints, whose rates say how far is far.

    Attributes:
        doubts: Number of readings that were not believed, besides the first.
    """

    def __init__(self, joints: JointMap) -> None:
        self._reports = joints.column("readback")
        self._rates, self._scales = joints.column("max_rate"), joints.column("raw_per_rad")
        self._seen: tuple[list[int], float] | None = None
        self._believed: tuple[list[int], float] | None = None
        self.doubts = 0

    def believe(self, positions: list[int], now_s: float) -> bool:
        """Take a reading; return True if it counts.

        Args:
            positions: Raw positions, one per joint.
            now_s: Time of the reading [s].
        """
        earlier = [row for row in (self._seen, self._believed) if row is not None]
        near = not self._reports.any()
        for before, before_s in earlier:
            most_rad = _DOUBTFUL_RAD + 2 * (now_s - before_s) * self._rates
            step = np.abs(np.subtract(positions, before)) / self._scales
            near = near or bool((step <= most_rad)[self._reports].all())
        self._seen = positions, now_s
        if near:
            self._believed = self._seen
        elif earlier:
            self.doubts += 1
        return near
