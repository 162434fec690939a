"""Local polish at full resolution: one swivel per waypoint, kept inside its feasible arc by construction.

Limits and keep-out bound each waypoint's swivel to an arc, so the constraints are a box, and a box needs no barrier:
psi = middle + half * sin(u) never leaves it and reaches its ends. Neighbors are coupled like a string's points; the
optimizer therefore works on z with u = C^-T z, C C^T = I + alpha L and L the string's stiffness, which takes the
number of iterations from hundreds to tens.
"""

from collections.abc import Callable
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
from jaxik.planning.problem import approach_cost

_SPEED_MARGIN = 0.98  # the penalty on joint speeds sets in here, so that the limit itself is kept
_SPEED_PENALTY = 1e2  # against an energy scaled to one
_MEMORY = 20  # pairs kept: a little above optax's 10, cheap beside an evaluation
_ARMIJO = 1e-4  # share of the promised decrease that a step must bring
_SHORTEST = 1e-9  # a step this short ends the search
_ENOUGH, _STALLED = 1e-9, 5


class Polished(NamedTuple):
    """Result of a polish.

    Attributes:
        swivel: ``(waypoint,)`` [rad].
        evaluations: How often the energy was evaluated, ``()``.
    """

    swivel: Float[Array, "waypoint"]
    evaluations: Int[Array, ""]


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
    scale: Float[Array, ""],
    start: Float[Array, "joint"] | None,
    approach_s: Float[Array, ""],
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
        scale: Size of the energy, that of the beginning.
        start: Posture the arm comes from, if any, ``(joint,)`` [rad].
        approach_s: Time it has for that [s].
        turning: Which joints turn without end.
        iterations: At most so many evaluations.

    Returns:
        The swivels found.
    """
    lower, upper = box
    free = ~(jnp.isfinite(lower) & jnp.isfinite(upper))
    middle = jnp.where(free, 0.0, (lower + upper) / 2)
    half = jnp.where(free, 1.0, (upper - lower) / 2)
    # At an end of the box the sine has no slope: begin a little inside, at 0.5 % of the half width from it.
    ratio = jnp.clip((swivel - middle) / jnp.maximum(half, jnp.finfo(half.dtype).tiny), -0.995, 0.995)
    u0 = jnp.where(free, swivel, jnp.arcsin(jnp.where(free, 0.0, ratio)))

    def to_swivel(z: Array) -> Array:
        u = u0 + _spread(jnp.where(pinned, 0.0, z))
        return jnp.where(pinned, swivel, jnp.where(free, u, middle + half * jnp.sin(jnp.where(free, 0.0, u))))

    def objective(z: Array) -> Array:
        q = posture(arm, path, to_swivel(z), branch, turning)
        speed = jnp.abs(jnp.diff(q, axis=0)) / (jnp.diff(path.time_s)[:, None] * arm.velocity_limit)
        excess = jnp.maximum(speed - _SPEED_MARGIN, 0.0)
        spent = energy(arm, q, path.time_s)
        spent = spent + approach_cost(start, q[0], energy.motion_weight(arm), approach_s, turning)
        return spent / scale + _SPEED_PENALTY * jnp.sum(excess**2)

    z = jnp.zeros_like(swivel)
    z, count = _minimize(jax.value_and_grad(objective), z, iterations)
    return Polished(to_swivel(z), count)


class _Search(NamedTuple):
    """Where the minimizer stands: the accepted point, and the trial step from it."""

    point: Array
    value: Array
    grad: Array
    direction: Array
    step: Array
    memory: optax.OptState
    stalled: Array
    count: Array


def _minimize(value_and_grad: Callable[[Array], tuple[Array, Array]], point: Array, most: int) -> tuple[Array, Array]:
    """L-BFGS with step halving.

    One loop in which every turn evaluates one trial point, accepted or not: the function appears once in the program,
    where optax's own line searches would compile it three times over.
    """
    lbfgs = optax.scale_by_lbfgs(memory_size=_MEMORY)  # mixes integer widths: see the promotion rule where it is called
    one, infinite = jnp.ones((), point.dtype), jnp.asarray(jnp.inf, point.dtype)
    zero, count = jnp.zeros_like(point), jnp.zeros((), jnp.int32)

    def turn(s: _Search) -> _Search:
        trial = s.point + s.step * s.direction
        value, grad = value_and_grad(trial)
        slope = jnp.sum(s.grad * s.direction)
        good = jnp.isfinite(value) & (value <= s.value + _ARMIJO * s.step * slope)
        with jax.numpy_dtype_promotion("standard"):
            updates, memory = lbfgs.update(grad, s.memory, trial)
        # Ends after five accepted steps in a row that gain less than a billionth: one alone may be bad luck.
        small = s.value - value < _ENOUGH * jnp.abs(value)
        after = _Search(
            trial, value, grad, -jnp.asarray(updates), one, memory, jnp.where(small, s.stalled + 1, 0), s.count + 1
        )
        stuck = jnp.where(s.step < _SHORTEST, _STALLED, s.stalled)
        before = s._replace(step=s.step / 2, stalled=stuck, count=s.count + 1)
        return jax.tree.map(lambda a, b: jnp.where(good, a, b), after, before)

    # The first trial is the start itself, accepted because anything is better than infinity.
    start = _Search(point, infinite, zero, zero, one, lbfgs.init(point), count, count)
    end = lax.while_loop(lambda s: (s.count < most) & (s.stalled < _STALLED), turn, start)
    return end.point, end.count


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
