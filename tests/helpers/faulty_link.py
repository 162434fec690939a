"""A line in virtual time that delays, garbles, loses, repeats, stalls or dies, reproducibly for each seed."""

from collections import deque

import numpy as np

from hardware.errors import LinkError

_PAUSE_S = 0.003


class FaultyLink:
    """A :class:`hardware.transport.Transport` to a peer in memory.

    Args:
        peer: Board; its time starts with this object's.
        clock: Clock of the host.
        seed: Seed of everything random.
        latency_s: Delay each way [s].
        jitter_s: Mean of an additional, exponentially distributed delay [s]; bytes still arrive in order.
        stall: Probability that a burst of bytes is delayed by a stall.
        stall_s: Duration of a stall [s].
        flip: Probability that a byte has one bit wrong.
        drop: Probability that a byte is lost.
        duplicate: Probability that one write is repeated.
        byte_s: Time that one byte takes on the line [s].
        gone_at_s: Time at which the port vanishes [s].
        silent: Span of time in which nothing passes either way [s].
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
        self._lanes: tuple[deque, deque] = deque(), deque()

    def write(self, data: bytes) -> None:
        """See :class:`hardware.transport.Transport`."""
        self._catch_up()
        self._put(0, self._now(), data)
        self._catch_up()

    def read(self) -> bytes:
        """See :class:`hardware.transport.Transport`."""
        self._catch_up()
        arrived = b""
        while self._lanes[1] and self._lanes[1][0][0] <= self._now():
            arrived += self._lanes[1].popleft()[1]
        return arrived

    def close(self) -> None:
        """See :class:`hardware.transport.Transport`."""

    def _now(self) -> float:
        return self.clock.now() - self.began

    def _catch_up(self) -> None:
        now = self._now()
        if now >= self.gone_at_s:
            self.peer.run(round(now * 1e6))
            raise LinkError("the port is gone")
        while self._lanes[0] and self._lanes[0][0][0] <= now:
            at, data = self._lanes[0].popleft()
            self._advance(at)
            self.peer.receive(data)
        self._advance(now)

    def _advance(self, until_s: float) -> None:
        self.peer.run(max(round(until_s * 1e6), self.peer.now_us))
        if data := self.peer.take():
            self._put(1, until_s, data)

    def _put(self, lane: int, now: float, data: bytes) -> None:
        if self.silent[0] <= now < self.silent[1]:
            return
        random = self._random
        copies = 1 + (random.random() < self.duplicate)
        received = data * copies if not (self.flip or self.drop) else self._corrupt(data * copies)
        if now - self._last[lane] > _PAUSE_S:  # a radio sends a burst in one packet
            self._delay[lane] = self.latency_s + (random.exponential(self.jitter_s) if self.jitter_s else 0.0)
            self._delay[lane] += self.stall_s if random.random() < self.stall else 0.0
        self._last[lane] = now
        at = now + self._delay[lane]
        queue = self._lanes[lane]
        queue.append((max(at, queue[-1][0] if queue else at), received))

    def _corrupt(self, data: bytes) -> bytes:
        random = self._random
        content = np.frombuffer(data, np.uint8)[random.random(len(data)) >= self.drop]
        hit = random.random(len(content)) < self.flip
        return (content ^ np.where(hit, 1 << random.integers(0, 8, len(content)), 0).astype(np.uint8)).tobytes()
