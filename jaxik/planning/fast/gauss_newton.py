"""One Gauss-Newton step on the swivels of many paths: where joint motion would be least if joints went straight.

The joints' changes with the swivel couple neighbors only: the step is one tridiagonal solve a path, all paths at once.
Limits and keep-out push back by the square of what is missing to them.
"""

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxik.arm import Arm
from jaxik.numerics import fused_separately
from jaxik.planning.fast.coarse_costs import Start
from jaxik.planning.fast.path_batch import BranchCharts, near, steps

LONGEST = 0.6  # swivel that a step may move: beyond, joints do not go straight [rad]
_MARGIN = 0.02  # room to keep to limits [rad, arm lengths]: interpolation between knots takes some
_PUSH = 30.0  # weight of what is missing, against that of a joint's motion in one step
_DAMPING = 1e-3  # added to the diagonal, against its mean: a path that leaves the swivel open stays where it is


@fused_separately
def linear_step(
    arm: Arm, charts: BranchCharts, swivel: Array, q: Array, slope: Array, time: Array, weight: Array, start: Start
) -> Array:
    """What to add to swivels ``(K, B)`` [rad].

    Args:
        arm: The arm.
        charts: Of the branches taken.
        swivel: Where the elbow is, ``(K, B)``.
        q: Joint angles there, ``(joint, K, B)``.
        slope: Their derivatives in the swivel.
        time: ``(K, B)`` [s].
        weight: Of the joints' motion, ``(joint,)``.
        start: Where the arms come from.
    """
    rate = 1.0 / jnp.diff(time, axis=0)
    none = jnp.zeros_like(swivel[:1])
    across = weight[:, None, None] * slope
    way = steps(q) * rate
    coming = jnp.sum(across[:, :1] * near(q[:, :1] - start.q[:, None]), axis=0) * start.rate
    gradient = jnp.concatenate([coming, jnp.sum(across[:, 1:] * way, axis=0)])
    gradient = gradient - jnp.concatenate([jnp.sum(across[:, :-1] * way, axis=0), none])
    around = jnp.concatenate([start.rate[None], rate]) + jnp.concatenate([rate, none])
    main = jnp.sum(across * slope, axis=0) * around
    beside = -jnp.sum(across[:, 1:] * slope[:, :-1], axis=0) * rate

    lower, upper = arm.lower[:, None, None] + _MARGIN, arm.upper[:, None, None] - _MARGIN
    missing = jnp.maximum(lower - q, 0.0) - jnp.maximum(q - upper, 0.0)
    room, room_slope = (x / arm.length for x in jax.jvp(charts.room, (swivel,), (jnp.ones_like(swivel),)))
    missing = jnp.concatenate([missing, jnp.maximum(_MARGIN - room, 0.0)])
    change = jnp.concatenate([slope, room_slope])
    push = _PUSH * jnp.max(weight) * jnp.mean(rate, axis=0)
    gradient = gradient - push * jnp.sum(change * missing, axis=0)
    main = main + push * jnp.sum(jnp.where(missing != 0.0, change**2, 0.0), axis=0)
    main = main + _DAMPING * jnp.mean(main, axis=0)
    return jnp.clip(_tridiagonal(main, beside, -gradient), -LONGEST, LONGEST)


def _tridiagonal(main: Array, beside: Array, right: Array) -> Array:
    """Solutions of symmetric positive systems ``(K, B)`` with ``(K - 1, B)`` beside the diagonal."""

    def eliminate(above: tuple[Array, Array], row: tuple[Array, ...]) -> tuple[tuple[Array, Array], tuple[Array, ...]]:
        pivot, y = above
        diagonal, side, value = row
        factor = side / pivot
        below = (diagonal - factor * side, value - factor * y)
        return below, below

    first = main[0], right[0]
    _, (pivots, ys) = lax.scan(eliminate, first, (main[1:], beside, right[1:]))

    def back(x: Array, row: tuple[Array, ...]) -> tuple[Array, Array]:
        pivot, side, y = row
        x = (y - side * x) / pivot
        return x, x

    pivots, ys = (jnp.concatenate([a[None], b]) for a, b in zip(first, (pivots, ys), strict=True))
    last = ys[-1] / pivots[-1]
    _, xs = lax.scan(back, last, (pivots[:-1], beside, ys[:-1]), reverse=True)
    return jnp.concatenate([xs, last[None]])
