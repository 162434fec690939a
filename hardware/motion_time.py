"""A motion's time as the host planned it, in the board's own microseconds."""

import struct

from hardware.clock_fit import ClockFit
from hardware.device import Waypoint

_MOST_CORRECTION = 0.01  # of the time between waypoints: what a better fit of the clock may shift without being felt


class MotionTime:
    """Converts waypoint times, one after the other, with the best fit of the clock at each.

    A better fit must not make a jump: a correction is spread so that the motion runs at most 1 % faster or slower.
    """

    def __init__(self) -> None:
        self._start_s: float | None = None
        self._start_us = 0.0
        self._last_host_us, self._last_board_us = 0, 0.0

    def begin(self, host_s: float, fit: ClockFit) -> int:
        """Sets the host's moment of time zero; returns the board's, in 32 bits."""
        self._start_s, self._start_us = host_s, fit.board_us(host_s)
        return round(self._start_us) % 2**32

    def pack(self, layout: str, point: Waypoint, fit: ClockFit) -> bytes:
        """A waypoint as it goes on the wire."""
        return struct.pack(layout, round(self.board_us(point.time_us, fit)) % 2**32, *point.raw)

    def board_us(self, motion_us: int, fit: ClockFit) -> float:
        """The board's time since the motion's zero; to be asked in rising order."""
        gap = motion_us - self._last_host_us
        planned = self._last_board_us + gap * fit.rate
        if self._start_s is not None:
            wanted = fit.board_us(self._start_s + 1e-6 * motion_us) - self._start_us
            most = _MOST_CORRECTION * gap
            planned += min(max(wanted - planned, -most), most)
        self._last_host_us, self._last_board_us = motion_us, planned
        return planned
