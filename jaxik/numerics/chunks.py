"""Large batches in chunks that stay in a core's cache, one core per chunk.

A compiled program makes some thirty passes over its batch: through the cache for a small one, through memory for a
large one. A loop inside the program does not help, since XLA's CPU backend runs the body of a loop on one thread. So
the host loops, wherever it has the arrays and not just their shapes: outside ``jit``, ``vmap`` and ``grad``, on one
CPU.
"""

import math
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.core import Tracer

# Rows per chunk, the best of 1024, 2048, 4096 and 8192 for solve_ik and swivel_arcs with 2 MB of cache per core.
CHUNK = 2048

_ALIGNMENT = 64  # bytes: of arrays that XLA takes over without a copy


def at_hand(*trees: Any) -> bool:
    """Return True if all leaves are arrays with values, no tracers."""
    return not any(isinstance(x, Tracer) for x in jax.tree.leaves(trees))


def on_one_cpu(*trees: Any) -> bool:
    """Return True if a program of these arrays runs here and now, on the default device, which is a CPU."""
    if not at_hand(*trees):
        return False
    here = jnp.zeros(())  # a tracer inside a trace, where even constants are not evaluated; else on the default device
    if isinstance(here, Tracer) or any(device.platform != "cpu" for device in here.devices()):
        return False
    return all(x.devices() == here.devices() for x in jax.tree.leaves(trees) if isinstance(x, Array))


def in_chunks(batch: tuple[int, ...], *trees: Any, chunk: int = CHUNK) -> bool:
    """Return True for a batch that :func:`map_chunks` is for: large, and its values here and now on one CPU."""
    return math.prod(batch) > 2 * chunk and on_one_cpu(*trees)


def map_chunks(
    program: Callable, constants: Any, rows: tuple, ranks: tuple, batch: tuple[int, ...], chunk: int = CHUNK
) -> Any:
    """Return ``program(constants, *rows)``, computed chunk by chunk.

    Every row is computed by the same compiled program, whatever the batch. The last chunk overlaps the one before.

    Args:
        program: Compiled function of the constants and of trees of rows, all with one batch axis, to a tree of rows.
        constants: Tree that every chunk is given.
        rows: Trees of arrays, broadcast to ``(*batch, ...)``.
        ranks: Trees with their numbers of axes behind the batch.
        batch: Batch axes, at least ``chunk`` rows together.
        chunk: Rows per chunk.
    """
    total = math.prod(batch)
    flat = jax.tree.map(lambda x, rank: _flat(np.asarray(x), batch, rank), rows, ranks)

    def part(begin: int) -> Any:
        return jax.tree.map(lambda x: x[begin : begin + chunk], flat)

    shapes = jax.eval_shape(program, constants, *part(0))
    outputs = jax.tree.map(lambda s: _aligned((total, *s.shape[1:]), s.dtype), shapes)

    def compute(start: int) -> None:
        begin = min(start, total - chunk)
        computed = program(constants, *part(begin))
        jax.tree.map(
            lambda out, x: np.copyto(out[start : begin + chunk], np.asarray(x)[start - begin :]), outputs, computed
        )

    with ThreadPoolExecutor(cores()) as pool:
        for done in pool.map(compute, range(0, total, chunk)):
            assert done is None  # or raise what the thread raised
    # Without a copy: nothing else refers to these arrays.
    return jax.tree.map(lambda x: jax.device_put(x.reshape(*batch, *x.shape[1:])), outputs)


def cores() -> int:
    """Return the number of cores this process may use, or of all cores where the system does not say."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _flat(x: np.ndarray, batch: tuple[int, ...], rank: int) -> np.ndarray:
    """Rows ``(n, ...)`` of an array; of one batch axis without a copy."""
    core = x.shape[x.ndim - rank :]
    return np.broadcast_to(x, batch + core).reshape((math.prod(batch), *core))


def _aligned(shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    """An array whose memory is not yet touched, as numpy's and at an address that XLA accepts."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    memory = np.empty(size + _ALIGNMENT, np.uint8)
    start = -memory.ctypes.data % _ALIGNMENT
    return memory[start : start + size].view(dtype).reshape(shape)
