"""The motion along one path as arrays, and its status."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jaxik.planning.closure import is_closed
from jaxik.planning.problem import PlanningProblem
from jaxik.planning.status import PlanStatus, raise_unless_planned

if TYPE_CHECKING:
    from typing import Self

_SPEED_ROUNDING = 1e-6  # relative: a joint at its speed limit to rounding is not too fast


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class SwivelMotion:
    """A motion along a path of K waypoints.

    Attributes:
        swivel: Swivels, ``(*batch, K)`` [rad], without jumps of a full turn.
        branch: Branches, ``(*batch, K)``.
        q: Joint angles, ``(*batch, K, joint)`` [rad], without jumps of a full turn in joints whose range exceeds one.
            Their ranges are kept by the choice of the turn in which the motion begins; where none keeps them, the
            status is CHECK_FAILED, and :func:`jaxik.plan` looks for another motion.
        energy: Energy of the motion, in the energy's unit, ``(*batch,)``. Where the status is not OK it is
            S (tanh(E / S) + 100 ``violation``) for the energy E of what comes nearest to a motion, with the joint
            motion S of one turn of every joint in the path's time: finite, with a gradient that leads back.
        approach_energy: Energy of the approach from the start posture and to the end posture, ``(*batch,)``.
        energy_before_refinement: Energy of the initial guess, ``(*batch,)``.
        violation: Sum of what the motion misses targets, limits and keep-out by, ``(*batch,)``, in arm lengths and rad,
            and of relative excess speeds if every target can be reached; zero where the status is OK.
        reached: True for the searched waypoints that the search reached, ``(*batch, n)``.
        converged: True where the refinement ended at a minimum, ``(*batch,)``.
        feasible: True for the waypoints with a feasible swivel in any branch, ``(*batch, K)``.
        status: :class:`jaxik.PlanStatus` as integers, ``(*batch,)``.
    """

    swivel: Float[Array, "*batch waypoint"]
    branch: Int[Array, "*batch waypoint"]
    q: Float[Array, "*batch waypoint joint"]
    energy: Float[Array, "*batch"]
    approach_energy: Float[Array, "*batch"]
    energy_before_refinement: Float[Array, "*batch"]
    violation: Float[Array, "*batch"]
    reached: Bool[Array, "*batch searched"]
    converged: Bool[Array, "*batch"]
    feasible: Bool[Array, "*batch waypoint"]
    status: Int[Array, "*batch"]

    @property
    def ok(self) -> Bool[Array, "*batch"]:
        """True where there is a motion that keeps to targets, limits and speeds."""
        return self.status == PlanStatus.OK

    def raise_if_invalid(self) -> "Self":
        """Return the motion itself, so that calls chain; for use outside ``jit``.

        Raises:
            UnreachableError: A path has no motion; with its row and the reason.
        """
        raise_unless_planned(self.status)
        return self


def motion_status(problem: PlanningProblem, q: Array, feasible: Array, connected: Array, found: Array) -> Array:
    """:class:`PlanStatus` of a motion ``(K, joint)``; an open one is always found where the path is connected."""
    limit = problem.arm.velocity_limit * problem.durations[:, None] * (1.0 + _SPEED_ROUNDING)
    fast = jnp.any(jnp.abs(jnp.diff(q, axis=0)) > limit)
    status = jnp.where(fast, jnp.int32(PlanStatus.TOO_FAST), jnp.int32(PlanStatus.OK))
    status = jnp.where(jnp.any(problem.misfits(q)), jnp.int32(PlanStatus.CHECK_FAILED), status)
    status = jnp.where(connected, status, jnp.int32(PlanStatus.DISCONNECTED))
    if problem.closed is not None:
        returned = found & jnp.all(jnp.abs(q[-1] - q[0]) < jnp.pi)
        returned &= problem.target is None or is_closed(problem.arm, problem.target)
        status = jnp.where(connected & ~returned, jnp.int32(PlanStatus.NOT_CLOSED), status)
    return jnp.where(jnp.all(feasible), status, jnp.int32(PlanStatus.UNREACHABLE))
