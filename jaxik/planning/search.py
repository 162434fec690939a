"""Global search over swivel and branch: dynamic programming along a few waypoints of the path.

Coarse in time on purpose: between neighboring waypoints of a fine path the joints move less than a cell of the swivel
grid, and all a search would see is its own quantisation (measured: 2.48 found where the optimum is 0.378). Between
waypoints far apart the straight chord in joint space is a good price.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int


class Route(NamedTuple):
    """The cheapest route through a layered graph.

    Attributes:
        state: State taken at every waypoint, ``(waypoint,)``; meaningless where the cost is infinite.
        cost: Its cost, ``()``; infinite where there is none.
        open: Whether any route from the start reaches a waypoint, ``(waypoint,)``.
    """

    state: Int[Array, "waypoint"]
    cost: Float[Array, ""]
    open: Bool[Array, "waypoint"]


@partial(jax.jit, static_argnames=("turning",))
def best_route(
    q: Float[Array, "waypoint joint state"],
    node: Float[Array, "waypoint state"],
    dt: Float[Array, "step"],
    motion_weight: Float[Array, "joint"],
    velocity_limit: Float[Array, "joint"],
    *,
    turning: tuple[bool, ...],
) -> Route:
    """Least Σ node + Σ_j w_j Δq_j² / dt over one state per waypoint, no joint faster than its limit.

    Forward the values only: a minimum over columns is plain vector code, an argmin is not. Backward the argmin of the
    one column that is needed. Exact on the grid; ``vmap`` plans many paths at once.

    Args:
        q: Joint angles of every state, states last, ``(waypoint, joint, state)`` [rad].
        node: Cost of being in a state, infinite where it is not allowed, ``(waypoint, state)``.
        dt: Time between waypoints, ``(waypoint - 1,)`` [s].
        motion_weight: w, ``(joint,)``.
        velocity_limit: ``(joint,)`` [rad/s].
        turning: Which joints turn without end, so that a full turn is no motion.

    Returns:
        The route.

    **Differentiability**: none needed: indices.
    """

    def step_cost(before: Array, after: Array, dt: Array) -> Array:
        """``(joint, *a)`` and ``(joint, *b)``, broadcast, to the cost of the chord."""
        cost, fast = jnp.zeros((), q.dtype), jnp.zeros((), bool)
        for j, turns in enumerate(turning):
            d = after[j] - before[j]
            if turns:
                d = d - 2 * jnp.pi * jnp.round(d / (2 * jnp.pi))
            cost = cost + motion_weight[j] * d * d
            fast = fast | (jnp.abs(d) > velocity_limit[j] * dt)
        return jnp.where(fast, jnp.inf, cost / dt)

    def forward(value: Array, layer: tuple[Array, Array, Array, Array]) -> tuple[Array, Array]:
        before, after, cost, dt = layer
        reached = jnp.min(value[:, None] + step_cost(before[:, :, None], after[:, None, :], dt), axis=0) + cost
        return reached, reached

    _, later = lax.scan(forward, node[0], (q[:-1], q[1:], node[1:], dt))
    values = jnp.concatenate([node[:1], later])

    def backward(state: Array, layer: tuple[Array, Array, Array, Array]) -> tuple[Array, Array]:
        value, before, after, dt = layer
        previous = jnp.argmin(value + step_cost(before, after[:, state][:, None], dt))
        return previous, previous

    last = jnp.argmin(values[-1])
    _, states = lax.scan(backward, last, (values[:-1], q[:-1], q[1:], dt), reverse=True)
    return Route(jnp.append(states, last), values[-1, last], jnp.isfinite(values).any(axis=-1))
