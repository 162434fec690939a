"""Times of a motion, from the host's plan to the board's own microseconds."""

import struct

from hardware.board import Waypoint
from hardware.clock_fit import ClockFit

_MOST_CORRECTION = 0.01  # of the time between waypoints: a change of speed too small to notice


class MotionTime:
    """Board times of one motion's waypoints, in order, each by the latest fit of the board's clock.

    A new fit must not cause a jump: corrections are spread, so that the motion runs at most 1 % faster or slower.
    """

    def __init__(self) -> None:
        self._start_s: float | None = None
        self._start_us = 0.0
        self._last_host_us, self._last_board_us = 0, 0.0

    def begin(self, host_s: float, fit: ClockFit) -> int:
        """Set the motion's zero to a host time [s]; return the board's 32-bit time of it [µs]."""
        self._start_s, self._start_us = host_s, fit.board_us(host_s)
        return round(self._start_us) % 2**32

    def pack(self, layout: str, point: Waypoint, fit: ClockFit) -> bytes:
        """Return a waypoint's bytes in a WAYPOINTS message; call in the order of the waypoints.

        Args:
            layout: Struct format of time and values.
            point: Next waypoint.
            fit: Latest fit of the board's clock.
        """
        return struct.pack(layout, round(self._board_us(point.time_us, fit)) % 2**32, *point.raw)

    def _board_us(self, motion_us: int, fit: ClockFit) -> float:
        """Convert a time since the motion's zero [µs] to the board's clock."""
        gap = motion_us - self._last_host_us
        planned = self._last_board_us + gap * fit.rate
        if self._start_s is not None:
            wanted = fit.board_us(self._start_s + 1e-6 * motion_us) - self._start_us
            most = _MOST_CORRECTION * gap
            planned += min(max(wanted - planned, -most), most)
        self._last_host_us, self._last_board_us = motion_us, planned
        return planned
