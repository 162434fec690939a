"""Priority for the thread that sends, which on a busy computer may else wait longer than boards do."""

import gc
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from hardware.clock import Clock, VirtualClock

_NICE = -10
_SWITCH_S = 0.0005  # the longest that another thread of this program keeps the interpreter; usually 5 ms


@contextmanager
def sending_first(clock: Clock) -> Iterator[None]:
    """Let this thread run as soon as it has something to send, while the block runs; in virtual time nothing is late.

    Before other threads of the program it always does; before other programs if the system allows it. Linux allows it
    to root and to users with ``rtprio`` or ``nice`` in ``/etc/security/limits.conf``. Threads and processes that this
    thread starts meanwhile do not inherit it.

    Args:
        clock: Clock of the board.
    """
    if isinstance(clock, VirtualClock):
        yield
        return
    switch_s = sys.getswitchinterval()
    sys.setswitchinterval(min(switch_s, _SWITCH_S))
    gc.freeze()  # a full collection of everything that JAX has loaded takes 0.1 to 0.3 s
    try:
        with _before_other_programs():
            yield
    finally:
        gc.unfreeze()
        sys.setswitchinterval(switch_s)


@contextmanager
def _before_other_programs() -> Iterator[None]:
    if not hasattr(os, "sched_setscheduler"):
        yield
        return
    before = os.sched_getscheduler(0), os.sched_getparam(0), os.getpriority(os.PRIO_PROCESS, 0)
    try:
        os.sched_setscheduler(0, os.SCHED_RR | os.SCHED_RESET_ON_FORK, os.sched_param(1))
    except OSError:
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, 0, min(_NICE, before[2]))
    try:
        yield
    finally:
        with suppress(OSError):
            os.sched_setscheduler(0, *before[:2])
            os.setpriority(os.PRIO_PROCESS, 0, before[2])
