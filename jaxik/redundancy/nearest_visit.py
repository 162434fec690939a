"""A visit of a part of a piece: bounds of the motion on it, its least by Newton's method, or its halves.

The bounds take three points, the ends and the center, the angles between them, and exact ranges of the rates
(:mod:`jaxik.redundancy.enclosure`).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxik.numerics import fused_separately, principal, sincos_apart
from jaxik.redundancy.enclosure import Enclosure, Interval, alignment, enclose
from jaxik.redundancy.nearest_pieces import Pieces
from jaxik.redundancy.nearness import Nearest, from_lower
from jaxik.redundancy.self_motion import SelfMotion

NEWTON = 3  # steps per visit
DEEPEST = 29  # halvings of a piece
_END = 1 << DEEPEST


class Rows(NamedTuple):
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

    def take(self, rows: Array) -> "Rows":
        """Pick rows."""
        return Rows(self.motion.map_rows(lambda x: x[..., rows]), *(x[..., rows] for x in self[1:]))


class Part(NamedTuple):
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

    def ended(self, where: Array) -> "Part":
        """Leave pieces as they are, done."""
        return self._replace(place=jnp.where(where, _END, self.place))


def whole_piece(pieces: Pieces, piece: Array, row: Array, live: Array) -> Part:
    """Return whole pieces ``(k,)`` of rows ``(k,)``, done with where not live."""
    zero = jnp.zeros(piece.shape, jnp.int32)
    return Part(*pieces.pick(piece, row), jnp.where(live, zero, _END), zero)


def still_open(moved: Array) -> Array:
    """Bounds below this may hide a smaller motion than the one found."""
    eps = float(jnp.finfo(moved.dtype).eps)
    return moved * (1.0 - max(1e-10, 64 * eps)) - eps


def visited(weights: Array, rows: Rows, part: Part, found: Nearest) -> tuple[Part, Nearest]:
    """Examine the present part of a piece of each row: find its least motion, drop it, or halve it."""
    branch = rows.motion.branch(part.branch)
    unit = part.length / _END
    half = 0.5 * part.length * 2.0 ** -part.level.astype(unit.dtype)
    center = part.start + part.place.astype(unit.dtype) * unit + half
    points = jnp.stack([center - half, center, center + half])
    q, rate = branch.slopes(points)
    bounds = enclose(branch, *sincos_apart(center), *sincos_apart(half))
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
    finished = settled | ~(test.bound < still_open(found.moved)) | left_out | (part.level >= DEEPEST)
    found = jax.tree.map(lambda a, b: jnp.where(here.moved < found.moved, a, b), here, found)
    return _advanced(part, finished), found


def _advanced(part: Part, finished: Array) -> Part:
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
