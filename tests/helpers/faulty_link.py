"""A line in virtual time that delays, garbles, loses, repeats, stalls or dies, the same way for the same seed."""

from collections import deque

import numpy as np

from hardware.errors import LinkError

_PAUSE_S = 0.003


class FaultyLink:
    """A :class:`hardware.transport.Transport` to a peer in memory.

    Args:
        peer: The board; its time starts with this object's.
        clock: Whose time.
        seed: Of everything random.
        latency_s: Each way.
        jitter_s: Mean of what is added to it, exponentially distributed; bytes still arrive in order.
        stall: Probability that what is sent in one go waits stall_s longer.
        stall_s: How long a stall takes.
        flip: Probability that a byte has one bit wrong.
        drop: Probability that a byte is lost.
        duplicate: Probability that what is written at once is repeated.
        byte_s: How long one byte takes on the line.
        gone_at_s: When the port vanishes.
        silent: Span of time in which nothing passes either way.
    """

    def __init__(
        self,
        peer,
        clock,
        *,
        seed: int = 0,
        latency_s: float = 0.0,
        jitter_s: float = 0.0,
        stall: float = 0.0,
        stall_s: float = 0.15,
        flip: float = 0.0,
        drop: float = 0.0,
        duplicate: float = 0.0,
        byte_s: float = 0.0,
        gone_at_s: float = np.inf,
        silent: tuple[float, float] = (np.inf, np.inf),
    ) -> None:
        self.peer, self.clock, self.began = peer, clock, clock.now()
        self.latency_s, self.jitter_s, self.stall, self.stall_s = latency_s, jitter_s, stall, stall_s
        self.byte_s = byte_s
        self.flip, self.drop, self.duplicate = flip, drop, duplicate
        self.gone_at_s, self.silent = gone_at_s, silent
        self._random = np.random.default_rng(seed)
        self._last, self._delay = [-np.inf, -np.inf], [0.0, 0.0]
        self._ways: tuple[deque, deque] = deque(), deque()

    def write(self, data: bytes) -> None:
        """See the protocol."""
        self._catch_up()
        self._put(0, self._now(), data)
        self._catch_up()

    def read(self) -> bytes:
        """See the protocol."""
        self._catch_up()
        arrived = b""
        while self._ways[1] and self._ways[1][0][0] <= self._now():
            arrived += self._ways[1].popleft()[1]
        return arrived

    def close(self) -> None:
        """See the protocol."""

    def _now(self) -> float:
        return self.clock.now() - self.began

    def _catch_up(self) -> None:
        now = self._now()
        if now >= self.gone_at_s:
            self.peer.run(round(now * 1e6))
            raise LinkError("the port is gone")
        while self._ways[0] and self._ways[0][0][0] <= now:
            at, data = self._ways[0].popleft()
            self._live(at)
            self.peer.receive(data)
        self._live(now)

    def _live(self, until_s: float) -> None:
        self.peer.run(max(round(until_s * 1e6), self.peer.now_us))
        if data := self.peer.take():
            self._put(1, until_s, data)

    def _put(self, way: int, now: float, data: bytes) -> None:
        if self.silent[0] <= now < self.silent[1]:
            return
        random = self._random
        copies = 1 + (random.random() < self.duplicate)
        spoiled = data * copies if not (self.flip or self.drop) else self._spoil(data * copies)
        if now - self._last[way] > _PAUSE_S:  # a radio sends what comes in one go in one packet
            self._delay[way] = self.latency_s + (random.exponential(self.jitter_s) if self.jitter_s else 0.0)
            self._delay[way] += self.stall_s if random.random() < self.stall else 0.0
        self._last[way] = now
        at = now + self._delay[way]
        queue = self._ways[way]
        queue.append((max(at, queue[-1][0] if queue else at), spoiled))

    def _spoil(self, data: bytes) -> bytes:
        random = self._random
        content = np.frombuffer(data, np.uint8)[random.random(len(data)) >= self.drop]
        hit = random.random(len(content)) < self.flip
        return (content ^ np.where(hit, 1 << random.integers(0, 8, len(content)), 0).astype(np.uint8)).tobytes()
