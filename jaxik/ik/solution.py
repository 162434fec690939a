"""What a solve returns: joint angles, a status per branch, and what forward kinematics really leaves."""

import enum
from dataclasses import dataclass
from typing import TYPE_CHECKING

import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxik.errors import UnreachableError

if TYPE_CHECKING:
    from typing import Self


class Status(enum.IntEnum):
    """Outcome of one branch of one row; larger is worse, and the worst that applies is reported."""

    OK = 0
    NEAR_SINGULAR = 1
    LIMITS = 2
    KEEP_OUT = 3
    OUT_OF_REACH = 4
    INVALID_TARGET = 5
    NONFINITE_INPUT = 6

    @property
    def message(self) -> str:
        """One sentence: what it means and what to do."""
        return _MESSAGES[self]


_MESSAGES = {
    Status.OK: "reaches the target inside all limits",
    Status.NEAR_SINGULAR: "reaches the target close to a singular posture, where joint speeds grow without bound",
    Status.LIMITS: "reaches the target but leaves a joint's range; try another swivel (jaxik.swivel_arcs) or branch",
    Status.KEEP_OUT: "reaches the target with the elbow in its keep-out; try another swivel (jaxik.swivel_arcs)",
    Status.OUT_OF_REACH: "the wrist is further off than the arm is long, or too near; q reaches for it",
    Status.INVALID_TARGET: "the rotation is no rotation matrix, the direction has no length or is not one this arm can "
    "point, or the swivel is beyond 1e6 rad (1e3 in float32); normalize the target",
    Status.NONFINITE_INPUT: "NaN or infinity in the target or swivel; q is a placeholder",
}


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Residual:
    """Distance between the asked and the reached target, by forward kinematics.

    Attributes:
        position: ``(*batch, 8)`` [m].
        rotation: ``(*batch, 8)`` [rad]; for a pointing target the angle between the directions.
    """

    position: Float[Array, "*batch branch"]
    rotation: Float[Array, "*batch branch"]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class IKSolution:
    """All eight closed-form solutions of a batch of targets at given swivels.

    Branch number = ``4 * shoulder + 2 * elbow + wrist``, each bit 0 or 1 (see :mod:`jaxik.ik.solve`).

    Attributes:
        q: Joint angles, ``(*batch, 8, n_joints)`` [rad], always finite.
        status: :class:`Status` as integers, ``(*batch, 8)``.
        residual: What forward kinematics leaves, metres and radians apart.
    """

    q: Float[Array, "*batch branch joint"]
    status: Int[Array, "*batch branch"]
    residual: Residual

    @property
    def ok(self) -> Bool[Array, "*batch branch"]:
        """Branches a robot can take: in reach, in limits, elbow outside the keep-out."""
        return self.status <= Status.NEAR_SINGULAR

    def raise_if_invalid(self) -> "Self":
        """Raises where no branch of a row is usable; for use outside ``jit``.

        Returns:
            The solution itself, so that calls chain.

        Raises:
            UnreachableError: With the rows, the best status each reached, and the next step to take.
        """
        status = np.asarray(self.status)
        best = status.min(axis=-1)
        bad = np.argwhere(best > Status.NEAR_SINGULAR)
        if len(bad):
            first = tuple(int(i) for i in bad[0])
            reason = Status(int(best[first]))
            where = f"row {first}" if first else "the target"
            raise UnreachableError(
                f"{len(bad)} of {best.size} targets have no usable branch; {where}: {reason.name}: {reason.message}"
            )
        return self
