"""All in-limit turns of a solution: the same posture of the links, joints a number of full turns apart."""

import math
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from jaxik.arm import CONTINUOUS, Arm, clip_value
from jaxik.ik.refusal import raise_unless_ok
from jaxik.ik.status import Status
from jaxik.numerics import tolerances

if TYPE_CHECKING:
    from typing import Self

_TURN = 2 * np.pi
_MOST = 100_000  # postures listed per branch: more are a window forgotten


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Turns:
    """In-limit postures of every branch that differ by full turns of joints, nearest first: :meth:`IKSolution.turns`.

    Attributes:
        q: Joint angles, ``(*batch, 8, places, n_joints)`` [rad]; unused places repeat the branch's own posture.
        valid: True for places that hold a posture, ``(*batch, 8, places)``; those come first.
        status: :class:`jaxik.Status` of the branches as integers, ``(*batch, 8)``.
    """

    q: Float[Array, "*batch branch place joint"]
    valid: Bool[Array, "*batch branch place"]
    status: Int[Array, "*batch branch"]

    @property
    def ok(self) -> Bool[Array, "*batch branch"]:
        """Feasible branches."""
        return self.status <= Status.NEAR_SINGULAR

    @property
    def count(self) -> Int[Array, "*batch branch"]:
        """Number of postures of each branch."""
        return jnp.sum(self.valid, axis=-1)

    def raise_if_invalid(self) -> "Self":
        """Return the postures themselves, so that calls chain; for use outside ``jit``.

        Raises:
            UnreachableError: A row has no feasible branch; with the rows, the best status of the first and the next
                step.
        """
        raise_unless_ok(jnp.min(self.status, axis=-1), "no feasible branch")
        return self


def turn_counts(arm: Arm, window: float) -> tuple[int, ...]:
    """Return the largest number of turns of each joint within its limits and a window, on the host."""
    if isinstance(arm.lower, Tracer):
        raise ValueError(
            "the number of turns follows from the arm's limits, which must be known: inside jit, close over the arm "
            "in the place of passing it as an argument"
        )
    if not window > 0.0:
        raise ValueError(f"expected a positive window [rad], got {window}")
    lower, upper = np.asarray(arm.lower, float), np.asarray(arm.upper, float)
    unlimited = (lower <= -0.99 * CONTINUOUS) & (upper >= 0.99 * CONTINUOUS)
    width = np.minimum(upper - lower, 2 * window) + 2 * tolerances(arm.lower.dtype).limit
    counts = np.where(unlimited & ~np.isfinite(window), 0.0, np.floor(width / _TURN)) + 1.0
    if (total := math.prod(counts)) > _MOST:
        raise ValueError(
            f"expected at most {_MOST} postures per branch, got {total:.3g} from ranges of "
            f"{', '.join(f'{c:.0f}' for c in counts)} turns; give a smaller window="
        )
    return tuple(int(c) for c in counts)


@partial(jax.jit, static_argnames=("counts", "places"))
def list_turns(
    arm: Arm, q: Array, status: Array, q_now: Array, window: ArrayLike, *, counts: tuple[int, ...], places: int
) -> Turns:
    """List the postures of branches ``(*batch, 8, joint)``, near present angles ``(*batch, 1, joint)`` first."""
    slack = tolerances(q.dtype).limit
    lower, upper = arm.lower.astype(q.dtype), arm.upper.astype(q.dtype)
    one = jnp.asarray(counts) == 1
    near = jnp.where(jnp.isinf(window) & one & (upper - lower > _TURN + 2 * slack), np.pi, window).astype(q.dtype)
    low, high = jnp.maximum(lower, q_now - near), jnp.minimum(upper, q_now + near)
    first = q + _TURN * jnp.ceil((low - slack - q) / _TURN)
    # Every combination of the joints' turns.
    turns = np.indices(counts).reshape(len(counts), -1).T
    listed = first[..., None, :] + _TURN * turns.astype(q.dtype)
    within = (listed <= high[..., None, :] + slack) & (listed >= low[..., None, :] - slack)
    valid = jnp.all(within, axis=-1) & (status <= Status.NEAR_SINGULAR)[..., None]
    listed = jnp.where(valid[..., None], clip_value(listed, lower, upper), q[..., None, :])
    motion = jnp.where(valid, jnp.sum((listed - q_now[..., None, :]) ** 2, axis=-1), jnp.inf)
    order = jnp.argsort(motion, axis=-1, stable=True)[..., :places]
    return Turns(
        q=jnp.take_along_axis(listed, order[..., None], axis=-2),
        valid=jnp.take_along_axis(valid, order, axis=-1),
        status=status,
    )
