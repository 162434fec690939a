"""In which valley of the energy an arm should go: a coarse search over branch and swivel at a few waypoints.

1. Joint motion between neighboring waypoints for an elbow that stays in its cell of swivel or moves to the next one.
   Shoulder, elbow and wrist are priced apart and added up: eight branches share two elbows and two solutions a triple.
2. Dynamic programming over branch and cell. A motion keeps its branch.

Few waypoints and wide cells on purpose. The search only has to say which way round the elbow goes; how it goes there is
a matter of slopes, which follow (:mod:`training.linear_step`).
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxik.arm import Arm
from jaxik.numerics import arctan2, clipped_sqrt, sincos
from jaxik.staging import stage
from training.elbow_charts import ElbowCharts, near

CELLS = 16  # 22.5 degrees; 12 lose half as much again, 24 win nothing
WAYPOINTS = 8  # of a path that asks for 16 knots; 6 lose half as much again, 12 and more win nothing
EXCESS = 20.0  # relative price of one radian of mean excess over a joint's range: 1 % for 0.03 degrees
_TIE = 1e-4  # relative difference of prices that is none
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
    """What three joints cost at and between waypoints; every array ends in (elbow bit, CELLS, B).

    Attributes:
        motion: Σ w Δq² / dt of the steps, for every solution bit and shift ``(n - 1, ...)``.
        coming: The same of the way from the start, for every solution bit.
        excess: Beyond the joints' ranges, for every solution bit ``(n, ...)`` [rad].
    """

    motion: tuple[tuple[Array, ...], ...]
    coming: tuple[Array, ...]
    excess: tuple[Array, ...]


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
    grid = jnp.linspace(-jnp.pi, jnp.pi, CELLS, endpoint=False, dtype=time_s.dtype)
    sin, cos = (x[:, None] for x in sincos(grid))
    rate = (1.0 / jnp.diff(time_s, axis=0))[:, None, None]
    parts = ((charts.shoulder, charts.shoulder_delta, 0), (charts.wrist, charts.wrist_delta, 4))
    shoulder, wrist = (_triple(arm, *part, (sin, cos), rate, weight, start) for part in parts)
    elbow = jnp.moveaxis(charts.elbow, 1, 0)[:, :, None]  # (n, elbow bit, 1, B)
    elbow_motion = weight[3] * jnp.diff(elbow, axis=0) ** 2 * rate
    elbow_coming = weight[3] * (elbow[0] - start.q[3]) ** 2 * start.rate
    a, b, c = jnp.moveaxis(charts.keep_out, (1, 2), (0, 1))[:, :, :, None]
    forbidden = jnp.sum(jnp.maximum(-(a + b * cos + c * sin), 0.0), axis=1) / arm.length  # (n, CELLS, B)
    other_excess = jnp.maximum(jnp.maximum(arm.lower[3] - elbow, elbow - arm.upper[3]), 0.0) + forbidden[:, None]

    def branches(s: Sequence[Array], e: Array, w: Sequence[Array]) -> Array:
        """Sums ``(shoulder bit, wrist bit, elbow bit, CELLS, B)``."""
        return jnp.stack(s)[:, None] + jnp.stack(w)[None] + e

    stay = len(_SHIFTS) // 2
    moved = [[_total(x[stay]) for x in triple.motion] for triple in (shoulder, wrist)]
    over = [[_total(x) for x in triple.excess] for triple in (shoulder, wrist)]
    mean_excess = branches(over[0], _total(other_excess), over[1]) / len(time_s)
    constant = branches(moved[0], _total(elbow_motion), moved[1]) * (1.0 + EXCESS * mean_excess)
    price = EXCESS / len(time_s) * jnp.min(constant, axis=(0, 1, 2, 3))

    def forward(value: Array, layer: tuple[Any, ...]) -> tuple[Array, Array]:
        s, e, w, s_excess, other, w_excess = layer
        best, choice = jnp.full_like(value, jnp.inf), jnp.zeros(value.shape, jnp.int32)
        for i, shift in enumerate(_SHIFTS):
            reached = jnp.roll(value, -shift, axis=3) + branches([x[i] for x in s], e, [x[i] for x in w])
            choice = jnp.where(reached < best, shift, choice)
            best = jnp.minimum(best, reached)
        return best + price * branches(s_excess, other, w_excess), choice

    nodes = shoulder.excess, other_excess, wrist.excess
    at_first, later = jax.tree.map(lambda x: x[0], nodes), jax.tree.map(lambda x: x[1:], nodes)
    first = branches(shoulder.coming, elbow_coming, wrist.coming) + price * branches(*at_first)
    last, choices = lax.scan(forward, first, (shoulder.motion, elbow_motion, wrist.motion, *later))
    flat, choices = (jnp.moveaxis(x, -4, -3).reshape(*x.shape[:-5], -1, count) for x in (last, choices))
    # States are branch * CELLS + cell. Branches often cost the same; the first is taken, whatever rounding says.
    order = 1.0 + _TIE * (np.arange(len(flat)) // CELLS).astype(np.float32)[:, None]
    end = jnp.argmin(flat * order.astype(flat.dtype), axis=0).astype(jnp.int32)
    branch, cell = end // CELLS, end % CELLS

    def backward(cell: Array, choice: Array) -> tuple[Array, Array]:
        before = cell + jnp.take_along_axis(choice, (branch * CELLS + cell % CELLS)[None], 0)[0]
        return before, before

    _, cells = lax.scan(backward, cell, choices, reverse=True)
    cells = jnp.concatenate([cells, cell[None]]).astype(time_s.dtype)
    swivel = cells * (2 * jnp.pi / CELLS) - jnp.pi
    return swivel, branch


@stage
def _offsets(
    entries: Array, delta: Array, center: Array, sin: Array, cos: Array
) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """Angles of a triple in both solutions, from the middles of the joints' ranges, ``(n, elbow bit, CELLS, B)``."""
    values = [e[0] + e[1] * cos + e[2] * sin for e in entries]
    outer = [arctan2(values[1], values[0])] + ([arctan2(values[4], values[3])] if len(values) == 5 else [])
    middle = arctan2(clipped_sqrt(1.0 - values[2] ** 2), values[2])
    # The other solution: outer joints half a turn on, the middle one with the other sign.
    solutions = (
        (outer[0], middle - delta, *outer[1:]),
        (outer[0] + jnp.pi, -middle - delta, *(a + jnp.pi for a in outer[1:])),
    )
    return tuple(tuple(near(a - c) for a, c in zip(s, center, strict=False)) for s in solutions)  # pyright: ignore


