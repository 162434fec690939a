"""Servos that follow their commands with a lag, one servo frame after the other."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hardware.executor import FRAME_US

_LAG_S = 0.04  # a small servo follows its command with about two frames of delay
_FOLLOW = 1.0 - math.exp(-FRAME_US * 1e-6 / _LAG_S)


class Pulse(NamedTuple):
    """One servo frame of the board's log.

    Attributes:
        time_us: When, by the board's clock.
        commanded: Raw value of each servo.
        measured: Where each servo is, raw.
    """

    time_us: int
    commanded: np.ndarray
    measured: np.ndarray


class Servos:
    """Where the servos are.

    Args:
        positions: Raw values they stand at.
        steps: Farthest each goes in a frame.
        stuck: Which do not move.
    """

    def __init__(self, positions: Sequence[float], steps: Sequence[float], stuck: Sequence[bool]) -> None:
        self.positions = list(positions)
        self._steps, self._stuck = list(steps), list(stuck)

    def follow(self, commands: Sequence[float]) -> None:
        """One frame of 20 ms towards commands."""
        for j, (command, step, stuck) in enumerate(zip(commands, self._steps, self._stuck, strict=True)):
            if not stuck:
                self.positions[j] += min(max((command - self.positions[j]) * _FOLLOW, -step), step)
