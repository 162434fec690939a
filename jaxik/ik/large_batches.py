"""Programs of targets, for large batches in chunks."""

import math
from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from jax.typing import ArrayLike

from jaxik.arm import Arm
from jaxik.numerics import CHUNK, in_chunks, map_chunks
from jaxik.targets import Pose, Target, batch_shape, check_target


def over_targets(
    program: Callable,
    arm: Arm,
    target: Target,
    *values: ArrayLike,
    rank: int = 0,
    fixed: tuple[ArrayLike | None, ...] = (),
    chunk: int = CHUNK,
) -> Any:
    """Return ``program(arm, target, *values, *fixed)``, of a large batch in chunks where that is possible.

    Args:
        program: Compiled function, whose results have the batch axes of its arguments first.
        arm: The arm.
        target: Targets with leading batch axes.
        values: More arrays of the same batch axes.
        rank: Number of axes of the values behind the batch.
        fixed: Arguments without batch axes.
        chunk: Rows per chunk.

    Raises:
        ValueError: Wrong shapes or dtypes.
    """
    if math.prod(map(np.size, (*jax.tree.leaves(target), *values))) > 2 * chunk:  # else no more rows, no time to lose
        target, values = check_target(arm, target, *values)
        rows = [v[(..., *[0] * rank)] for v in values]
        batch = batch_shape(target, *rows)
        if in_chunks(batch, arm, target, values, fixed, chunk=chunk):
            ranks = jax.tree.unflatten(jax.tree.structure(target), (1, 2 if isinstance(target, Pose) else 1))
            ranks = (ranks, *[rank] * len(values))
            return map_chunks(
                lambda constant, *rows: program(constant[0], *rows, *constant[1:]),
                (arm, *fixed),
                (target, *values),
                ranks,
                batch,
                chunk,
            )
    return program(arm, target, *values, *fixed)