def _triple(
    arm: Arm,
    entries: Array,
    delta: Array,
    first: int,
    trig: tuple[Array, Array],
    rate: Array,
    weight: Array,
    start: Start,
) -> Triple:
    """Prices of a triple whose first joint is number ``first``."""
    center, half = ((arm.upper + arm.lower) / 2)[first:], ((arm.upper - arm.lower) / 2)[first:]
    entries = jnp.moveaxis(entries, 3, 2)[..., None, :]  # (5 or 3, 3, n, elbow bit, 1, B)
    solutions = _offsets(entries, delta, center, *trig)
    came = near(start.q[first:] - center[:, None])
    prices = [_prices(s, half, weight[first:], rate, came, start.rate) for s in solutions]
    return Triple(*zip(*prices, strict=True))  # pyright: ignore


@stage
def _prices(
    offsets: tuple[Array, ...], half: Array, weight: Array, rate: Array, came: Array, come_rate: Array
) -> tuple[tuple[Array, ...], Array, Array]:
    """Motion for every shift, coming and excess of one solution, see :class:`Triple`."""
    motion = [jnp.zeros((), rate.dtype)] * len(_SHIFTS)
    coming, excess = jnp.zeros((), rate.dtype), jnp.zeros((), rate.dtype)
    for joint, off in enumerate(offsets):
        coming = coming + weight[joint] * near(off[0] - came[joint]) ** 2
        excess = excess + jnp.maximum(jnp.abs(off) - half[joint], 0.0)
        # A joint that does not turn without end has to come back the way it went.
        turn = jnp.where(half[joint] >= jnp.pi * (1 - 1e-6), 2 * jnp.pi, 0.0).astype(rate.dtype)
        for i, shift in enumerate(_SHIFTS):
            step = off[1:] - jnp.roll(off[:-1], -shift, axis=2)
            step = step - turn * jnp.round(step * (0.5 / jnp.pi))
            motion[i] = motion[i] + weight[joint] * step * step
    return tuple(m * rate for m in motion), coming * come_rate, excess


def _total(x: Array) -> Array:
    """Sum over the waypoints, written out: a reduction over the first axis is no vector code."""
    return sum((x[k] for k in range(1, len(x))), start=x[0])


def coarse(knots: int) -> np.ndarray:
    """The knots that the search looks at, first and last included: every other one."""
    return np.unique(np.linspace(0, knots - 1, max(2, min(knots, knots * WAYPOINTS // 16))).round().astype(int))
