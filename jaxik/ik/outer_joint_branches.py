"""Angles and statuses of the eight branches of an arm with an outer joint."""

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
from jax import Array

from jaxik.ik.branches import branch_bits
from jaxik.ik.refusal import raise_unless_ok
from jaxik.ik.status import Status
from jaxik.numerics import merge_leading

if TYPE_CHECKING:
    from typing import Self


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class OuterJointBranches:
    """Angles and statuses of the eight branches of n targets, stored once where branches share them.

    The spherical joint is the shoulder of a U-R wrist arm, the wrist of an R-U shoulder arm; the bit of the other end
    is that of the root.

    Attributes:
        spherical: Its joints from the end of the arm inwards, ``(spherical bit, 3, root bit, elbow bit, n)`` [rad].
        elbow: Joint 4, ``(elbow bit, n)`` [rad].
        pair: The two joints whose axes meet, outwards, ``(2, root bit, elbow bit, n)`` [rad].
        outer: The outer joint: the redundancy parameter, ``(n,)`` [rad].
        spherical_inside: True where the spherical joint is in its limits, ``(spherical bit, root bit, elbow bit, n)``.
        others_inside: True where the other joints are, ``(root bit, elbow bit, n)``.
        root_status: Worst status that depends on root and elbow alone, ``(root bit, elbow bit, n)``.
        room: Least room to the ends of the reach, to where the roots meet, and to the keep-out, negative beyond, in
            units of the arm's lengths, ``(root bit, elbow bit, n)``.
        outer_joint: Index of the outer joint, 6 or 0.
    """

    spherical: Array
    elbow: Array
    pair: Array
    outer: Array
    spherical_inside: Array
    others_inside: Array
    root_status: Array
    room: Array
    outer_joint: int = dataclasses.field(metadata={"static": True})

    def joints(self, branch: int) -> tuple[Array, ...]:
        """Return the joint angles of one branch.

        Args:
            branch: Branch number, 0 to 7.

        Returns:
            One column ``(n,)`` per joint [rad].
        """
        s, e, r = self._bits(branch)
        inwards = *self.spherical[s, :, r, e], self.elbow[e], *self.pair[:, r, e], self.outer
        return inwards if self.outer_joint else inwards[::-1]

    def branch_status(self, branch: int) -> Array:
        """Return the status of one branch.

        Args:
            branch: Branch number, 0 to 7.

        Returns:
            :class:`Status` as integers, ``(n,)``.
        """
        s, e, r = self._bits(branch)
        inside = self.spherical_inside[s, r, e] & self.others_inside[r, e]
        limits = jnp.where(inside, jnp.int32(Status.OK), jnp.int32(Status.LIMITS))
        return jnp.maximum(self.root_status[r, e], limits)

    @property
    def q(self) -> Array:
        """Joint angles of all branches, ``(8, 7, n)`` [rad]; expanded at every use."""
        n = self.outer.shape[-1]
        parts = (
            jnp.swapaxes(self.spherical, 2, 3),
            self.elbow[None, None, :, None],
            jnp.swapaxes(self.pair, 1, 2)[None],
            self.outer[None, None, None, None],
        )
        parts = [jnp.broadcast_to(p, (2, p.shape[1], 2, 2, n)) for p in parts]
        q = jnp.concatenate(parts if self.outer_joint else [p[:, ::-1] for p in parts[::-1]], axis=1)
        order = (0, 2, 3, 1, 4) if self.outer_joint else (3, 2, 0, 1, 4)
        return merge_leading(jnp.transpose(q, order), 2)

    @property
    def status(self) -> Array:
        """:class:`Status` of all branches as integers, ``(8, n)``; expanded at every use."""
        inside = self.spherical_inside & self.others_inside
        limits = jnp.where(inside, jnp.int32(Status.OK), jnp.int32(Status.LIMITS))
        status = jnp.maximum(limits, self.root_status)
        return merge_leading(jnp.transpose(status, (0, 2, 1, 3) if self.outer_joint else (1, 2, 0, 3)), 1)

    @property
    def root_room(self) -> Array:
        """``room`` of all branches, ``(8, n)``; expanded at every use."""
        room = jnp.broadcast_to(self.room, self.spherical_inside.shape)
        return merge_leading(jnp.transpose(room, (0, 2, 1, 3) if self.outer_joint else (1, 2, 0, 3)), 1)

    @property
    def ok(self) -> Array:
        """Feasible branches, ``(8, n)``."""
        return self.status <= Status.NEAR_SINGULAR

    def raise_if_invalid(self) -> "Self":
        """Return the branches themselves, so that calls chain; for use outside ``jit``.

        Raises:
            UnreachableError: A target has no feasible branch; with the targets, the status of the first and the next
                step.
        """
        raise_unless_ok(jnp.min(self.status, axis=0), "no feasible branch")
        return self

    def _bits(self, branch: int) -> tuple[int, int, int]:
        """Bits of the spherical joint, the elbow and the root."""
        shoulder, elbow, wrist = map(int, branch_bits(branch))
        return (shoulder, elbow, wrist) if self.outer_joint else (wrist, elbow, shoulder)
