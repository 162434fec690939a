"""One Gauss-Newton step on the swivels of many paths: to the least joint motion if joints moved linearly.

The joints' changes with the swivel couple neighbors only: the step is one tridiagonal solve per path, for all paths.
Limits and keep-out push back by the square of their violation.
"""

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxik.numerics import fused_separately
from jaxik.planning.fast.path_batch import PathBatch, steps
from jaxik.redundancy import BranchMotion

LONGEST = 0.6  # swivel that a step may move: beyond, joints are not linear [rad]
_MARGIN = 0.02  # room to keep to limits [rad, arm lengths]: interpolation between knots uses some
_PUSH = 30.0  # weight of a violation, against that of a joint's motion in one step
_DAMPING = 1e-3  # added to the diagonal, against its mean: where the swivel does not matter it stays


@fused_separately
def gauss_newton_step(batch: PathBatch, motion: BranchMotion, swivel: Array, q: Array, slope: Array) -> Array:
    """Return the change of the swivels, ``(K, B)`` [rad].

    Args:
        batch: The paths.
        motion: Their self-motion in the branches taken.
        swivel: Present swivels, ``(K, B)`` [rad].
        q: Joint angles there, ``(joint, K, B)`` [rad].
        slope: Their derivatives in the swivel, ``(joint, K, B)``.
    """
    arm, weights, start = batch.arm, batch.weights, batch.start
    rate = 1.0 / jnp.diff(batch.time, axis=0)
    none = jnp.zeros_like(swivel[:1])
    across = weights[:, None, None] * slope
    speed = steps(q) * rate
    approach = jnp.sum(across[:, :1] * batch.approach(q)[:, None], axis=0) * start.rate
    gradient = jnp.concatenate([approach, jnp.sum(across[:, 1:] * speed, axis=0)])
    gradient = gradient - jnp.concatenate([jnp.sum(across[:, :-1] * speed, axis=0), none])
    around = jnp.concatenate([start.rate[None], rate]) + jnp.concatenate([rate, none])
    main = jnp.sum(across * slope, axis=0) * around
    beside = -jnp.sum(across[:, 1:] * slope[:, :-1], axis=0) * rate

    lower, upper = arm.lower[:, None, None] + _MARGIN, arm.upper[:, None, None] - _MARGIN
    violation = jnp.maximum(lower - q, 0.0) - jnp.maximum(q - upper, 0.0)
    distance = motion.keep_out_distance
    room, room_slope = (x / arm.length for x in jax.jvp(distance, (swivel,), (jnp.ones_like(swivel),)))
    violation = jnp.concatenate([violation, jnp.maximum(_MARGIN - room, 0.0)])
    change = jnp.concatenate([slope, room_slope])
    push = _PUSH * jnp.max(weights) * jnp.sum(rate, axis=0) / max(len(rate), 1)  # a single waypoint has no rate
    gradient = gradient - push * jnp.sum(change * violation, axis=0)
    main = main + push * jnp.sum(jnp.where(violation != 0.0, change**2, 0.0), axis=0)
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
