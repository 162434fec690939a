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
from jaxik.numerics import fused_separately, principal, sincos, tolerances
from jaxik.redundancy.alignment import near_alignment, nearest_aligned
from jaxik.redundancy.arcs import Ranges
from jaxik.redundancy.enclosure import Enclosure, Interval, alignment, enclose
from jaxik.redundancy.nearest_pieces import Pieces, bounded_pieces
from jaxik.redundancy.nearness import Nearest, Nearness, from_lower
from jaxik.redundancy.self_motion import SelfMotion

NEWTON = 3  # steps per visit
DEEPEST = 29  # halvings of a piece
MOST = 20_000  # visits of a lane
SHARE = 32  # one lane for so many rows
LANES = 16  # at least
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


class _Rows(NamedTuple):
    """Input of the visits of n rows.

    Attributes:
        motion: Their self-motion.
        q_now: Present angles, ``(joint, n)`` [rad].
        lower: Lower ends of the ranges, ``(joint, n)`` [rad].
        left_out: Sine of a middle angle below which parts are left to the families of alignments, ``(n,)``.
    """

    motion: SelfMotion
    q_now: Array
    lower: Array
    left_out: Array

    def take(self, rows: Array) -> "_Rows":
        """Pick rows."""
        return _Rows(self.motion.map_rows(lambda x: x[..., rows]), *(x[..., rows] for x in self[1:]))


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
    return _settled(near.weights, _Rows(motion, near.q_now, lower, left_out), pieces, found)


class _Part(NamedTuple):
    """Part of a piece under examination in each of k lanes; pieces are halved depth first.

    Attributes:
        start: Begin of the piece, ``(k,)`` [rad].
        length: Its length [rad].
        branch: Its branch.
        place: Begin of the present part, in units of 2^-DEEPEST of the piece; that of the end where none is left.
        level: Halvings of the present part.
    """

    start: Array
    length: Array
    branch: Array
    place: Array
    level: Array

    @property
    def live(self) -> Array:
        """True where a part is left to examine."""
        return self.place < _END


_END = 1 << DEEPEST


def _part(pieces: Pieces, piece: Array, row: Array, live: Array) -> _Part:
    """Whole pieces ``(k,)`` of rows ``(k,)``."""
    zero = jnp.zeros(piece.shape, jnp.int32)
    return _Part(*pieces.pick(piece, row), jnp.where(live, zero, _END), zero)


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
    part: _Part
    best: Nearest
    visits: Array


def _settled(weights: Array, rows: _Rows, pieces: Pieces, found: Nearest) -> Nearest:
    """Visit the piece of the least bound of every row, then those that could still hold a smaller motion."""
    lead = _first_bit(_bits(pieces.bound == jnp.min(pieces.bound, axis=0)))[1]

    def go_through(first: Array, found: Nearest) -> Nearest:
        wanted = _bits(pieces.bound < _open(found.moved))
        return _visit_all(weights, rows, pieces, wanted & jnp.where(first == 0, lead, ~lead), found)

    return jax.lax.fori_loop(0, 2, go_through, found)


def _visit_all(weights: Array, rows: _Rows, pieces: Pieces, wanted: Array, found: Nearest) -> Nearest:
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
        whole = _part(pieces, piece, at, ready & (pieces.bound[piece, at] < _open(best.moved)))
        part = jax.tree.map(lambda x, y: jnp.where(ready, x, y), whole, lanes.part)
        part, best = _visited(weights, rows.take(at), part, best)
        part = part._replace(place=jnp.where(visits >= MOST, _END, part.place))
        left = jnp.where(ready, left & ~bit, left)
        taken = jnp.minimum(taken + jnp.sum(idle, dtype=jnp.int32), count)
        return _Lanes(row, left, part, best, visits + 1), taken, found

    def busy(state: tuple[_Lanes, Array, Nearest]) -> Array:
        lanes, taken, _ = state
        return (taken < count) | jnp.any(lanes.row < n)

    zero = jnp.zeros((k,), jnp.int32)
    angle = jnp.zeros((k,), rows.q_now.dtype)
    none = _Part(angle, angle, zero, zero + _END, zero)
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


def _open(moved: Array) -> Array:
    """Bounds below this may hide a smaller motion than the one found."""
    eps = float(jnp.finfo(moved.dtype).eps)
    return moved * (1.0 - max(1e-10, 64 * eps)) - eps


def _visited(weights: Array, rows: _Rows, part: _Part, found: Nearest) -> tuple[_Part, Nearest]:
    """Examine the present part of a piece of each row: find its least motion, drop it, or halve it."""
    branch = rows.motion.branch(part.branch)
    unit = part.length / _END
    half = 0.5 * part.length * 2.0 ** -part.level.astype(unit.dtype)
    center = part.start + part.place.astype(unit.dtype) * unit + half
    points = jnp.stack([center - half, center, center + half])
    q, rate = branch.slopes(points)
    bounds = enclose(branch, *_sincos(center), *_sincos(half))
    off = from_lower(q[:, 1], rows.lower) - rows.q_now
    offs = off[:, None] + principal(q - q[:, 1:2])
    at = _at_points(weights, offs, rate)
    test = _tested(weights, offs, at, bounds, half)

    def on_way(x: Array, turned: Array) -> Array:
        """Joint motion at a swivel, continuous from the center."""
        return off + principal(turned - q[:, 1])

    def newton(_: Array, x: Array) -> Array:
        rates = branch.rates(x)
        d = on_way(x, rates.q)
        slope = jnp.tensordot(weights, d * rates.first, axes=1)
        curvature = jnp.tensordot(weights, rates.first**2 + d * rates.second, axes=1)
        step = slope / jnp.where(curvature > 0.0, curvature, 1.0)
        step = jnp.where(test.interior & (curvature > 0.0), step, 0.0)
        return jnp.clip(x - step, points[0], points[2])

    x = jax.lax.fori_loop(0, NEWTON, newton, center + test.guess * half)
    turned, rate = branch.slopes(x)
    off_x = on_way(x, turned)
    moved, slope = jnp.tensordot(weights, off_x * off_x, axes=1), jnp.tensordot(weights, off_x * rate, axes=1)
    eps = float(jnp.finfo(x.dtype).eps)
    hidden = slope * slope / jnp.where(test.curvature > 0.0, test.curvature, 1.0)
    settled = test.at_end | (test.interior & (hidden <= max(1e-11, 16 * eps) * moved + eps))
    # At an alignment the angles are rounding: its own families hold what is nearest there.
    left_out = bounds.sine.high <= rows.left_out
    here = Nearest(x, part.branch, jnp.where(part.live & ~left_out, moved, jnp.inf), off_x)
    finished = settled | ~(test.bound < _open(found.moved)) | left_out | (part.level >= DEEPEST)
    found = jax.tree.map(lambda a, b: jnp.where(here.moved < found.moved, a, b), here, found)
    return _advanced(part, finished), found


