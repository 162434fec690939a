"""From statuses to an exception with the rows, the reasons and the next step to take."""

import numpy as np
from jaxtyping import Array, Int

from jaxik.errors import UnreachableError
from jaxik.ik.status import Status


def raise_unless_ok(status: Int[Array, "*batch"], problem: str) -> None:
    """Raise where a row is infeasible; for use outside ``jit``.

    Args:
        status: :class:`Status` as integers, one per row.
        problem: Problem in words, such as "no feasible branch".

    Raises:
        UnreachableError: With the number of rows, the first of them and its status.
    """
    outcomes = np.asarray(status)
    bad = np.argwhere(outcomes > Status.NEAR_SINGULAR)
    if len(bad):
        first = tuple(int(i) for i in bad[0])
        reason = Status(int(outcomes[first]))
        where = f"row {first}" if first else "the target"
        raise UnreachableError(
            f"{len(bad)} of {outcomes.size} targets have {problem}; {where}: {reason.name}: {reason.message}"
        )
