"""The least weighted motion over all swivels and branches: branch and bound on pieces of the elbow's circle.

1. Each joint's range is cut down to at most one turn about the present angle, so that an angle stands for one posture.
2. Each elbow's circle is cut where a joint meets the end of its range, and at a coarse grid. One enclosure per piece
   bounds how far every joint can be from the present angle anywhere on the piece: its weighted squares are a bound on
   the motion, for all branches at once.
3. The pieces with the least bounds are examined: a piece on which the motion is monotone or convex has its least found
   by Newton's method; any other is halved. A piece whose bound exceeds the least motion found so far is dropped.
4. Rows that a first examination does not settle, a small part, are examined further until no piece is left.

What is returned is the minimum to rounding, except within pieces narrower than 1e-9 of a turn next to an alignment.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxik.arm import resting_angle
from jaxik.ik import branch_number
from jaxik.numerics import fused_separately, merge_leading, principal, sincos, sort_columns, tolerances
from jaxik.redundancy.alignment import near_alignment, nearest_aligned
from jaxik.redundancy.arc_intervals import following
from jaxik.redundancy.arcs import Ranges, borders_of_limits, feasible_between
from jaxik.redundancy.branch_motion import BranchMotion
from jaxik.redundancy.enclosure import Enclosure, alignment, enclose, largest_rates
from jaxik.redundancy.nearness import Nearest, Nearness, from_lower
from jaxik.redundancy.self_motion import SelfMotion

GRID = 16  # cuts of the circle besides those at the limits
EXAMINED = 4  # pieces of a row examined at a time
NEWTON = 3  # steps per examination
DEEPEST = 29  # halvings of a piece
MOST = 20_000  # visits of a piece
VISITS = 5  # visits of a piece in the first examination
FURTHER = 8  # one of so many rows is expected to need further examination


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
    """Input of the examination of n rows.

    Attributes:
        motion: Their self-motion.
        q_now: Present angles, ``(joint, n)`` [rad].
        lower: Lower ends of the ranges, ``(joint, n)`` [rad].
        pieces: Begin and length of the pieces of each elbow's circle, ``(2, cuts, elbow bit, n)`` [rad].
        left_out: Sine of a middle angle below which parts are left to the families of alignments, ``(n,)``.
        bound: Bound of each piece not yet examined, ``(shoulder bit * wrist bit * cuts * elbow bit, n)`` [rad²].
    """

    motion: SelfMotion
    q_now: Array
    lower: Array
    pieces: Array
    left_out: Array
    bound: Array

    def take(self, rows: Array) -> "_Rows":
        """Pick rows."""
        motion = self.motion.map_rows(lambda x: x[..., rows])
        return _Rows(motion, *(x[..., rows] for x in self[1:]))


def nearest_posture(motion: SelfMotion, near: Nearness) -> Nearest:
    """Return the least motion sum(weights * (q - q_now)²) over all postures in the ranges.

    Where a shoulder or wrist can be aligned, its family of postures is examined first.

    Args:
        motion: The self-motion of n targets.
        near: Present posture, weights and ranges.

    Returns:
        Swivel, branch and motion; of all postures where none is within the ranges.
    """
    n, weights = near.q_now.shape[-1], near.weights
    zeros = jnp.zeros_like(near.q_now)
    none = Nearest(zeros[0], jnp.zeros((n,), jnp.int32), jnp.full_like(zeros[0], jnp.inf), zeros)
    aligned = near_alignment(motion)

    def families() -> Nearest:
        found = nearest_aligned(motion, near)
        return jax.tree.map(lambda x, y: jnp.where(aligned, x, y), found, none)

    found = jax.lax.cond(jnp.any(aligned), families, lambda: none)
    rows = _pieces(motion, near, jnp.isfinite(found.moved))
    rows = rows._replace(left_out=jnp.where(aligned, 8 * alignment(zeros.dtype), 0.0).astype(zeros.dtype))
    return _settled(weights, rows, found)


class _State(NamedTuple):
    """Least motions so far, bounds of the pieces left, which rows are done, and the rounds gone by."""

    found: Nearest
    bound: Array
    done: Array
    round: Array


def _settled(weights: Array, rows: _Rows, found: Nearest) -> Nearest:
    """Examine part after part of the rows with a few visits each, then those left over together, to their end.

    One program of a part's size does both.
    """
    n = rows.q_now.shape[-1]
    parts = FURTHER if n > FURTHER else 0
    size = -(-n // max(parts, 1))

    def settle(state: _State) -> _State:
        first = state.round < parts
        part = jnp.minimum(state.round * size + jnp.arange(size, dtype=jnp.int32), n - 1)
        pick = jnp.where(first, part, jnp.argsort(state.done, stable=True)[:size].astype(jnp.int32))

        def again(s: tuple[Nearest, _Rows, Array, Array]) -> tuple[Nearest, _Rows, Array, Array]:
            return *_examined(weights, s[1], s[0], jnp.where(first, VISITS, MOST)), s[3] + 1

        def unsettled(s: tuple[Nearest, _Rows, Array, Array]) -> Array:
            return ~jnp.all(s[2]) & ~(first & (s[3] > 0))

        some = jax.tree.map(lambda x: x[..., pick], state.found)
        start = some, rows._replace(bound=state.bound).take(pick), jnp.zeros(size, bool), jnp.zeros((), jnp.int32)
        some, taken, done, _ = jax.lax.while_loop(unsettled, again, start)
        found = jax.tree.map(lambda x, y: x.at[..., pick].set(y), state.found, some)
        return _State(found, state.bound.at[:, pick].set(taken.bound), state.done.at[pick].set(done), state.round + 1)

    start = _State(found, rows.bound, jnp.zeros(n, bool), jnp.zeros((), jnp.int32))
    return jax.lax.while_loop(lambda s: (s.round < parts) | ~jnp.all(s.done), settle, start).found


def _pieces(motion: SelfMotion, near: Nearness, known: Array) -> _Rows:
    """Pieces of the circles and the bounds of the motion on them, given the rows with a posture known already."""
    q_now, weights, lower, upper = near
    n = q_now.shape[-1]
    ranges = ranges_of(motion, lower, upper)
    grid = jnp.linspace(-jnp.pi, jnp.pi, GRID, endpoint=False, dtype=q_now.dtype)
    grid = jnp.broadcast_to(grid[:, None, None], (GRID, 2, n))
    cuts = sort_columns(jnp.concatenate([borders_of_limits(motion, ranges), grid]))
    feasible = feasible_between(motion, cuts, ranges)
    # Without any feasible piece the ranges are left aside: the caller sees that the posture is outside.
    none = ~(jnp.any(feasible, axis=(0, 1, 2, 3)) | known)
    feasible, lower = feasible | none, jnp.where(none, q_now - jnp.pi, lower)
    length = following(cuts) - cuts
    center = cuts + 0.5 * length
    both = motion.branch(np.array([[0], [2]]))
    q = both.angles(center)
    far = largest_rates(both, *_sincos(center), 0.5 * length) * (0.5 * length)
    bound = _bounds(weights, q_now, lower, q, far, motion.other_offsets())
    bound = merge_leading(jnp.where(feasible & (bound < jnp.inf), bound, jnp.inf), 1)
    return _Rows(motion, q_now, lower, jnp.stack([cuts, length]), jnp.zeros_like(q_now[0]), bound)


@fused_separately
def _sincos(swivel: Array) -> tuple[Array, Array]:
    return sincos(swivel)


@fused_separately
def _bounds(weights: Array, q_now: Array, lower: Array, q: Array, far: Array, other: Array) -> Array:
    """Bounds from angles at the centers of pieces and how far they turn, ``(2, 2, cuts, elbow bit, n)``.

    ``other`` is what the other solution of a spherical joint adds to outer angles, and to the negative of middle ones.
    """

    def least(joint: int, angle: Array) -> Array:
        off = jnp.abs(from_lower(angle, lower[joint]) - q_now[joint])
        return weights[joint] * jnp.maximum(off - far[joint], 0.0) ** 2

    def both(first: int) -> list[Array]:
        joints = range(first, min(first + 3, len(q)))
        solutions = [[q[j] for j in joints], [other[j] + (-q[j] if j == first + 1 else q[j]) for j in joints]]
        zero = jnp.zeros((), far.dtype)
        return [sum((least(j, x) for j, x in zip(joints, angles, strict=True)), zero) for angles in solutions]

    shoulder, wrist = both(0), both(4)
    elbow = least(3, q[3])
    return jnp.stack([jnp.stack([s + w + elbow for w in wrist]) for s in shoulder])


class _Nodes(NamedTuple):
    """Pieces under examination, ``(EXAMINED, n)`` each, halved depth first.

    Attributes:
        start: Begin of the piece [rad].
        length: Its length [rad].
        branch: Its branch.
        place: Begin of the present part, in units of 2^-DEEPEST of the piece; that of the end where there is none left.
        level: Halvings of the present part.
    """

    start: Array
    length: Array
    branch: Array
    place: Array
    level: Array


_END = 1 << DEEPEST


def _examined(weights: Array, rows: _Rows, found: Nearest, visits: ArrayLike) -> tuple[Nearest, _Rows, Array]:
    """Examine the pieces with the least bounds: the least motion so far, the rows without them, and which are done."""
    nodes, bound, taken = _least_pieces(rows)
    nodes = nodes._replace(place=jnp.where(bound < _open(found.moved), 0, _END))
    branch = rows.motion.branch(nodes.branch)

    def visit(state: tuple[_Nodes, Nearest, Array]) -> tuple[_Nodes, Nearest, Array]:
        nodes, found, count = state
        return *_visited(weights, rows, branch, nodes, found), count + 1

    def unfinished(state: tuple[_Nodes, Nearest, Array]) -> Array:
        return jnp.any(state[0].place < _END) & (state[2] < visits)

    start = nodes, found, jnp.zeros((), jnp.int32)
    nodes, found, count = jax.lax.while_loop(unfinished, visit, start)
    through = jnp.all(nodes.place == _END, axis=0) | (count >= MOST)
    left = rows.bound.at[taken, jnp.arange(taken.shape[-1])].set(jnp.inf)
    left = jnp.where(through, left, rows.bound)
    done = through & (jnp.min(left, axis=0) >= _open(found.moved))
    return found, rows._replace(bound=left), done


def _open(moved: Array) -> Array:
    """Bounds below this may hide a smaller motion than the one found."""
    eps = float(jnp.finfo(moved.dtype).eps)
    return moved * (1.0 - max(1e-10, 64 * eps)) - eps


def _least_pieces(rows: _Rows) -> tuple[_Nodes, Array, Array]:
    """The pieces with the least bounds, the bounds, and their places, ``(EXAMINED, n)``."""
    count = rows.pieces.shape[1]
    bound, index = _smallest(rows.bound)
    elbow, cut, solution = index % 2, index // 2 % count, index // (2 * count)
    branch = branch_number(solution // 2, elbow, solution % 2).astype(jnp.int32)
    start, length = jnp.take_along_axis(rows.pieces.reshape(2, 2 * count, -1), (cut * 2 + elbow)[None], 1)
    zero = jnp.zeros(index.shape, jnp.int32)
    return _Nodes(start, length, branch, zero, zero), bound, index


def _smallest(bound: Array) -> tuple[Array, Array]:
    """The ``EXAMINED`` smallest of each column and their places: a few passes cost less than a sort."""

    def next_smallest(left: Array, _: None) -> tuple[Array, tuple[Array, Array]]:
        place = jnp.argmin(left, axis=0)
        value = jnp.min(left, axis=0)
        return jnp.where(jnp.arange(len(left))[:, None] == place, jnp.inf, left), (value, place)

    return jax.lax.scan(next_smallest, bound, length=EXAMINED)[1]


def _visited(
    weights: Array, rows: _Rows, branch: BranchMotion, nodes: _Nodes, found: Nearest
) -> tuple[_Nodes, Nearest]:
    """Examine the present part of every piece: find its least motion, drop it, or halve it."""
    unit = nodes.length / _END
    half = 0.5 * nodes.length * 2.0 ** -nodes.level.astype(unit.dtype)
    center = nodes.start + nodes.place.astype(unit.dtype) * unit + half
    sin, cos = _sincos(center)
    q = branch.angles(center)
    bounds = enclose(branch, sin, cos, half)
    off, slope, least_curvature, most_curvature, bound = _values(weights, rows.q_now, rows.lower, q, bounds, half)
    monotone, convex = jnp.abs(slope) > half * most_curvature, least_curvature > 0.0

    def moved_at(x: Array) -> Array:
        """Joint motion, continuous from the center."""
        return off + principal(branch.angles(x) - q)

    def newton(_: Array, x: Array) -> Array:
        rates = branch.rates(x)
        d = off + principal(rates.q - q)
        slope = jnp.tensordot(weights, d * rates.first, axes=1)
        curvature = jnp.tensordot(weights, rates.first**2 + d * rates.second, axes=1)
        step = slope / jnp.where(curvature > 0.0, curvature, 1.0)
        step = jnp.where(convex & ~monotone & (curvature > 0.0), step, 0.0)
        return jnp.clip(x - step, center - half, center + half)

    first = jnp.where(monotone, center - jnp.sign(slope) * half, center)
    x = jax.lax.fori_loop(0, NEWTON, newton, first)
    off_x = moved_at(x)
    at_x, at_center = (jnp.tensordot(weights, d * d, axes=1) for d in (off_x, off))
    settled = monotone | (convex & _converged(weights, branch, off, q, x, center, half, least_curvature, at_x))
    # The least of this visit.
    better = at_x < at_center
    value, at, off = jnp.where(better, at_x, at_center), jnp.where(better, x, center), jnp.where(better, off_x, off)
    live = nodes.place < _END
    value = jnp.where(live, value, jnp.inf)
    best = jnp.argmin(value, axis=0)[None]
    swivel, branch_here, moved = (jnp.take_along_axis(v, best, 0)[0] for v in (at, nodes.branch, value))
    here = Nearest(swivel, branch_here, moved, jnp.take_along_axis(off, best[None], 1)[:, 0])
    found = jax.tree.map(lambda a, b: jnp.where(here.moved < found.moved, a, b), here, found)
    finished = settled | ~(bound < _open(found.moved)) | (bounds.sine <= rows.left_out) | (nodes.level >= DEEPEST)
    return _advanced(nodes, live, finished), found


def _advanced(nodes: _Nodes, live: Array, finished: Array) -> _Nodes:
    """Go on to the next part of each piece, or into the first half of the present one."""
    size = jnp.left_shift(1, DEEPEST - nodes.level)
    place = nodes.place + size
    ends_parent = (place & (2 * size - 1)) == 0
    level = jnp.where(finished, nodes.level - jnp.where(ends_parent & (nodes.level > 0), 1, 0), nodes.level + 1)
    return nodes._replace(
        place=jnp.where(live & finished, place, nodes.place), level=jnp.where(live, level, nodes.level)
    )


def _converged(
    weights: Array,
    branch: BranchMotion,
    off: Array,
    q: Array,
    x: Array,
    center: Array,
    half: Array,
    least_curvature: Array,
    at_x: Array,
) -> Array:
    """Test whether Newton's method ended at the least of a convex piece."""
    q_x, first = branch.slopes(x)
    slope = jnp.tensordot(weights, (off + principal(q_x - q)) * first, axes=1)
    outward = ((x <= center - half) & (slope >= 0.0)) | ((x >= center + half) & (slope <= 0.0))
    hidden = slope * slope / jnp.where(least_curvature > 0.0, least_curvature, 1.0)
    eps = float(jnp.finfo(x.dtype).eps)
    return outward | (hidden <= max(1e-11, 16 * eps) * at_x + eps)


