"""A running fit of the board's clock against the host's.

Each status tells what the board's clock showed at some moment between question and answer. A resonator is off by up to
half a percent, so the fit is a line, not an offset. The later an answer, the less it tells: prompt answers weigh most.
"""

import numpy as np

_SAMPLES = 256  # at 25 answers per second, ten seconds: long enough for the slope, short enough to follow warming up
_LEAST_SPAN_S = 0.7  # over a shorter span the slope would be noise
_PROMPT_S = 0.001  # an answer this much later than the promptest has a quarter of its weight
_MOST_SKEW = 0.01


class ClockFit:
    """Map from the host's time [s] to the board's [µs].

    Attributes:
        rate: Board microseconds per host microsecond, as fitted last.
    """

    def __init__(self) -> None:
        self.rate = 1.0
        self._samples, self._count = np.empty((3, _SAMPLES)), 0  # host time, half a round trip, board µs: the latest
        self._wraps, self._last = 0, 0
        self._host_s, self._board_us = 0.0, 0.0  # one point of the line
        self._stale = False

    def add(self, asked_s: float, answered_s: float, board_us: int) -> None:
        """Add one answer.

        Args:
            asked_s: Host time of the question [s].
            answered_s: Host time of the answer [s].
            board_us: The board's 32-bit clock in the answer [µs].
        """
        if board_us < self._last - 2**31:
            self._wraps += 1
        self._last = board_us
        unwrapped = board_us + self._wraps * 2**32
        self._samples[:, self._count % _SAMPLES] = (asked_s + answered_s) / 2, (answered_s - asked_s) / 2, unwrapped
        self._count += 1
        self._stale = True

    def board_us(self, host_s: float) -> float:
        """Return the board's clock [µs] at a host's time [s]."""
        self._refit()
        return self._board_us + 1e6 * self.rate * (host_s - self._host_s)

    def _refit(self) -> None:
        if not self._stale:
            return
        self._stale = False
        host, half, board = self._samples[:, : self._count]
        weight = (1 + (half - half.min()) / (_PROMPT_S / 2)) ** -2
        weight /= weight.sum()
        host_mean, board_mean = float(weight @ host), float(weight @ board)
        variance = float(weight @ (host - host_mean) ** 2)
        if np.ptp(host) >= _LEAST_SPAN_S and variance >= (_LEAST_SPAN_S / 4) ** 2:
            slope = float(weight @ ((host - host_mean) * (board - board_mean))) / variance * 1e-6
            self.rate = min(max(slope, 1 - _MOST_SKEW), 1 + _MOST_SKEW)
        self._host_s, self._board_us = host_mean, board_mean
