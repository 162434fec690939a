"""In which valleys of the energy an arm could go: a coarse search over branch and swivel at a few waypoints.

1. Joint motion between neighboring waypoints for an elbow that stays in its cell of swivel or moves to the next one, in
   one branch or through an aligned shoulder or wrist into another (:mod:`jaxik.planning.fast.branch_changes`).
   Shoulder, elbow and wrist are priced apart and added up: eight branches share two elbows and two solutions a triple.
2. Dynamic programming over branch and cell, from both ends to the middle. That gives the cheapest motion through every
   cell there, and motions through different cells may lie in different valleys: they are the candidates.

Few waypoints and wide cells on purpose. The search only has to say which ways round the elbow could go; how it goes
there, and which way is best, is a matter of slopes, which follow (:mod:`jaxik.planning.fast.gauss_newton`).
"""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxik.arm import Arm
from jaxik.numerics import sincos
from jaxik.planning.fast.coarse_costs import CELLS, SHIFTS, Start, Triple, cell_swivels, triple
from jaxik.planning.fast.path_batch import ElbowCharts

EXCESS = 20.0  # relative price of one radian of mean excess over a joint's range: 1 % for 0.03 degrees
_TIE = 1e-4  # relative difference of prices that is none
_STAY = SHIFTS.index(0)
_CHANGES = ((0, 0), (1, 0), (0, 1))  # of solution in a step: none, the shoulder's, the wrist's
_BITS = np.array([4 * shoulder + wrist for shoulder, wrist in _CHANGES], np.int32)  # the same of the branch

State = tuple[Array, Array]


