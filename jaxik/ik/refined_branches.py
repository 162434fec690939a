"""Angles and statuses of the solutions of an arm that is solved by refinement."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
from jax import Array

from jaxik.ik.refusal import raise_unless_ok
from jaxik.ik.status import Status

if TYPE_CHECKING:
    from typing import Self


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class RefinedBranches:
    """Angles and statuses of the sixteen slots of n targets.

    Slot ``branch`` holds the solution with the bits of that branch, slot ``branch + 8`` a second one with the same
    bits; what is left fills the other slots.

    Attributes:
        q: Joint angles, ``(16, 7, n)`` [rad].
        status: :class:`Status` as integers, ``(16, n)``.
        pivot: Least pivot of the Jacobian with the outer joint held, ``(16, n)`` [arm lengths, rad]: zero where two
            solutions meet.
    """

    q: Array
    status: Array
    pivot: Array

    def joints(self, branch: int) -> tuple[Array, ...]:
        """Return the joint angles of one slot.

        Args:
            branch: Slot, 0 to 15.

        Returns:
            One column ``(n,)`` per joint [rad].
        """
        return tuple(self.q[branch])

    def branch_status(self, branch: int) -> Array:
        """Return the status of one slot.

        Args:
            branch: Slot, 0 to 15.

        Returns:
            :class:`Status` as integers, ``(n,)``.
        """
        return self.status[branch]

    @property
    def ok(self) -> Array:
        """Feasible slots, ``(16, n)``."""
        return self.status <= Status.NEAR_SINGULAR

    def raise_if_invalid(self) -> "Self":
        """Return the solutions themselves, so that calls chain; for use outside ``jit``.

        Raises:
            UnreachableError: A target has no feasible solution; with the targets, the status of the first and the next
                step.
        """
        raise_unless_ok(jnp.min(self.status, axis=0), "no feasible branch")
        return self