_sincos = fused_separately(sincos)


def _advanced(part: _Part, finished: Array) -> _Part:
    """Go on to the next part of each piece, or into the first half of the present one."""
    size = jnp.left_shift(1, DEEPEST - part.level)
    place = part.place + size
    ends_parent = (place & (2 * size - 1)) == 0
    level = jnp.where(finished, part.level - jnp.where(ends_parent & (part.level > 0), 1, 0), part.level + 1)
    live = part.live
    return part._replace(place=jnp.where(live & finished, place, part.place), level=jnp.where(live, level, part.level))


class _Points(NamedTuple):
    """Motion at both ends and the center of a part, and half its slope there, ``(3, k)`` each."""

    moved: Array
    slope: Array


@fused_separately
def _at_points(weights: Array, offs: Array, rate: Array) -> _Points:
    return _Points(jnp.tensordot(weights, offs * offs, axes=1), jnp.tensordot(weights, offs * rate, axes=1))


class _Test(NamedTuple):
    """Conclusions from the bounds of the motion on a part, ``(k,)`` each.

    Attributes:
        bound: Bound of the motion [rad²].
        at_end: True where it is least at an end.
        interior: True where it is convex and least between the ends.
        guess: Place where it may be least, from -1 at the begin to 1 at the end.
        curvature: Bound of half the curvature.
    """

    bound: Array
    at_end: Array
    interior: Array
    guess: Array
    curvature: Array


@fused_separately
def _tested(weights: Array, offs: Array, at: _Points, bounds: Enclosure, half: Array) -> _Test:
    ends = Interval(
        jnp.minimum(offs[:, 0], offs[:, 2]) - bounds.beyond, jnp.maximum(offs[:, 0], offs[:, 2]) + bounds.beyond
    )

    def total(x: Interval) -> Interval:
        return Interval(*(jnp.tensordot(weights, side, axes=1) for side in x))

    slope = total(ends * bounds.first)
    curvature = total(bounds.first.squared + ends * bounds.second)
    steepest = half * jnp.maximum(curvature.high, -curvature.low)
    rising = (slope.low > 0.0) | (at.slope[1] > steepest)
    falling = (slope.high < 0.0) | (at.slope[1] < -steepest)
    convex = curvature.low > 0.0
    # At an alignment, which may be an end, the angles are rounding.
    resolved = bounds.sine.low > alignment(half.dtype)
    to_start, to_end = rising | (convex & (at.slope[0] >= 0.0)), falling | (convex & (at.slope[2] <= 0.0))
    to_start, to_end = to_start & resolved, to_end & resolved
    # Zero of the slope between two of the points, by its chord.
    left = at.slope[1] > 0.0
    near, far = jnp.where(left, at.slope[0], at.slope[1]), jnp.where(left, at.slope[1], at.slope[2])
    chord = -near / jnp.where(far > near, far - near, 1.0)
    lower = jnp.where(resolved, jnp.argmin(at.moved, axis=0) - 1, 0)
    guess = jnp.where(
        convex & resolved, jnp.clip(chord, 0.0, 1.0) - jnp.where(left, 1.0, 0.0), lower.astype(half.dtype)
    )
    guess = jnp.where(to_start, -1.0, jnp.where(to_end, 1.0, guess))
    at_end = to_start | to_end
    bound = jnp.maximum(total(ends.squared).low, _by_slopes(at, jnp.minimum(curvature.low, 0.0), half))
    bound = jnp.where(at_end, jnp.minimum(at.moved[0], at.moved[2]), bound)
    return _Test(bound, at_end, convex & resolved & ~at_end, guess, curvature.low)


def _by_slopes(at: _Points, curvature: Array, half: Array) -> Array:
    """Bound from values and slopes at the points and the least curvature, no more than 0, between them.

    Over each half the motion is above the parabolas from both of its ends; they meet once.
    """

    def over(a: int, b: int) -> Array:
        rise = 2.0 * (at.slope[a] - at.slope[b] + curvature * half)
        gap = at.moved[b] - at.moved[a] - 2.0 * at.slope[b] * half + curvature * half * half
        meet = jnp.clip(gap / jnp.where(rise == 0.0, 1.0, rise), 0.0, half)
        back = half - meet
        first = at.moved[a] + 2.0 * at.slope[a] * meet + curvature * meet * meet
        second = at.moved[b] - 2.0 * at.slope[b] * back + curvature * back * back
        return jnp.minimum(jnp.maximum(first, second), jnp.minimum(at.moved[a], at.moved[b]))

    return jnp.minimum(over(0, 1), over(1, 2))
