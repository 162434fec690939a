"""In which valley of the energy an arm should go: a coarse search over branch and swivel at a few waypoints.

1. Joint motion between neighboring waypoints for an elbow that stays in its cell of swivel or moves to the next one.
   Shoulder, elbow and wrist are priced apart and added up: eight branches share two elbows and two solutions a triple.
2. Dynamic programming over branch and cell. A motion keeps its branch.

Few waypoints and wide cells on purpose. The search only has to say which way round the elbow goes; how it goes there is
a matter of slopes, which follow (:mod:`training.linear_step`).
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxik.arm import Arm
from jaxik.numerics import arctan2, clipped_sqrt, sincos
from training.elbow_charts import ElbowCharts, near

CELLS = 16  # 22.5 degrees; 12 lose half as much again, 24 win nothing
WAYPOINTS = 8  # of a path that asks for 16 knots; 6 lose half as much again, 12 and more win nothing
EXCESS = 20.0  # relative price of one radian of mean excess over a joint's range: 1 % for 0.03 degrees
_SHIFTS = (-1, 0, 1)  # cells that a step may move


class Start(NamedTuple):
    """The postures that arms come from.

    Attributes:
        q: ``(joint, B)`` [rad].
        rate: One over the time they have to the first waypoint, ``(B,)`` [1/s]; zero for arms that come from nowhere.
    """

    q: Array
    rate: Array


class Triple(NamedTuple):
    """What three joints cost at and between waypoints, by solution bit, elbow bit and cell.

    Attributes:
        motion: Σ w Δq² of the steps, ``(2, shift, 2, CELLS, n - 1, B)``.
        coming: The same of the way from the start, times its rate, ``(2, 2, CELLS, B)``.
        excess: Beyond the joints' ranges, ``(2, 2, CELLS, n, B)`` [rad].
    """

    motion: Array
    coming: Array
    excess: Array


def best_valley(arm: Arm, charts: ElbowCharts, time_s: Array, weight: Array, start: Start) -> tuple[Array, Array]:
    """The cheapest coarse motion of every path.

    Args:
        arm: The arm.
        charts: Of B paths at n waypoints.
        time_s: ``(n, B)`` [s].
        weight: Of Δq² / dt in the energy, ``(joint,)``.
        start: Where the arms come from.

    Returns:
        Swivels ``(n, B)`` [rad], without jumps of a full turn, and branches ``(B,)``.
    """
    count = time_s.shape[1]
    sin, cos = (x[:, None, None] for x in sincos(_grid(time_s)))
    rate = 1.0 / jnp.diff(time_s, axis=0)
    shoulder = _triple(arm, charts.shoulder, charts.shoulder_delta, 0, (sin, cos), weight, start)
    wrist = _triple(arm, charts.wrist, charts.wrist_delta, 4, (sin, cos), weight, start)
    elbow = charts.elbow
    elbow_motion = (weight[3] * jnp.diff(elbow, axis=1) ** 2)[:, None]  # (elbow bit, 1, n - 1, B)
    elbow_excess = jnp.maximum(jnp.maximum(arm.lower[3] - elbow, elbow - arm.upper[3]), 0.0)[:, None]
    elbow_coming = (weight[3] * (elbow[:, 0] - start.q[3]) ** 2 * start.rate)[:, None]
    room = charts.keep_out[:, 0][:, None] + charts.keep_out[:, 1][:, None] * cos + charts.keep_out[:, 2][:, None] * sin
    forbidden = jnp.sum(jnp.maximum(-room, 0.0), axis=0) / arm.length  # (CELLS, n, B)

    def branches(s: Array, e: Array, w: Array) -> Array:
        """Sums ``(shoulder bit, wrist bit, elbow bit, CELLS, ...)``."""
        return s[:, None] + w[None] + e

    stay = len(_SHIFTS) // 2
    held = [jnp.sum(x * rate, axis=-2) for x in (shoulder.motion[:, stay], elbow_motion, wrist.motion[:, stay])]
    excess = branches(shoulder.excess, elbow_excess + forbidden, wrist.excess)
    constant = branches(*held) * (1.0 + EXCESS * jnp.mean(excess, axis=-2))
    price = EXCESS / len(time_s) * jnp.min(constant, axis=(0, 1, 2, 3))
    node = jnp.moveaxis(price * excess, -2, 0)
    steps = [jnp.moveaxis(x * rate, -2, 0) for x in (shoulder.motion, elbow_motion, wrist.motion)]

    def forward(value: Array, layer: tuple[Array, ...]) -> tuple[Array, Array]:
        s, e, w, node = layer
        best, choice = jnp.full_like(value, jnp.inf), jnp.zeros(value.shape, jnp.int32)
        for i, shift in enumerate(_SHIFTS):
            reached = jnp.roll(value, -shift, axis=3) + branches(s[:, i], e, w[:, i])
            choice = jnp.where(reached < best, shift, choice)
            best = jnp.minimum(best, reached)
        return best + node, choice

    first = branches(shoulder.coming, elbow_coming, wrist.coming) + node[0]
    last, choices = lax.scan(forward, first, (*steps, node[1:]))
    flat, choices = (jnp.moveaxis(x, -4, -3).reshape(*x.shape[:-5], -1, count) for x in (last, choices))
    end = jnp.argmin(flat, axis=0)  # states are branch * CELLS + cell
    branch, cell = end // CELLS, end % CELLS

    def backward(cell: Array, choice: Array) -> tuple[Array, Array]:
        before = cell + jnp.take_along_axis(choice, (branch * CELLS + cell % CELLS)[None], 0)[0]
        return before, before

    _, cells = lax.scan(backward, cell, choices, reverse=True)
    cells = jnp.concatenate([cells, cell[None]]).astype(time_s.dtype)
    swivel = cells * (2 * jnp.pi / CELLS) - jnp.pi
    return swivel, branch


def _grid(like: Array) -> Array:
    return jnp.linspace(-jnp.pi, jnp.pi, CELLS, endpoint=False, dtype=like.dtype)


def _triple(
    arm: Arm, entries: Array, delta: Array, first: int, trig: tuple[Array, Array], weight: Array, start: Start
) -> Triple:
    """Prices of a triple whose first joint is number ``first``."""
    sin, cos = trig
    values = entries[:, 0][:, :, None] + entries[:, 1][:, :, None] * cos + entries[:, 2][:, :, None] * sin
    middle = arctan2(clipped_sqrt(1.0 - values[2] ** 2), values[2])
    outer = [arctan2(values[1], values[0])] + ([arctan2(values[4], values[3])] if len(values) == 5 else [])
    turned = [a + jnp.pi for a in outer]
    solutions = (
        [outer[0], middle - delta, *outer[1:]],
        [turned[0], -middle - delta, *turned[1:]],
    )
    motion, coming, excess = [], [], []
    for solution in solutions:
        moved = [jnp.zeros((), values.dtype)] * len(_SHIFTS)
        came, over = jnp.zeros((), values.dtype), jnp.zeros((), values.dtype)
        for joint, angle in enumerate(solution, first):
            center, half = (arm.upper[joint] + arm.lower[joint]) / 2, (arm.upper[joint] - arm.lower[joint]) / 2
            off = near(angle - center)
            over = over + jnp.maximum(jnp.abs(off) - half, 0.0)
            came = came + weight[joint] * near(off[..., 0, :] + center - start.q[joint]) ** 2
            turns = half >= jnp.pi * (1 - 1e-6)
            for i, shift in enumerate(_SHIFTS):
                # A joint that does not turn without end has to come back the way it went.
                step = off[..., 1:, :] - jnp.roll(off[..., :-1, :], -shift, axis=1)
                moved[i] = moved[i] + weight[joint] * jnp.where(turns, near(step), step) ** 2
        motion.append(jnp.stack(moved))
        coming.append(came * start.rate)
        excess.append(over)
    return Triple(jnp.stack(motion), jnp.stack(coming), jnp.stack(excess))


def coarse(knots: int) -> np.ndarray:
    """The knots that the search looks at, first and last included: every other one."""
    return np.unique(np.linspace(0, knots - 1, max(2, min(knots, knots * WAYPOINTS // 16))).round().astype(int))
