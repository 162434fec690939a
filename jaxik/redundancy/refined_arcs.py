"""The feasible parameters of arms solved by refinement, per slot of their solver: a grid, and bisection of its changes.

Nothing is known of how far a solution moves between two parameters, so that an interval or a gap between neighboring
nodes is not seen.
"""

import jax
import jax.numpy as jnp
from jax import Array

from jaxik.arm import RefinedArm
from jaxik.ik import Status, all_branches
from jaxik.redundancy.outer_joint_arcs import arcs_between, changes

NODES = 256  # 1.4 degrees apart
CHANGES = 48  # of a target, in all slots
_HALVINGS = 18  # to 2e-7 rad


def refined_arcs(arm: RefinedArm, position: Array, directions: Array) -> tuple[Array, Array, Array]:
    """Return start, end and validity of the feasible intervals, ``(16, 8, n)`` each, for targets ``(3, n)``."""
    arm, position, directions = jax.lax.stop_gradient((arm, position, directions))
    n = position.shape[-1]

    def feasible(parameter: Array) -> Array:
        """Test parameters ``(k, n)`` in every slot, ``(16, k, n)``."""
        k = len(parameter)
        rows = jnp.repeat(position[:, None], k, axis=1).reshape(3, -1)
        turns = jnp.repeat(directions[:, :, None], k, axis=2).reshape(3, 3, -1)
        found = all_branches(arm, rows, turns, parameter.reshape(-1))
        return (found.status <= Status.NEAR_SINGULAR).reshape(-1, k, n)

    nodes = jnp.linspace(-jnp.pi, jnp.pi, NODES, endpoint=False, dtype=position.dtype)
    nodes = jnp.broadcast_to(nodes[:, None], (NODES, n))
    room = jnp.where(feasible(nodes), 1.0, -1.0).astype(nodes.dtype)
    found = changes(nodes, room, CHANGES)

    def halve(_: Array, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = ends
        middle = 0.5 * (low + high)
        inside = jnp.take_along_axis(feasible(middle), found.branch[None], axis=0)[0]
        before = inside != found.rising
        return jnp.where(before, middle, low), jnp.where(before, high, middle)

    low, high = jax.lax.fori_loop(0, _HALVINGS, halve, (found.low, found.high))
    return arcs_between(found, jnp.where(found.rising, high, low), room[:, 0] >= 0.0)
