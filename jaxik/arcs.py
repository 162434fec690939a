"""The exact set of swivels at which a target is feasible: arcs of the elbow's circle, in closed form.

1. Where a joint meets a limit, or the elbow the border of its keep-out, is the root of a + b cos + c sin: at most two.
2. Between neighboring roots nothing changes, so one test at the middle decides an interval.
3. A limit test needs no angle: the plane vector of the angle lies in the sector between its limits, two signs.
4. Runs of feasible intervals are the arcs.

No sampling, fixed shapes: a pose with any feasible swivel always shows it, however narrow the arc.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from jaxik import columns as col
from jaxik.arm import Arm
from jaxik.ik import target_columns
from jaxik.numerics import sincos, tolerances
from jaxik.shapes import batch_shape, check_target
from jaxik.staging import stage
from jaxik.swivel_functions import SwivelFunctions, angle_equations, roots, swivel_functions
from jaxik.targets import Target


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class SwivelArcs:
    """Feasible swivels of every branch: arcs in ascending order of their starts, unused places at the end.

    Attributes:
        start: ``(*batch, 8, arcs)`` [rad] in [-pi, pi].
        end: ``(*batch, 8, arcs)`` [rad], ``start <= end <= start + 2 pi``; an arc across the seam ends beyond pi.
        valid: Whether the place holds an arc; the others are zero.
    """

    start: Float[Array, "*batch branch arc"]
    end: Float[Array, "*batch branch arc"]
    valid: Bool[Array, "*batch branch arc"]

    @property
    def width(self) -> Float[Array, "*batch branch"]:
        """Total feasible swivel of each branch [rad]."""
        return jnp.sum(self.end - self.start, axis=-1)

    def contains(self, swivel: Float[ArrayLike, "*batch"]) -> Bool[Array, "*batch branch"]:
        """Whether a swivel lies in an arc of each branch, ends included."""
        offset = jnp.asarray(swivel)[..., None, None] - self.start
        offset = offset - 2 * jnp.pi * jnp.floor(offset / (2 * jnp.pi))
        return jnp.any(self.valid & (offset <= self.end - self.start), axis=-1)


@jax.jit
def swivel_arcs(arm: Arm, target: Target) -> SwivelArcs:
    """The exact swivels at which each branch keeps every joint in its limits and the elbow out of the keep-out.

    Args:
        arm: The arm.
        target: A :class:`Pose` or :class:`Pointing` with leading batch axes, as for :func:`solve_ik`.

    Returns:
        Arcs of all eight branches. There are ``2 * joints on the circle + half_spaces`` places a branch, which no
        target can exceed; a whole circle is one arc of width 2 pi; a target that is bad or out of reach has none.
        Limits that touch leave an arc of width zero.

    Raises:
        ValueError: Wrong shapes or dtypes, or a :class:`Pose` for a 6-joint arm.

    **Differentiability**: the ends in target and arm, while the number of arcs stays the same; derivative zero where an
    arc just appears (its true rate is infinite there).

    References:
        The paper's Figure 18; M. Shimizu et al., IEEE T-RO 24(5), 2008, section IV, for joint limits one at a time.
    """
    target, _ = check_target(arm, target)
    batch = batch_shape(target)
    dtype = target.position.dtype
    position, directions, _ = target_columns(target, jnp.zeros((), dtype), batch)
    start, end, valid = feasible_arcs(arm.astype(dtype), swivel_functions(arm.astype(dtype), position, directions))
    return SwivelArcs(*(col.batch_first(x, batch) for x in (start, end, valid)))


def feasible_arcs(arm: Arm, f: SwivelFunctions) -> tuple[Array, Array, Array]:
    """Starts, ends and validity ``(8, arcs, n)`` of the feasible swivels."""
    borders = sort_borders(borders_of_limits(arm, f))
    return _runs(borders, feasible_between(arm, f, borders))


@stage
def borders_of_limits(arm: Arm, f: SwivelFunctions) -> Array:
    """Swivels where a constraint changes sign, ``(borders, elbow bit, n)`` in (-pi, pi]; pi where there is none."""
    floor = tolerances(f.elbow.dtype).singular
    n = f.elbow.shape[-1]
    meets = []
    for entries, first, delta in f.triples():
        lower, upper = _limits(arm, entries, first, delta)
        cuts = jnp.concatenate([upper - lower, upper - lower]) < 2 * jnp.pi
        at = jnp.stack([lower, upper]).reshape(-1)
        angles = jnp.arange(at.shape[0]) % lower.shape[0]
        found, _ = roots(angle_equations(entries, angles, at[:, None, None]), floor)
        meets.append(col.merged(jnp.where(cuts[:, None, None], found, jnp.pi), 2))
    if f.keep_out.shape[0]:
        upper_arm = jnp.sqrt(jnp.sum((arm.elbow - arm.shoulder) ** 2))
        found, _ = roots(jnp.moveaxis(f.keep_out, 1, 0) / upper_arm, floor)
        found = col.merged(found, 1)[:, None]
        meets.append(jnp.broadcast_to(found, (len(found), 2, n)))
    return jnp.concatenate(meets)


@stage
def sort_borders(borders: Array) -> Array:
    """Borders ascending along the first axis.

    By counting: a border's place is the number of those before it. That is quadratic in a short axis, but straight
    vector code over the batch, where a sort is a scalar call per row.
    """
    m = borders.shape[0]
    index = jnp.arange(m).reshape(m, 1, 1)
    place = jnp.zeros_like(borders)
    for j in range(m):
        before = (borders[j] < borders) | ((borders[j] == borders) & (j < index))
        place = place + jnp.where(before, 1.0, 0.0)
    return _placed(borders, place)


@stage
def _placed(borders: Array, place: Array) -> Array:
    slots = jnp.arange(borders.shape[0]).astype(borders.dtype)[:, None, None]
    total = jnp.zeros((), borders.dtype)
    for j in range(borders.shape[0]):
        total = total + jnp.where(place[j] == slots, borders[j], 0.0)
    return total


@stage
def _middles(borders: Array) -> tuple[Array, Array]:
    """Sine and cosine halfway from each border to the next."""
    return sincos(0.5 * (borders + _following(borders)))


def _following(borders: Array) -> Array:
    return jnp.concatenate([borders[1:], borders[:1] + 2 * jnp.pi])


def feasible_between(arm: Arm, f: SwivelFunctions, borders: Array) -> Array:
    """Whether each interval is feasible, tested at its middle, ``(shoulder bit, wrist bit, borders, elbow bit, n)``."""
    sin, cos = _middles(borders)
    shoulder, wrist = (
        _in_sectors(_at(entries, sin, cos), *_limits(arm, entries, first, delta))
        for entries, first, delta in f.triples()
    )
    return _combined(arm, f, shoulder, wrist, sin, cos)


@stage
def _at(entries: Array, sin: Array, cos: Array) -> Array:
    """Values ``(entries, borders, elbow bit, n)`` of a + b cos + c sin."""
    a, b, c = jnp.moveaxis(entries, 1, 0)[:, :, None]
    return a + b * cos + c * sin


@stage
def _combined(arm: Arm, f: SwivelFunctions, shoulder: Array, wrist: Array, sin: Array, cos: Array) -> Array:
    combined = shoulder[:, None] & wrist[None, :] & f.elbow_inside & f.solvable
    slack = tolerances(sin.dtype).singular * jnp.sqrt(jnp.sum((arm.elbow - arm.shoulder) ** 2))
    for a, b, c in f.keep_out:
        combined = combined & (a + b * cos + c * sin >= -slack)
    return combined


@stage
def _in_sectors(values: Array, lower: Array, upper: Array) -> Array:
    """Whether every angle of a triple lies between its limits, for both solutions, ``(bit, borders, elbow bit, n)``."""
    sine = jnp.sqrt(jnp.maximum(1.0 - values[2] * values[2], 0.0))
    solutions = []
    for sign in (1.0, -1.0):
        inside = _in_sector(sign * values[0], sign * values[1], lower[0], upper[0])
        inside = inside & _in_sector(values[2], sign * sine, lower[1], upper[1])
        if values.shape[0] == 5:
            inside = inside & _in_sector(sign * values[3], sign * values[4], lower[2], upper[2])
        solutions.append(inside)
    return jnp.stack(solutions)


def _in_sector(x: Array, y: Array, lower: Array, upper: Array) -> Array:
    """Whether the direction of (x, y) lies between two angles; a range of a turn or more always holds it."""
    slack = tolerances(x.dtype).singular
    after_lower = jnp.cos(lower) * y - jnp.sin(lower) * x >= -slack
    before_upper = jnp.sin(upper) * x - jnp.cos(upper) * y >= -slack
    width = upper - lower
    both = (after_lower & before_upper) | ((width > jnp.pi) & (after_lower | before_upper))
    return both | (width >= 2 * jnp.pi)


def _runs(borders: Array, feasible: Array) -> tuple[Array, Array, Array]:
    """Merges neighboring feasible intervals into arcs ``(8, borders / 2, n)``, in ascending order of their starts."""
    packed = _packed_starts(feasible, borders)
    number = _unpacked(jnp.tril(jnp.ones((len(packed),) * 2, packed.dtype)) @ packed, borders)
    starts, ends = _numbered(number, feasible)
    following = _following(borders)
    return _arcs(
        _gathered(borders, starts), _gathered(following, ends), _seam_end(following, number, feasible), number, feasible
    )


# Starts of the four solutions of an elbow, counted together as digits of one number below 2^24, exact in any float.
_DIGITS = ((1.0, 64.0), (4096.0, 262144.0))


@stage
def _packed_starts(feasible: Array, borders: Array) -> Array:
    """Which of the four solutions start an arc at a border, as digits, ``(borders, elbow bit * n)``."""
    starts = feasible & ~jnp.roll(feasible, 1, axis=2)
    digits = jnp.array(_DIGITS, borders.dtype)
    packed = sum((jnp.where(starts[i, j], digits[i, j], 0.0) for i in (0, 1) for j in (0, 1)), start=0.0 * borders)
    return packed.reshape(len(borders), borders[0].size)


@stage
def _unpacked(sums: Array, borders: Array) -> Array:
    """Number of starts up to each border, ``(2, 2, borders, elbow bit, n)``."""
    digits = jnp.array(_DIGITS, sums.dtype)[..., None, None, None]
    scaled = sums.reshape(borders.shape) / digits
    return jnp.floor(scaled) - 64.0 * jnp.floor(scaled / 64.0)


@stage
def _numbered(number: Array, feasible: Array) -> tuple[Array, Array]:
    """The number, from 1, of the arc that an interval starts or ends; 0 where it does neither."""
    starts = feasible & ~jnp.roll(feasible, 1, axis=2)
    ends = feasible & ~jnp.roll(feasible, -1, axis=2)
    return jnp.where(starts, number, 0.0), jnp.where(ends, number, 0.0)


@stage
def _gathered(values: Array, number: Array) -> Array:
    """The value numbered k, for every arc k, ``(2, 2, borders / 2, elbow bit, n)``."""
    m = values.shape[0]
    arcs = []
    for k in range(m // 2):
        # The k-th arc begins after k others and the gaps between: not before interval 2 k.
        terms = (jnp.where(number[:, :, i] == k + 1.0, values[i], 0.0) for i in range(2 * k, m))
        arcs.append(sum(terms, start=jnp.zeros((), values.dtype)))
    return jnp.stack(arcs, axis=2)


@stage
def _seam_end(following: Array, number: Array, feasible: Array) -> Array:
    """Where an arc that crosses the seam ends, a turn on; 0 without one. It is the end that comes before any start."""
    ends = feasible & ~jnp.roll(feasible, -1, axis=2) & (number == 0.0)
    terms = (jnp.where(ends[:, :, i], following[i] + 2 * jnp.pi, 0.0) for i in range(len(following)))
    return sum(terms, start=jnp.zeros((), following.dtype))  # pyright: ignore


@stage
def _arcs(start: Array, end: Array, seam_end: Array, number: Array, feasible: Array) -> tuple[Array, Array, Array]:
    """Puts in the seam's end and whole circles, and orders the branches."""
    slots = jnp.arange(1, start.shape[2] + 1).astype(start.dtype)[:, None, None]
    count = number[:, :, -1:]
    end = jnp.where(slots == count, end + seam_end[:, :, None], end)
    full = jnp.all(feasible, axis=2, keepdims=True) & (slots == 1.0)
    parts = jnp.where(full, -jnp.pi, start), jnp.where(full, jnp.pi, end), full | (slots <= count)
    # (shoulder, wrist, arcs, elbow, n) to branch numbers.
    start, end, valid = (col.merged(jnp.moveaxis(x, 3, 1), 2) for x in parts)
    return start, end, valid


def _limits(arm: Arm, entries: Array, first: int, delta: Array) -> tuple[Array, Array]:
    """Limits of a triple's joints as directions of their plane vectors, which for the middle one include delta."""
    count = (entries.shape[0] + 1) // 2
    offset = jnp.where(jnp.arange(count) == 1, delta, 0.0)
    return arm.lower[first : first + count] + offset, arm.upper[first : first + count] + offset