def best_valleys(
    arm: Arm, charts: ElbowCharts, time: Array, weight: Array, start: Start, count: int
) -> tuple[Array, Array]:
    """The cheapest coarse motions of every path through different cells at its middle.

    Args:
        arm: The arm.
        charts: Of B paths at n waypoints, an odd number.
        time: ``(n, B)`` [s].
        weight: Of Δq² / dt in the energy, ``(joint,)``.
        start: Where the arms come from.
        count: How many, at most ``CELLS``.

    Returns:
        Swivels ``(count, n, B)`` [rad], without jumps of a full turn, and branches ``(count, n, B)``; the cheapest
        first.
    """
    middle = len(time) // 2
    # The halves of a path are paths of their own, which end where they meet.
    halves = np.arange(middle + 1), np.arange(2 * middle, middle - 1, -1)
    joined = charts.joined(*halves)
    times = jnp.concatenate([time[half] for half in halves], axis=1)
    starts = Start(jnp.concatenate([start.q] * 2, axis=1), jnp.concatenate([start.rate, 0.0 * start.rate]))
    swivels = cell_swivels(joined)
    value, choices = _programmed(arm, joined, times, weight, starts, sincos(swivels))
    # Branches often cost the same; the first is taken, whatever rounding says.
    value = value * (1.0 + _TIE * np.arange(8, dtype=np.float32)[:, None, None].astype(value.dtype))
    cell = jnp.argsort(jnp.min(value, axis=0), axis=0)[:count].astype(jnp.int32)
    branch = jnp.take_along_axis(jnp.argmin(value, axis=0).astype(jnp.int32), cell, 0)
    branch, cell = _traced(choices, (branch, cell))
    rows = swivels.reshape(len(swivels), 2 * CELLS, -1)
    at = jnp.take_along_axis(rows, (branch >> 1 & 1) * CELLS + cell % CELLS, 1)
    at = at + 2 * jnp.pi * (cell // CELLS).astype(at.dtype)
    parts = [jnp.split(jnp.moveaxis(x, 1, 0), 2, axis=-1) for x in (at, branch)]
    swivel, branch = (jnp.concatenate([coming, going[:, -2::-1]], axis=1) for coming, going in parts)
    return swivel, branch


def coarse(knots: int) -> np.ndarray:
    """The knots that the search looks at, an odd number of them: every other one, first and last included."""
    return np.linspace(0, knots - 1, 2 * max(1, knots // 4) + 1 if knots > 2 else 1).round().astype(int)


def _programmed(
    arm: Arm, charts: ElbowCharts, time: Array, weight: Array, start: Start, trig: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Dynamic programming along both halves of B paths, all first halves and then all second ones.

    Returns:
        What the cheapest motion through every place in the middle costs, ``(8, CELLS, B)``, and from where each half
        came, change of branch and shift in one number, ``(n - 1, 8 * CELLS, 2 B)``.
    """
    sin, cos = trig
    rate = (1.0 / jnp.abs(jnp.diff(time, axis=0)))[:, None, None]
    parts = ((charts.shoulder, charts.shoulder_delta, 0), (charts.wrist, charts.wrist_delta, 4))
    shoulder, wrist = (triple(arm, *part, trig, rate, weight, start) for part in parts)
    elbow = jnp.moveaxis(charts.elbow, 1, 0)[:, :, None]  # (n, elbow bit, 1, 2 B)
    elbow_motion = weight[3] * jnp.diff(elbow, axis=0) ** 2 * rate
    elbow_coming = weight[3] * (elbow[0] - start.q[3]) ** 2 * start.rate
    a, b, c = jnp.moveaxis(charts.keep_out, (1, 2), (0, 1))[:, :, :, None, None]
    forbidden = jnp.sum(jnp.maximum(-(a + b * cos[:, None] + c * sin[:, None]), 0.0), axis=1) / arm.length
    other_excess = jnp.maximum(jnp.maximum(arm.lower[3] - elbow, elbow - arm.upper[3]), 0.0) + forbidden
    price = _price_of_excess(shoulder, elbow_motion, wrist, other_excess)

    def forward(value: Array, layer: tuple[Any, ...]) -> tuple[Array, Array]:
        s, e, w, s_excess, other, w_excess = layer
        best, choice = jnp.full_like(value, jnp.inf), jnp.zeros(value.shape, jnp.int32)
        for change, (of_shoulder, of_wrist) in enumerate(_CHANGES):
            source = jnp.flip(value, [axis for axis, flips in enumerate((of_shoulder, of_wrist)) if flips])
            for i, shift in enumerate(SHIFTS):
                way = _branches([x[i] for x in s[of_shoulder]], e, [x[i] for x in w[of_wrist]])
                reached = jnp.roll(source, -shift, axis=3) + way
                choice = jnp.where(reached < best, change * len(SHIFTS) + i, choice)
                best = jnp.minimum(best, reached)
        return best + price * _branches(s_excess, other, w_excess), choice

    nodes = shoulder.excess, other_excess, wrist.excess
    at_first, later = jax.tree.map(lambda x: x[0], nodes), jax.tree.map(lambda x: x[1:], nodes)
    at_middle = price * _branches(*jax.tree.map(lambda x: x[-1], nodes))
    first = _branches(shoulder.coming, elbow_coming, wrist.coming) + price * _branches(*at_first)
    last, choices = lax.scan(forward, first, (shoulder.motion, elbow_motion, wrist.motion, *later))
    # From (shoulder bit, wrist bit, elbow bit) to branches.
    last, at_middle, choices = (
        jnp.moveaxis(x, -4, -3).reshape(*x.shape[:-5], 8, CELLS, x.shape[-1]) for x in (last, at_middle, choices)
    )
    coming, going = jnp.split(last, 2, axis=-1)
    return coming + going - jnp.split(at_middle, 2, axis=-1)[0], choices.reshape(
        len(choices), 8 * CELLS, last.shape[-1]
    )


def _price_of_excess(shoulder: Triple, elbow_motion: Array, wrist: Triple, other_excess: Array) -> Array:
    """Of a radian at one waypoint: in proportion to what the best motion costs whose elbow stays in its cell, (2 B)."""
    count = 2 * len(elbow_motion) + 1
    moved = [[_total(x[_STAY]) for x in t.motion[0]] for t in (shoulder, wrist)]
    over = [[_total(x) for x in t.excess] for t in (shoulder, wrist)]
    motion, excess = (
        sum(jnp.split(_branches(s, e, w), 2, axis=-1))
        for s, e, w in ((moved[0], _total(elbow_motion), moved[1]), (over[0], _total(other_excess), over[1]))
    )
    least = jnp.min(motion * (1.0 + EXCESS / count * excess), axis=(0, 1, 2, 3))
    return EXCESS / count * jnp.concatenate([least, least])


def _branches(s: Sequence[Array], e: Array, w: Sequence[Array]) -> Array:
    """Sums ``(shoulder bit, wrist bit, elbow bit, CELLS, B)``."""
    return jnp.stack(list(s))[:, None] + jnp.stack(list(w))[None] + e


def _total(x: Array) -> Array:
    """Sum over the waypoints, written out: a reduction over the first axis is no vector code."""
    return sum(x, start=jnp.zeros(x.shape[1:], x.dtype))


def _traced(choices: Array, middle: State) -> State:
    """Branches and cells ``(n, count, 2 B)`` of both halves that lead to states in the middle, ``(count, B)`` each."""

    def backward(state: State, choice: Array) -> tuple[State, State]:
        branch, cell = state
        taken = jnp.take_along_axis(choice, branch * CELLS + cell % CELLS, 0)
        change, shift = taken // len(SHIFTS), taken % len(SHIFTS)
        state = branch ^ jnp.asarray(_BITS)[change], cell + shift - _STAY
        return state, state

    last = tuple(jnp.tile(x, (1, 2)) for x in middle)
    _, states = lax.scan(backward, last, choices, reverse=True)  # pyright: ignore
    branch, cell = (jnp.concatenate([x, at[None]]) for x, at in zip(states, last, strict=True))
    return branch, cell
