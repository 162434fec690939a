"""Arcs of the circle from feasible intervals: runs of neighbors merged, in fixed shapes.

Two neighboring intervals cannot both start an arc, nor both end one. So a pair of intervals is a place with room for
one start and one end, and an arc ends at the first end from its own pair on, round the circle.
"""

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxik.numerics import fused_separately, merge_leading

_NONE = 100.0  # stands for no end: beyond every angle of two turns


def runs(borders: Array, feasible: Array) -> tuple[Array, Array, Array]:
    """Merge neighboring feasible intervals into arcs, in ascending order of their starts, unused places at the end.

    Args:
        borders: Begins of the intervals, ascending, an even number of them, ``(borders, elbow bit, n)`` [rad].
        feasible: ``(shoulder bit, wrist bit, borders, elbow bit, n)``.

    Returns:
        Starts, ends and which places hold an arc, ``(8, borders / 2, n)``.
    """
    feasible, whole = _by_branch(feasible)
    start, valid = _starts(borders, feasible)
    start, end, valid = _joined(start, valid, _next_end(_ends(borders, feasible)), whole)
    start, end, valid = _compressed(start, end, valid)
    return merge_leading(start, 2), merge_leading(end, 2), merge_leading(valid, 2)


def following(borders: Array) -> Array:
    """Return the end of each interval: the next border."""
    return jnp.concatenate([borders[1:], borders[:1] + 2 * jnp.pi])


@fused_separately
def _by_branch(feasible: Array) -> tuple[Array, Array]:
    """Feasible intervals ``(2, 2, 2, borders, n)`` with bits in the order of branches, and which circles are whole."""
    feasible = jnp.transpose(feasible, (0, 3, 1, 2, 4))
    return feasible, jnp.all(feasible, axis=3, keepdims=True)


@fused_separately
def _starts(borders: Array, feasible: Array) -> tuple[Array, Array]:
    """Starts of arcs in pairs of intervals, else 0, and the pairs that have one, ``(2, 2, 2, pairs, n)``."""
    first, second = _in_pairs(feasible & ~jnp.roll(feasible, 1, axis=3))
    at_first, at_second = _in_pairs(_of_elbow(borders))
    return jnp.where(first, at_first, jnp.where(second, at_second, 0.0)), first | second


@fused_separately
def _ends(borders: Array, feasible: Array) -> Array:
    """Ends of arcs in pairs of intervals, else an angle beyond all."""
    first, second = _in_pairs(feasible & ~jnp.roll(feasible, -1, axis=3))
    at_first, at_second = _in_pairs(_of_elbow(following(borders)))
    return jnp.where(first, at_first, jnp.where(second, at_second, _NONE))


def _of_elbow(borders: Array) -> Array:
    """Borders beside the branches, ``(2, 1, borders, n)``: those of an elbow serve all its branches."""
    return jnp.swapaxes(borders, 0, 1)[:, None]


def _in_pairs(x: Array) -> tuple[Array, Array]:
    """Entries at even and at odd places of the last axis but one."""
    pairs = x.reshape(*x.shape[:-2], x.shape[-2] // 2, 2, x.shape[-1])
    return pairs[..., 0, :], pairs[..., 1, :]


def _next_end(end: Array) -> Array:
    """The first end in a pair or behind it; ends ascend, so it is the least."""
    distance = 1
    while distance < end.shape[3]:
        end = _least_of_four(end, distance)
        distance *= 4
    return end


def _least_of_four(x: Array, distance: int) -> Array:
    @fused_separately
    def least(x: Array) -> Array:
        one, two, three = (_ahead(x, k * distance, _NONE) for k in (1, 2, 3))
        return _smaller(_smaller(x, one), _smaller(two, three))

    return least(x)


def _smaller(a: Array, b: Array) -> Array:
    return jnp.where(a <= b, a, b)


def _ahead(x: Array, distance: int, beyond: float | int) -> Array:
    """Entries a number of pairs ahead."""
    distance = min(distance, x.shape[3])
    return jnp.concatenate([x[..., distance:, :], jnp.full_like(x[..., :distance, :], beyond)], axis=3)


@fused_separately
def _joined(start: Array, valid: Array, end: Array, whole: Array) -> tuple[Array, Array, Array]:
    """Insert whole circles, and the ends of arcs that cross the seam: a turn on from the first end of all."""
    whole = whole & (jnp.arange(start.shape[3]) == 0)[:, None]
    end = jnp.where(end < _NONE, end, end[..., :1, :] + 2 * jnp.pi)
    end = jnp.where(valid, end, jnp.where(whole, jnp.pi, 0.0))
    return jnp.where(whole, -jnp.pi, start), end, valid | whole


def _compressed(start: Array, end: Array, valid: Array) -> tuple[Array, Array, Array]:
    """Move the arcs to the first places: each by one, two, four, ... as the binary digits of its distance say.

    From the smallest digit on no two arcs meet: H. S. Warren, "Hacker's Delight", 2nd ed., 2012, section 7-4.
    """
    pairs = valid.shape[3]
    distance, count = _unused_before(valid)
    for digit in range((pairs - 1).bit_length()):
        start, end, distance = _moved(start, end, distance, 1 << digit)
    return start, end, jnp.arange(pairs, dtype=count.dtype)[:, None] < count[..., None, :]


@fused_separately
def _unused_before(valid: Array) -> tuple[Array, Array]:
    """Number of unused places before each arc (0 at unused ones), and number of arcs."""
    small = np.min_scalar_type(valid.shape[3])  # bytes are faster than words
    zero, one = jnp.zeros((), small), jnp.ones((), small)
    unused = jnp.zeros(valid[..., 0, :].shape, small)
    before = []
    for pair in range(valid.shape[3]):
        before.append(jnp.where(valid[..., pair, :], unused, zero))
        unused = unused + jnp.where(valid[..., pair, :], zero, one)
    return jnp.stack(before, axis=3), valid.shape[3] - unused


def _moved(start: Array, end: Array, distance: Array, step: int) -> tuple[Array, Array, Array]:
    @fused_separately
    def moved(*arrays: Array) -> tuple[Array, ...]:
        leaves = (arrays[-1] & step) != 0
        arrives = _ahead(leaves, step, 0)
        kept = (jnp.where(leaves, jnp.zeros((), x.dtype), x) for x in arrays)
        return tuple(jnp.where(arrives, _ahead(x, step, 0), k) for x, k in zip(arrays, kept, strict=True))

    start, end, distance = moved(start, end, distance)
    return start, end, distance
