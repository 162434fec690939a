"""The local minima that a path may lead to: a coarse search over branch and swivel at a few waypoints.

1. Joint motion between neighboring waypoints for an elbow that stays in its cell of swivel or moves to the next one, in
   one branch or through an aligned shoulder or wrist into another (:mod:`jaxik.planning.fast.branch_changes`).
   Shoulder, elbow and wrist are evaluated separately and added: eight branches share two elbows and two solutions of
   each spherical joint.
2. Dynamic programming over branch and cell, from both ends to the middle. That gives the cheapest motion through every
   cell there, and motions through different cells may lie in different basins: they are the candidates.

Few waypoints and wide cells on purpose. The search only has to find the basins; Gauss-Newton steps descend in them
(:mod:`jaxik.planning.fast.gauss_newton`).
"""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxik.ik import BRANCHES, branch_bits
from jaxik.planning.fast.coarse_costs import (
    CELLS,
    ELBOWS,
    SHIFTS,
    SphericalCosts,
    beside_cells,
    cell_swivels,
    spherical_costs,
)
from jaxik.planning.fast.path_batch import EXCESS, PathBatch, StartPostures, SwivelPath

_TIE = 1e-4  # relative difference of costs that count as equal
_STAY = SHIFTS.index(0)
_CHANGES = ((0, 0), (1, 0), (0, 1))  # of solution in a step: none, the shoulder's, the wrist's
_FLIPS = np.array([4 * shoulder + wrist for shoulder, wrist in _CHANGES], np.int32)  # of the branch number

State = tuple[Array, Array]


