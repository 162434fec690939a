"""Local polish at full resolution: one swivel per waypoint, kept inside its feasible arc by construction.

Limits and keep-out bound each waypoint's swivel to an arc, so the constraints are a box, and a box needs no barrier:
psi = middle + half * sin(u) never leaves it and reaches its ends. Neighbours are coupled like a string's points; the
optimiser therefore works on z with u = C^-T z, C C^T = I + alpha L and L the string's stiffness, which takes the
number of iterations from hundreds to tens.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from jaxik.arm import Arm
from jaxik.energy import Energy
from jaxik.ik import solve_ik
from jaxik.path import Path
from jaxik.planning.continuity import unwrap

_SPEED_MARGIN = 0.98  # the penalty on joint speeds sets in here, so that the limit itself is kept
_SPEED_PENALTY = 1e2  # against an energy scaled to one
_MEMORY = 20  # optax's default of 10 took a quarter more iterations on the path `hello`


class Polished(NamedTuple):
    """Result of a polish.

    Attributes:
        swivel: ``(waypoint,)`` [rad].
        q: ``(waypoint, joint)`` [rad].
        energy: ``()``.
        iterations: ``()``.
    """

    swivel: Float[Array, "waypoint"]
    q: Float[Array, "waypoint joint"]
    energy: Float[Array, ""]
    iterations: Int[Array, ""]


def posture(arm: Arm, path: Path, swivel: Array, branch: Array, turning: tuple[bool, ...]) -> Array:
    """Joint angles along a path at given swivels and branches, ``(waypoint, joint)`` [rad]."""
    q = solve_ik(arm, path.target, swivel).q
    return unwrap(jnp.take_along_axis(q, branch[:, None, None], axis=1)[:, 0], turning)


@partial(jax.jit, static_argnames=("turning", "iterations"))
def polish(
    arm: Arm,
    path: Path,
    energy: Energy,
    swivel: Float[Array, "waypoint"],
    branch: Int[Array, "waypoint"],
    box: tuple[Float[Array, "waypoint"], Float[Array, "waypoint"]],
    pinned: Bool[Array, "waypoint"],
    *,
    turning: tuple[bool, ...],
    iterations: int,
) -> Polished:
    """Makes the energy of a motion small by L-BFGS on the swivels.

    Args:
        arm: The arm.
        path: The path.
        energy: What to make small.
        swivel: Where to begin, inside the box, ``(waypoint,)`` [rad].
        branch: Branch at every waypoint, kept.
        box: Lowest and highest swivel; infinite where the whole circle is free.
        pinned: Waypoints whose swivel stays.
        turning: Which joints turn without end.
        iterations: At most so many.

    Returns:
        The best motion seen.
    """
    lower, upper = box
    free = ~(jnp.isfinite(lower) & jnp.isfinite(upper))
    middle = jnp.where(free, 0.0, (lower + upper) / 2)
    half = jnp.where(free, 1.0, (upper - lower) / 2)
    # At an end of the box the sine has no slope: begin a little inside, at 0.5 % of the half width from it.
    ratio = jnp.clip((swivel - middle) / jnp.maximum(half, jnp.finfo(half.dtype).tiny), -0.995, 0.995)
    u0 = jnp.where(free, swivel, jnp.arcsin(jnp.where(free, 0.0, ratio)))
    scale = jnp.maximum(energy(arm, posture(arm, path, swivel, branch, turning), path.time_s), 1e-12)

    def to_swivel(z: Array) -> Array:
        u = u0 + _spread(jnp.where(pinned, 0.0, z))
        return jnp.where(pinned, swivel, jnp.where(free, u, middle + half * jnp.sin(jnp.where(free, 0.0, u))))

    def objective(z: Array) -> Array:
        q = posture(arm, path, to_swivel(z), branch, turning)
        speed = jnp.abs(jnp.diff(q, axis=0)) / (jnp.diff(path.time_s)[:, None] * arm.velocity_limit)
        excess = jnp.maximum(speed - _SPEED_MARGIN, 0.0)
        return energy(arm, q, path.time_s) / scale + _SPEED_PENALTY * jnp.sum(excess**2)

    search = optax.scale_by_backtracking_linesearch(max_backtracking_steps=15, store_grad=True)
    optimizer = optax.lbfgs(memory_size=_MEMORY, linesearch=search)
    value_and_grad = optax.value_and_grad_from_state(objective)

    def step(carry: tuple) -> tuple:
        z, state, _, last, small, count = carry
        value, grad = value_and_grad(z, state=state)
        updates, state = optimizer.update(grad, state, z, value=value, grad=grad, value_fn=objective)
        # Ends after five steps in a row that gain less than a billionth: one alone may be an unlucky line search.
        small = jnp.where(last - value < 1e-9 * jnp.abs(value), small + 1, 0)
        return optax.apply_updates(z, updates), state, value, value, small, count + 1

    def more(carry: tuple) -> Array:
        *_, small, count = carry
        return (count < iterations) & (small < 5)

    z = jnp.zeros_like(swivel)
    infinite = jnp.asarray(jnp.inf, swivel.dtype)
    zero = jnp.zeros((), jnp.int32)
    z, *_, count = lax.while_loop(more, step, (z, optimizer.init(z), infinite, infinite, zero, zero))
    best = to_swivel(z)
    q = posture(arm, path, best, branch, turning)
    return Polished(best, q, energy(arm, q, path.time_s), count)


def _spread(z: Array) -> Array:
    """C^-T z, a bidiagonal solve; alpha makes bumps shorter than a sixteenth of the path stiff."""
    diagonal, below = (jnp.asarray(x, z.dtype) for x in _string_factor(z.shape[0]))

    def back(after: Array, row: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        value, c, low = row
        x = (value - low * after) / c
        return x, x

    return lax.scan(back, jnp.zeros((), z.dtype), (z, diagonal, below), reverse=True)[1]


def _string_factor(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Diagonal of C and the entries below it, the last one zero."""
    alpha = (count / 16.0) ** 2 / 10.0
    stiffness = np.full(count, 1.0 + 2.0 * alpha)
    stiffness[[0, -1]] -= alpha
    diagonal, below = np.zeros(count), np.zeros(count)
    for k in range(count):
        diagonal[k] = np.sqrt(stiffness[k] - (below[k - 1] ** 2 if k else 0.0))
        below[k] = -alpha / diagonal[k] if k < count - 1 else 0.0
    return diagonal, below
