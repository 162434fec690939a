"""Millions of targets: batch-last columns in, branches out, in chunks that stay in the processor's cache."""

from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

import jax
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxik.arm import Arm, ArmModel, as_arm
from jaxik.ik.all_branches import AnyBranches, all_branches
from jaxik.numerics import cores
from jaxik.targets import as_array, as_floats

# Rows per chunk: the best of 8192, 16 384, 32 768 and 65 536 on two cores with 2 MB of cache each. Smaller chunks pay
# for starting the stages' loops, larger ones for memory.
CHUNK = 16_384

Columns = Array | np.ndarray

POSITION, SWIVEL = "positions of shape (3, n)", "swivel angles of shape (n,)"
DIRECTIONS = "directions of shape (3, 3, n) or (3, 1, n)"


class SolvedRows(NamedTuple):
    """Chunk of a batch, as :func:`stream_ik` yields it.

    Attributes:
        rows: Slice of the batch.
        branches: Solutions of its rows.
    """

    rows: slice
    branches: AnyBranches


def solve_ik_columns(
    arm: Arm | ArmModel,
    position: Float[ArrayLike, "3 n"],
    directions: Float[ArrayLike, "3 columns n"],
    swivel: Float[ArrayLike, "n"],
) -> AnyBranches:
    """Solve as :func:`solve_ik` does, at full speed: batch-last columns, shared angles once, no residual.

    Args:
        arm: The arm.
        position: Tool points, ``(3, n)`` [m].
        directions: Rotations with row and column first, ``(3, 3, n)``, or pointing directions ``(3, 1, n)``.
        swivel: Angles of the elbow on its circle, ``(n,)`` [rad].

    Returns:
        Angles and statuses of the branches; ``.joints(branch)`` and ``.branch_status(branch)`` pick one, ``.q`` and
        ``.status`` expand all eight.

    Raises:
        ValueError: Wrong shapes or dtypes.

    **Differentiability**: as :func:`solve_ik`.
    """
    columns = as_array(POSITION, position), as_array(DIRECTIONS, directions), as_array(SWIVEL, swivel)
    return _solve_ik_columns(as_arm(arm, any_class=True), *columns)


@jax.jit
def _solve_ik_columns(arm: Arm, position: ArrayLike, directions: ArrayLike, swivel: ArrayLike) -> AnyBranches:
    position, directions, swivel = as_floats(position, directions, swivel)
    _check_columns(arm, position, directions, swivel)
    return all_branches(arm.astype(swivel.dtype), position, directions, swivel)


def stream_ik(
    arm: Arm | ArmModel,
    position: Float[ArrayLike, "3 n"],
    directions: Float[ArrayLike, "3 columns n"],
    swivel: Float[ArrayLike, "n"],
    *,
    chunk: int = CHUNK,
    threads: int | None = None,
) -> Iterator[SolvedRows]:
    """Solve any number of targets chunk by chunk, at the rate of the best batch size.

    Each thread works on a chunk of its own, since a chunk is too small to be worth splitting, and all compute while the
    caller works on the last one. The last chunk is filled up, so that one program serves them all.

    Args:
        arm: The arm.
        position: Tool points, ``(3, n)`` [m].
        directions: ``(3, 3, n)`` or ``(3, 1, n)``, as for :func:`solve_ik_columns`.
        swivel: Angles of the elbow on its circle, ``(n,)`` [rad].
        chunk: Rows per chunk.
        threads: Chunks solved at once; None for one thread per core.

    Yields:
        Slices of the batch with their branches, computed, in order.

    Raises:
        ValueError: Wrong shapes or dtypes, ``arm`` is not an arm, or ``chunk`` or ``threads`` is not positive.
    """
    arm, threads = as_arm(arm, any_class=True), cores() if threads is None else threads
    if chunk < 1 or threads < 1:
        raise ValueError(f"expected a positive chunk and number of threads, got {chunk} and {threads}")
    # Slicing stays on the host: a slice of a device array would be a program of its own for every offset.
    named = (POSITION, position), (DIRECTIONS, directions), (SWIVEL, swivel)
    columns = [np.asarray(as_array(name, value)) for name, value in named]
    _check_columns(arm, *columns)
    return _stream(arm, columns, chunk, threads)


def _stream(arm: Arm, columns: list[np.ndarray], chunk: int, threads: int) -> Iterator[SolvedRows]:
    total = columns[2].shape[-1]

    def solved(rows: slice) -> AnyBranches:
        count = rows.stop - rows.start
        parts = [x[..., rows] for x in columns]
        if count < chunk < total:
            parts = [np.pad(x, [(0, 0)] * (x.ndim - 1) + [(0, chunk - count)], mode="edge") for x in parts]
        branches = jax.block_until_ready(_solve_ik_columns(arm, *map(np.ascontiguousarray, parts)))
        if count < chunk < total:
            branches = jax.device_put(jax.tree.map(lambda x: np.asarray(x)[..., :count], branches))
        return branches

    with ThreadPoolExecutor(threads) as pool:
        pending: deque[tuple[slice, Future[AnyBranches]]] = deque()
        try:
            for start in range(0, total, chunk):
                rows = slice(start, min(start + chunk, total))
                pending.append((rows, pool.submit(solved, rows)))
                if len(pending) > 2 * threads:
                    first, branches = pending.popleft()
                    yield SolvedRows(first, branches.result())
            for first, branches in pending:
                yield SolvedRows(first, branches.result())
        finally:  # a caller that stops early does not wait for what is queued
            pool.shutdown(wait=False, cancel_futures=True)


def _check_columns(arm: Arm, position: Columns, directions: Columns, swivel: Columns) -> None:
    n = swivel.shape[-1] if swivel.ndim else None
    columns = 3 if arm.n_joints == 7 and directions.ndim == 3 and directions.shape[1] == 3 else 1
    if swivel.ndim != 1 or position.shape != (3, n) or directions.shape != (3, columns, n):
        raise ValueError(
            "expected position (3, n), directions (3, 3, n) for seven joints or (3, 1, n), and swivel (n,), "
            f"got {position.shape}, {directions.shape} and {swivel.shape}"
        )
