"""Outcomes of a plan, and the exception they raise."""

import enum

import numpy as np
from jaxtyping import Array, Int

from jaxik.errors import UnreachableError


class PlanStatus(enum.IntEnum):
    """Outcome of a plan; larger than 0 means that there is no motion."""

    OK = 0
    UNREACHABLE = 1
    DISCONNECTED = 2
    TOO_FAST = 3
    CHECK_FAILED = 4
    NOT_CLOSED = 5

    @property
    def message(self) -> str:
        """Meaning of the outcome and the next step to take, in one sentence."""
        return _MESSAGES[self]


_MESSAGES = {
    PlanStatus.OK: "every waypoint reached inside limits, keep-out and speeds, clear of obstacles",
    PlanStatus.UNREACHABLE: "some waypoints have no feasible swivel; move or shrink the path (jaxik.fit_path)",
    PlanStatus.DISCONNECTED: "limits or obstacles cut the path in two: no elbow motion leads across; move or split the "
    "path",
    PlanStatus.TOO_FAST: "joint velocity limits would be exceeded; give the path more time",
    PlanStatus.CHECK_FAILED: "the motion found fails the check of targets and limits; give the path more waypoints "
    "there, and please report it",
    PlanStatus.NOT_CLOSED: "no motion found returns to the posture in which it begins; plan the path open (without "
    'end="start"), slower, or with other limits',
}


def raise_unless_planned(status: Int[Array, "*batch"]) -> None:
    """Raise where a path has no motion; for use outside ``jit``.

    Args:
        status: :class:`PlanStatus` as integers, one per path.

    Raises:
        UnreachableError: With the number of paths, the first of them and its status.
    """
    outcomes = np.asarray(status)
    bad = np.argwhere(outcomes != PlanStatus.OK)
    if len(bad):
        reason = PlanStatus(int(outcomes[tuple(bad[0])]))
        where = f"path {tuple(map(int, bad[0]))}: " if outcomes.ndim else ""
        raise UnreachableError(f"{len(bad)} of {outcomes.size} paths have no motion; {where}{reason.message}")
