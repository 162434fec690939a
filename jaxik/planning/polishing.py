"""A few Newton steps on what the policy proposes, in the exact arcs: the planner's own polish without its search."""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxik import energy as energies
from jaxik.arm import Arm
from jaxik.energy import Energy
from jaxik.planning.chart import make_chart
from jaxik.planning.cost import Ends, PathCost
from jaxik.planning.initial_guess import into_arcs
from jaxik.planning.motion import ITERATIONS
from jaxik.planning.newton import newton_in_box
from jaxik.redundancy import swivel_arcs
from jaxik.targets import Target


@partial(jax.jit, static_argnames="iterations")
def polish(
    arm: Arm,
    target: Target,
    time: Float[Array, "waypoint"],
    swivel: Float[Array, "waypoint"],
    branch: Int[Array, "*waypoint"],
    energy: Energy | None = None,
    *,
    iterations: int = ITERATIONS,
) -> tuple[Float[Array, "waypoint"], Float[Array, "waypoint joint"], Float[Array, ""]]:
    """The nearest least-energy motion to a proposal, or some steps towards it.

    Args:
        arm: The arm.
        target: K targets.
        time: ``(K,)`` [s].
        swivel: Where to begin, ``(K,)`` [rad].
        branch: One for each waypoint, ``(K,)``, or for the whole path.
        energy: What to make small; None for :func:`jaxik.energy.joint_motion`.
        iterations: Newton steps at most; by default until it has converged.

    Returns:
        Swivels, joint angles ``(K, joint)`` and the energy; nan where the branch has no arc.

    **Differentiability**: none intended; :func:`jaxik.least_energy_motion` differentiates its optimum.
    """
    dtype = target.position.dtype
    arm, time, swivel = arm.astype(dtype), time.astype(dtype), swivel.astype(dtype)
    energy = energies.joint_motion() if energy is None else energy
    turning = arm.upper - arm.lower >= 2 * jnp.pi * (1 - 1e-6)
    course = into_arcs(swivel_arcs(arm, target), swivel, jnp.broadcast_to(branch, swivel.shape))
    cost = PathCost(
        arm,
        make_chart(arm, target),
        energy,
        time,
        Ends(None, None, jnp.ones((), dtype)),
        course.branch,
        turning,
        jnp.ones((), dtype),
    )
    begin, _ = cost.spent(cost.joints(course.swivel))
    cost = cost._replace(scale=jnp.maximum(begin, 1e-12))
    end = newton_in_box(cost, course.swivel, course.lower, course.upper, iterations)
    q = cost.joints(end.x)
    return end.x, q, cost.spent(q)[0]
