"""Compilations as they happen: only of programs that are neither in memory nor in the cache on disk."""

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager

# JAX says in its log that the cache on disk lacks a program, just before it compiles it, and as an event how long that
# took. Where a later JAX says otherwise, a step is shown without this.
_LOGGER, _MISS = "jax._src.compiler", "PERSISTENT COMPILATION CACHE MISS"
_COMPILED = "/jax/core/compile/backend_compile_duration"


class Compilations(logging.Handler):
    """Compilations while a step runs.

    Attributes:
        seconds: Time that compilations have taken [s].

    Args:
        notify: Called with True when a compilation begins, and with False when it has ended.
    """

    def __init__(self, notify: Callable[[bool], None]) -> None:
        super().__init__(logging.DEBUG)
        self.seconds = 0.0
        self._notify, self._running = notify, 0

    def emit(self, record: logging.LogRecord) -> None:
        """Take note of a program that the cache lacks."""
        if _MISS in str(record.msg):
            self._running += 1
            self._notify(True)

    def ended(self, event: str, duration_secs: float, **_: str | int) -> None:
        """Take note of an event of JAX with a duration."""
        if event == _COMPILED and self._running:
            self._running -= 1
            self.seconds += duration_secs
            self._notify(self._running > 0)


@contextmanager
def compilations(notify: Callable[[bool], None]) -> Iterator[Compilations]:
    """Follow the compilations within a ``with`` block."""
    import jax

    found, logger = Compilations(notify), logging.getLogger(_LOGGER)
    level = logger.level
    logger.addHandler(found)
    logger.setLevel(logging.DEBUG)
    jax.monitoring.register_event_duration_secs_listener(found.ended)
    try:
        yield found
    finally:
        jax.monitoring.unregister_event_duration_listener(found.ended)
        logger.setLevel(level)
        logger.removeHandler(found)
