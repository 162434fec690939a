"""Result of a step of a control loop: status, posture, lag and velocity."""

import enum
from dataclasses import dataclass
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from jaxik.errors import UnreachableError
from jaxik.ik import Residual
from jaxik.targets import as_array, as_floats

if TYPE_CHECKING:
    from typing import Self


class FollowStatus(enum.IntEnum):
    """Outcome of a step."""

    ON_TARGET = 0
    LAGGING = 1
    BLOCKED = 2
    INFEASIBLE = 3
    COLLISION = 4
    BAD_INPUT = 5

    @property
    def message(self) -> str:
        """Meaning of the status and the next step to take, in one sentence."""
        return _MESSAGES[self]


_MESSAGES = {
    FollowStatus.ON_TARGET: "the tool is on the target",
    FollowStatus.LAGGING: "the joints move as fast as they may toward the target; the next steps catch up",
    FollowStatus.BLOCKED: "the keep-out or an obstacle is in the way to the nearest posture on target; the joints move "
    "along it and may have to stop (jaxik.clearance says which it is)",
    FollowStatus.INFEASIBLE: "reach, limits, keep-out or obstacles forbid the target; the joints go as near as they "
    "may (jaxik.solve_closest finds the closest pose)",
    FollowStatus.COLLISION: "the arm's body meets an obstacle or itself and cannot leave it within the step "
    "(jaxik.clearance says which); the joints move out of it as fast as they may",
    FollowStatus.BAD_INPUT: "NaN, infinity or no rotation in the target or the present posture; the arm stays in "
    "place, or brakes",
}


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class FollowStep:
    """The next posture of each row.

    Attributes:
        q: Joint angles, ``(*batch, n_joints)`` [rad]: within the limits if ``q_now`` is, no farther from it than the
            speed limits allow in ``dt``, and clear of obstacles unless the status is COLLISION.
        status: :class:`FollowStatus` as integers, ``(*batch,)``.
        lag: Distance of the tool from the target, ``(*batch,)`` in meters and radians; infinite where the status is
            BAD_INPUT.
        velocity: Joint velocities of the step, ``(*batch, n_joints)`` [rad/s].
        goal: Posture toward which the joints move, ``(*batch, n_joints)`` [rad]: on target where one is feasible.
    """

    q: Float[Array, "*batch joint"]
    status: Int[Array, "*batch"]
    lag: Residual
    velocity: Float[Array, "*batch joint"]
    goal: Float[Array, "*batch joint"]

    @classmethod
    def at_rest(cls, q: Float[ArrayLike, "*batch joint"]) -> "Self":
        """Return the last step of an arm at rest, as :func:`jaxik.follow` takes it with accelerations.

        Args:
            q: Present joint angles, ``(*batch, n_joints)`` [rad].
        """
        (q,) = as_floats(as_array("q of shape (*batch, joint)", q))
        nothing = jnp.zeros(q.shape[:-1], q.dtype)
        on_target = jnp.full(q.shape[:-1], FollowStatus.ON_TARGET, jnp.int32)
        return cls(q, on_target, Residual(nothing, nothing), jnp.zeros_like(q), q)

    @property
    def ok(self) -> Bool[Array, "*batch"]:
        """True where the tool is on the target."""
        return self.status == FollowStatus.ON_TARGET

    def raise_if_invalid(self) -> "Self":
        """Return the step itself, so that calls chain; for use outside ``jit``. A lag is no error.

        Raises:
            UnreachableError: A row has a bad input, a target that is forbidden or a collision; with the row and the
                reason.
        """
        worst = int(jnp.max(self.status, initial=0))
        if worst >= FollowStatus.INFEASIBLE:
            row = int(jnp.argmax(jnp.ravel(self.status)))
            raise UnreachableError(f"row {row}: {FollowStatus(worst).message}")
        return self
