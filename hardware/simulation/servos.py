"""Servos that follow their commands with a lag, one servo frame at a time."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hardware.protocol import FRAME_US

_LAG_S = 0.04  # a small servo follows its command about two frames late
_FOLLOW = 1.0 - math.exp(-FRAME_US * 1e-6 / _LAG_S)


class ServoFrame(NamedTuple):
    """One servo frame of the board's log.

    Attributes:
        time_us: Board time of the frame [µs].
        commanded: Raw value commanded to each servo, ``(joint,)``.
        measured: Raw position of each servo, ``(joint,)``.
    """

    time_us: int
    commanded: np.ndarray
    measured: np.ndarray


class Servos:
    """Modeled servos.

    Args:
        positions: Raw values that they stand at.
        steps: Greatest raw change of each per frame.
        stuck: True for each servo that does not move.

    Attributes:
        positions: Present raw position of each.
    """

    def __init__(self, positions: Sequence[float], steps: Sequence[float], stuck: Sequence[bool]) -> None:
        self.positions = list(positions)
        self._steps, self._stuck = list(steps), list(stuck)

    def follow(self, commands: Sequence[float]) -> None:
        """Move for one frame of 20 ms towards raw commands."""
        for j, (command, step, stuck) in enumerate(zip(commands, self._steps, self._stuck, strict=True)):
            if not stuck:
                self.positions[j] += min(max((command - self.positions[j]) * _FOLLOW, -step), step)
