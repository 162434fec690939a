"""Millions of targets: batch-last columns in, branches out, in chunks that stay in the processor's cache."""

import os
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor

import jax
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Float

from jaxik.arm import Arm
from jaxik.ik.closed_form import Branches, closed_form
from jaxik.targets import as_floats

# Rows per chunk: the best of 8192, 16 384, 32 768 and 65 536 on two cores with 2 MB of cache each. Smaller chunks pay
# for starting the stages' loops, larger ones for memory.
CHUNK = 16_384


@jax.jit
def solve_ik_columns(
    arm: Arm,
    position: Float[ArrayLike, "3 n"],
    directions: Float[ArrayLike, "3 columns n"],
    swivel: Float[ArrayLike, "n"],
) -> Branches:
    """:func:`solve_ik` at full speed: batch-last columns, the branches' shared angles once, no residual.

    Args:
        arm: The arm.
        position: Tool points, ``(3, n)`` [m].
        directions: Rotations with row and column first, ``(3, 3, n)``, or pointing directions ``(3, 1, n)``.
        swivel: ``(n,)`` [rad].

    Returns:
        The branches' angles and verdicts; ``.joints(branch)`` and ``.verdict(branch)`` pick one, ``.q()`` and
        ``.status()`` write out all eight.

    Raises:
        ValueError: Wrong shapes or dtypes.

    **Differentiability**: as :func:`solve_ik`.
    """
    position, directions, swivel = as_floats(position, directions, swivel)
    n = swivel.shape[-1] if swivel.ndim else None
    columns = 3 if arm.n_joints == 7 and directions.ndim == 3 and directions.shape[1] == 3 else 1
    if swivel.ndim != 1 or position.shape != (3, n) or directions.shape != (3, columns, n):
        raise ValueError(
            "expected position (3, n), directions (3, 3, n) for seven joints or (3, 1, n), and swivel (n,), "
            f"got {position.shape}, {directions.shape} and {swivel.shape}"
        )
    return closed_form(arm.astype(swivel.dtype), position, directions, swivel)


def stream_ik(
    arm: Arm,
    position: Float[ArrayLike, "3 n"],
    directions: Float[ArrayLike, "3 columns n"],
    swivel: Float[ArrayLike, "n"],
    *,
    chunk: int = CHUNK,
    threads: int | None = None,
) -> Iterator[tuple[slice, Branches]]:
    """Solves any number of targets chunk by chunk, at the rate of the best batch size.

    Every core works on a chunk of its own: a chunk is too small to be worth splitting, and together they compute while
    the caller works on the last one. The last chunk is filled up, so that one program serves them all.

    Args:
        arm: The arm.
        position: Tool points, ``(3, n)`` [m].
        directions: ``(3, 3, n)`` or ``(3, 1, n)``, as for :func:`solve_ik_columns`.
        swivel: ``(n,)`` [rad].
        chunk: Rows solved at once.
        threads: How many chunks at once; None for one a core.

    Yields:
        The slice of the batch and its branches, computed, in order.

    Raises:
        ValueError: Wrong shapes or dtypes, or a chunk or number of threads that is not positive.
    """
    threads = cores() if threads is None else threads
    if chunk < 1 or threads < 1:
        raise ValueError(f"expected a positive chunk and number of threads, got {chunk} and {threads}")
    # Slicing stays on the host: a slice of a device array would be a program of its own for every offset.
    columns = [np.asarray(x) for x in (position, directions, swivel)]
    total = columns[2].shape[-1]

    def solved(rows: slice) -> Branches:
        count = rows.stop - rows.start
        parts = [x[..., rows] for x in columns]
        if count < chunk < total:
            parts = [np.pad(x, [(0, 0)] * (x.ndim - 1) + [(0, chunk - count)], mode="edge") for x in parts]
        branches = jax.block_until_ready(solve_ik_columns(arm, *map(np.ascontiguousarray, parts)))
        if count < chunk < total:
            branches = jax.device_put(jax.tree.map(lambda x: np.asarray(x)[..., :count], branches))
        return branches

    with ThreadPoolExecutor(threads) as pool:
        pending: deque[tuple[slice, Future[Branches]]] = deque()
        try:
            for start in range(0, total, chunk):
                rows = slice(start, min(start + chunk, total))
                pending.append((rows, pool.submit(solved, rows)))
                if len(pending) > 2 * threads:
                    first, branches = pending.popleft()
                    yield first, branches.result()
            for first, branches in pending:
                yield first, branches.result()
        finally:  # a caller that stops early does not wait for what is queued
            pool.shutdown(wait=False, cancel_futures=True)


def cores() -> int:
    """Cores this process may use, where the system says; else all."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
