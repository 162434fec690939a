"""Compilations as they happen: only of programs that are neither in memory nor in the cache on disk."""

import logging
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

# JAX says in its log that the cache on disk lacks a program, just before it compiles it, and as an event how long that
# took. Where a later JAX says otherwise, a step is shown without this.
_LOGGER, _MISS = "jax._src.compiler", "PERSISTENT COMPILATION CACHE MISS"
_COMPILED = "/jax/core/compile/backend_compile_duration"


class Compilations(logging.Handler):
    """Compilations while a step runs.

    Attributes:
        seconds: Time in which anything was compiled [s]; several threads may compile at once.

    Args:
        notify: Called with True when a compilation begins, and with False when it has ended.
    """

    def __init__(self, notify: Callable[[bool], None]) -> None:
        super().__init__(logging.DEBUG)
        self.seconds = 0.0
        self._notify, self._began = notify, 0.0
        self._lock, self._threads = threading.Lock(), set[int]()

    def emit(self, record: logging.LogRecord) -> None:
        """Take note of a program that the cache lacks."""
        if _MISS in str(record.msg):
            with self._lock:
                self._began = self._began if self._threads else time.perf_counter()
                self._threads.add(threading.get_ident())
            self._notify(True)

    def ended(self, event: str, duration_secs: float, **_: str | int) -> None:
        """Take note of an event of JAX, reported by the thread that compiled."""
        thread = threading.get_ident()
        if event != _COMPILED or thread not in self._threads:
            return
        with self._lock:
            self._threads.remove(thread)
            if not self._threads:
                self.seconds += time.perf_counter() - self._began
        self._notify(bool(self._threads))


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
