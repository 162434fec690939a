"""The board's clock as seen from the host's, fitted to what its answers say, for as long as they come.

An answer tells what the board's clock showed at some moment between question and answer. A resonator is off by up to
half a percent, so a line is fitted, not an offset; and because a late answer says little, the promptest count most.
"""

import numpy as np

_KEPT = 256  # at 25 answers a second, ten seconds: long enough for the slope, short enough to follow warming up
_SPAN_S = 0.7  # over less than this, noise would make a slope
_PROMPT_S = 0.001  # an answer later by this than the promptest counts a quarter
_WORST_SKEW = 0.01


class ClockFit:
    """Maps the host's time [s] to the board's [µs]."""

    def __init__(self) -> None:
        self._samples, self._taken = np.empty((3, _KEPT)), 0  # host time, half a round trip, board µs: the latest
        self._turns, self._last = 0, 0
        self._at, self._board_us, self.rate = 0.0, 0.0, 1.0
        self._stale = False

    def add(self, asked_s: float, answered_s: float, board_us: int) -> None:
        """One answer: when it was asked for, when it came, what the board's 32-bit clock showed."""
        if board_us < self._last - 2**31:
            self._turns += 1
        self._last = board_us
        whole = board_us + self._turns * 2**32
        self._samples[:, self._taken % _KEPT] = (asked_s + answered_s) / 2, (answered_s - asked_s) / 2, whole
        self._taken += 1
        self._stale = True

    def forget(self) -> None:
        """Starts anew: the board has."""
        self.__init__()

    def board_us(self, host_s: float) -> float:
        """The board's clock at a host's time."""
        self._refit()
        return self._board_us + 1e6 * self.rate * (host_s - self._at)

    def host_s(self, board_us: float) -> float:
        """The host's clock at a board's time."""
        self._refit()
        return self._at + (board_us - self._board_us) / (1e6 * self.rate)

    def _refit(self) -> None:
        if not self._stale:
            return
        self._stale = False
        host, half, board = self._samples[:, : self._taken]
        weight = (1 + (half - half.min()) / (_PROMPT_S / 2)) ** -2
        weight /= weight.sum()
        at, board_mean = float(weight @ host), float(weight @ board)
        spread = float(weight @ (host - at) ** 2)
        if np.ptp(host) >= _SPAN_S and spread >= (_SPAN_S / 4) ** 2:
            slope = float(weight @ ((host - at) * (board - board_mean))) / spread * 1e-6
            self.rate = min(max(slope, 1 - _WORST_SKEW), 1 + _WORST_SKEW)
        self._at, self._board_us = at, board_mean
