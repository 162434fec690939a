"""The least weighted motion over all swivels and branches: branch and bound on pieces of the elbow's circle.

1. Each joint's range is cut down to at most one turn about the present angle, so that an angle stands for one posture.
2. Each elbow's circle is cut into pieces with a bound of the motion on each (:mod:`jaxik.redundancy.nearest_pieces`).
3. Every row's piece of the least bound is visited, then all whose bound does not exceed the least motion found by then.
   A piece on which the motion is monotone or convex is settled by one visit with Newton's method, any other is halved.

What is returned is the minimum to rounding, except within pieces narrower than 1e-9 of a turn next to an alignment.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxik.arm import resting_angle
from jaxik.numerics import fused_separately, tolerances
from jaxik.redundancy.alignment import near_alignment, nearest_aligned
from jaxik.redundancy.arcs import Ranges
from jaxik.redundancy.enclosure import alignment
from jaxik.redundancy.nearest_pieces import Pieces, bounded_pieces
from jaxik.redundancy.nearest_visit import Part, Rows, still_open, visited, whole_piece
from jaxik.redundancy.nearness import Nearest, Nearness, from_lower
from jaxik.redundancy.self_motion import SelfMotion

MOST = 20_000  # visits of a lane
SHARE = 32  # one lane for so many rows
LANES = 32  # at least
_WORD = 32


def ranges_of(motion: SelfMotion, lower: Array, upper: Array) -> Ranges:
    """Ranges ``(joint, n)`` of at most a turn, wherever they lie."""
    slack = tolerances(lower.dtype).limit
    elbow = from_lower(motion.elbow, lower[3])
    resting = jnp.ones((), bool)
    if motion.wrist.shape[0] == 3 and motion.arm.n_joints == 7:  # a pointing target leaves joint 7 at rest
        rest = resting_angle(motion.arm)
        resting = (rest >= lower[6]) & (rest <= upper[6])
    inside = (elbow <= upper[3] + slack) & (lower[3] <= upper[3]) & resting
    return Ranges(lower, upper, inside, jnp.ones((), bool))


def nearest_posture(motion: SelfMotion, near: Nearness) -> Nearest:
    """Return the least motion sum(weights * (q - q_now)²) over all postures in the ranges.

    Where a shoulder or wrist can be aligned, its family of postures is examined first.

    Args:
        motion: The self-motion of n targets.
        near: Present posture, weights and ranges.

    Returns:
        Swivel, branch and motion; of all postures where none is within the ranges.
    """
    n, dtype = near.q_now.shape[-1], near.q_now.dtype
    zeros = jnp.zeros_like(near.q_now)
    none = Nearest(zeros[0], jnp.zeros((n,), jnp.int32), jnp.full_like(zeros[0], jnp.inf), zeros)
    aligned = near_alignment(motion)

    def families() -> Nearest:
        found = nearest_aligned(motion, near)
        return jax.tree.map(lambda x, y: jnp.where(aligned, x, y), found, none)

    found = jax.lax.cond(jnp.any(aligned), families, lambda: none)
    pieces, lower = bounded_pieces(motion, near, ranges_of(motion, near.lower, near.upper), jnp.isfinite(found.moved))
    left_out = jnp.where(aligned, 8 * alignment(dtype), 0.0).astype(dtype)
    return _settled(near.weights, Rows(motion, near.q_now, lower, left_out), pieces, found)


class _Lanes(NamedTuple):
    """The search in k lanes, each with one row at a time.

    Attributes:
        row: Row of each lane, ``(k,)``; n in a lane that has none.
        left: Its pieces not yet visited, as bits, ``(words, k)``.
        part: The part under examination.
        best: Least motion of the row so far.
        visits: Visits of the row, ``(k,)``.
    """

    row: Array
    left: Array
    part: Part
    best: Nearest
    visits: Array


def _settled(weights: Array, rows: Rows, pieces: Pieces, found: Nearest) -> Nearest:
    """Visit the piece of the least bound of every row, then those that could still hold a smaller motion."""
    lead = _first_bit(_bits(pieces.bound == jnp.min(pieces.bound, axis=0)))[1]

    def go_through(first: Array, found: Nearest) -> Nearest:
        wanted = _bits(pieces.bound < still_open(found.moved))
        return _visit_all(weights, rows, pieces, wanted & jnp.where(first == 0, lead, ~lead), found)

    return jax.lax.fori_loop(0, 2, go_through, found)


def _visit_all(weights: Array, rows: Rows, pieces: Pieces, wanted: Array, found: Nearest) -> Nearest:
    """Visit the pieces in ``wanted``, bits in words ``(words, n)``; a few lanes take the rows, the longest first."""
    n = rows.q_now.shape[-1]
    k = min(n, max(LANES, -(-n // SHARE)))
    size = jnp.sum(jax.lax.population_count(wanted), axis=0).astype(jnp.int32)
    queue, count = jnp.argsort(-size).astype(jnp.int32), jnp.sum(size > 0, dtype=jnp.int32)

    def step(state: tuple[_Lanes, Array, Nearest]) -> tuple[_Lanes, Array, Nearest]:
        lanes, taken, found = state
        idle = ~lanes.part.live & ~jnp.any(lanes.left != 0, axis=0)
        home = jnp.where(idle, lanes.row, n)
        found = jax.tree.map(lambda x, y: x.at[..., home].set(y, mode="drop"), found, lanes.best)
        turn = taken + jnp.cumsum(idle, dtype=jnp.int32) - 1
        row = jnp.where(idle, jnp.where(turn < count, queue[jnp.minimum(turn, n - 1)], n), lanes.row)
        at, fresh = jnp.minimum(row, n - 1), idle & (row < n)
        left = jnp.where(fresh, wanted[:, at], lanes.left)
        best = jax.tree.map(lambda x, y: jnp.where(fresh, x[..., at], y), found, lanes.best)
        visits = jnp.where(fresh, 0, lanes.visits)
        ready = ~lanes.part.live & jnp.any(left != 0, axis=0)
        piece, bit = _first_bit(left)
        piece = jnp.minimum(piece, len(pieces.bound) - 1)
        whole = whole_piece(pieces, piece, at, ready & (pieces.bound[piece, at] < still_open(best.moved)))
        part = jax.tree.map(lambda x, y: jnp.where(ready, x, y), whole, lanes.part)
        part, best = visited(weights, rows.take(at), part, best)
        part = part.ended(visits >= MOST)
        left = jnp.where(ready, left & ~bit, left)
        taken = jnp.minimum(taken + jnp.sum(idle, dtype=jnp.int32), count)
        return _Lanes(row, left, part, best, visits + 1), taken, found

    def busy(state: tuple[_Lanes, Array, Nearest]) -> Array:
        lanes, taken, _ = state
        return (taken < count) | jnp.any(lanes.row < n)

    zero = jnp.zeros((k,), jnp.int32)
    none = whole_piece(pieces, zero, zero, zero > 0)
    best = jax.tree.map(lambda x: x[..., zero], found)
    lanes = _Lanes(zero + n, jnp.zeros((len(wanted), k), wanted.dtype), none, best, zero)
    return jax.lax.while_loop(busy, step, (lanes, jnp.zeros((), jnp.int32), found))[2]


@fused_separately
def _bits(mask: Array) -> Array:
    """Pack a mask ``(bits, n)`` into words ``(words, n)``."""
    padded = jnp.concatenate([mask, jnp.zeros((-len(mask) % _WORD, *mask.shape[1:]), bool)])
    ones = jnp.left_shift(jnp.uint32(1), jnp.arange(_WORD, dtype=jnp.uint32))[:, None]
    words = jnp.where(padded.reshape(len(padded) // _WORD, _WORD, *mask.shape[1:]), ones, jnp.uint32(0))
    return jnp.sum(words, axis=1, dtype=jnp.uint32)


@fused_separately
def _first_bit(words: Array) -> tuple[Array, Array]:
    """Place of the first bit of words ``(words, k)``, and that bit alone in words."""
    place = jnp.arange(len(words), dtype=jnp.int32)[:, None]
    word = jnp.min(jnp.where(words != 0, place, len(words)), axis=0)
    lowest = jnp.where(place == word, words & (~words + jnp.uint32(1)), jnp.uint32(0))
    bit = jax.lax.population_count(jnp.sum(lowest, axis=0, dtype=jnp.uint32) - jnp.uint32(1))
    return word * _WORD + bit.astype(jnp.int32), lowest