def _values(weights: Array, q_now: Array, lower: Array, q: Array, bounds: Enclosure, half: Array) -> tuple[Array, ...]:
    """Joint motion at the centers, half its slope there, bounds of half its curvature and of itself."""
    off = from_lower(q, lower[:, None]) - q_now[:, None]

    def total(x: Array) -> Array:
        return jnp.tensordot(weights, x, axes=1)

    far = bounds.most * half
    slope = total(off * bounds.first)
    swing = jnp.abs(off) * bounds.spread + jnp.abs(bounds.second) * far + far * bounds.spread
    least = total(bounds.least**2 + off * bounds.second - swing)
    most = total(bounds.most**2 + jnp.abs(off * bounds.second) + swing)
    apart = total(jnp.maximum(jnp.abs(off) - far, 0.0) ** 2)
    moved = total(off * off)
    # For |t| <= half the motion is at least moved + 2 slope t + least t².
    by_slope = moved - 2.0 * jnp.abs(slope) * half + jnp.minimum(least, 0.0) * half * half
    by_curve = moved - slope * slope / jnp.where(least > 0.0, least, 1.0)
    by_slope = jnp.maximum(by_slope, jnp.where(least > 0.0, by_curve, -jnp.inf))
    return off, slope, least, most, jnp.maximum(apart, by_slope)