def coarse_search(batch: PathBatch, count: int) -> SwivelPath:
    """Return the cheapest coarse motions of every path through different cells at its middle.

    Args:
        batch: The paths at n waypoints, an odd number.
        count: Number of motions, at most ``CELLS``.

    Returns:
        Swivels ``(count, n, B)`` [rad], without jumps of a full turn, and branches ``(count, n, B)``, the cheapest
        first.
    """
    middle = len(batch.time) // 2
    halves = _halves(batch, (np.arange(middle + 1), np.arange(2 * middle, middle - 1, -1)))
    swivels = cell_swivels(halves.motion)
    value, choices = _dynamic_program(halves, swivels)
    # Branches often cost the same; the first is taken, whatever rounding says.
    value = value * (1.0 + _TIE * np.arange(BRANCHES, dtype=np.float32)[:, None, None].astype(value.dtype))
    cell = jnp.argsort(jnp.min(value, axis=0), axis=0)[:count].astype(jnp.int32)
    branch = jnp.take_along_axis(jnp.argmin(value, axis=0).astype(jnp.int32), cell, 0)
    branch, cell = _traced(choices, (branch, cell))
    rows = swivels.reshape(len(swivels), 2 * CELLS, -1)
    side = jnp.where(branch_bits(branch).elbow, CELLS, 0).astype(cell.dtype)
    at = jnp.take_along_axis(rows, side + cell % CELLS, 1)
    at = at + 2 * jnp.pi * (cell // CELLS).astype(at.dtype)
    parts = [jnp.split(jnp.moveaxis(x, 1, 0), 2, axis=-1) for x in (at, branch)]
    return SwivelPath(*(jnp.concatenate([first, second[:, -2::-1]], axis=1) for first, second in parts))


def searched_knots(knots: int) -> np.ndarray:
    """Return the knots that the search sees, an odd number: every other one, first and last included."""
    return np.linspace(0, knots - 1, 2 * max(1, knots // 4) + 1 if knots > 2 else 1).round().astype(int)


def _halves(batch: PathBatch, index: tuple[np.ndarray, np.ndarray]) -> PathBatch:
    """The two halves of every path as paths of their own that end in the middle: all first ones, then all second."""
    start = StartPostures(
        jnp.concatenate([batch.start.q] * 2, axis=1), jnp.concatenate([batch.start.rate, 0.0 * batch.start.rate])
    )
    return batch._replace(
        motion=batch.motion.map_rows(lambda x: jnp.concatenate([x[..., half, :] for half in index], axis=-1)),
        time=jnp.concatenate([batch.time[half] for half in index], axis=1),
        start=start,
    )


def _dynamic_program(batch: PathBatch, swivels: Array) -> tuple[Array, Array]:
    """Dynamic programming along both halves of B paths, all first halves and then all second ones.

    Returns:
        Cost of the cheapest motion through every place in the middle, ``(8, CELLS, B)``, and the source of each half's
        steps, change of branch and shift in one number, ``(n - 1, 8 * CELLS, 2 B)``.
    """
    arm, weights, start = batch.arm, batch.weights, batch.start
    shoulder, wrist = spherical_costs(batch, swivels)
    elbow = jnp.moveaxis(batch.motion.elbow, 1, 0)[:, :, None]  # (n, elbow bit, 1, 2 B)
    rate = (1.0 / jnp.abs(jnp.diff(batch.time, axis=0)))[:, None, None]
    elbow_motion = weights[3] * jnp.diff(elbow, axis=0) ** 2 * rate
    elbow_approach = weights[3] * (elbow[0] - start.q[3]) ** 2 * start.rate
    distance = beside_cells(batch.motion).branch(0).keep_out_distance(swivels)  # the same in every branch
    forbidden = jnp.sum(jnp.maximum(-distance, 0.0), axis=0) / arm.length
    if (sides := beside_cells(batch.motion).branch(ELBOWS).free) is not None:
        forbidden = forbidden + sides.missed(swivels)
    other_excess = jnp.maximum(jnp.maximum(arm.lower[3] - elbow, elbow - arm.upper[3]), 0.0) + forbidden
    per_excess = _cost_per_excess(shoulder, elbow_motion, wrist, other_excess)

    def forward(value: Array, layer: tuple[Any, ...]) -> tuple[Array, Array]:
        s, e, w, s_excess, other, w_excess = layer
        best, choice = jnp.full_like(value, jnp.inf), jnp.zeros(value.shape, jnp.int32)
        for change, (of_shoulder, of_wrist) in enumerate(_CHANGES):
            source = jnp.flip(value, [axis for axis, flips in enumerate((of_shoulder, of_wrist)) if flips])
            for i, shift in enumerate(SHIFTS):
                step = _branches([x[i] for x in s[of_shoulder]], e, [x[i] for x in w[of_wrist]])
                reached = jnp.roll(source, -shift, axis=3) + step
                choice = jnp.where(reached < best, change * len(SHIFTS) + i, choice)
                best = jnp.minimum(best, reached)
        return best + per_excess * _branches(s_excess, other, w_excess), choice

    nodes = shoulder.excess, other_excess, wrist.excess
    at_first, later = jax.tree.map(lambda x: x[0], nodes), jax.tree.map(lambda x: x[1:], nodes)
    at_middle = per_excess * _branches(*jax.tree.map(lambda x: x[-1], nodes))
    first = _branches(shoulder.approach, elbow_approach, wrist.approach) + per_excess * _branches(*at_first)
    last, choices = lax.scan(forward, first, (shoulder.motion, elbow_motion, wrist.motion, *later))
    # From (shoulder bit, wrist bit, elbow bit) to branches.
    last, at_middle, choices = (
        jnp.moveaxis(x, -4, -3).reshape(*x.shape[:-5], BRANCHES, CELLS, x.shape[-1]) for x in (last, at_middle, choices)
    )
    before, after = jnp.split(last, 2, axis=-1)
    cost = before + after - jnp.split(at_middle, 2, axis=-1)[0]
    return cost, choices.reshape(len(choices), BRANCHES * CELLS, last.shape[-1])


def _cost_per_excess(
    shoulder: SphericalCosts, elbow_motion: Array, wrist: SphericalCosts, other_excess: Array
) -> Array:
    """Cost of a radian of excess at one waypoint: relative to the best motion whose elbow stays in its cell, (2 B)."""
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
    """Sum over the waypoints, written out: a reduction over the first axis is not vectorized."""
    return sum(x, start=jnp.zeros(x.shape[1:], x.dtype))


def _traced(choices: Array, middle: State) -> State:
    """Branches and cells ``(n, count, 2 B)`` of both halves that lead to states in the middle, ``(count, B)`` each."""

    def backward(state: State, choice: Array) -> tuple[State, State]:
        branch, cell = state
        taken = jnp.take_along_axis(choice, branch * CELLS + cell % CELLS, 0)
        change, shift = taken // len(SHIFTS), taken % len(SHIFTS)
        state = branch ^ jnp.asarray(_FLIPS)[change], cell + shift - _STAY
        return state, state

    last = tuple(jnp.tile(x, (1, 2)) for x in middle)
    _, states = lax.scan(backward, last, choices, reverse=True)  # pyright: ignore
    branch, cell = (jnp.concatenate([x, at[None]]) for x, at in zip(states, last, strict=True))
    return branch, cell
