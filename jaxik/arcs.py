"""The exact set of swivels at which a target is feasible: arcs of the elbow's circle, in closed form.

1. Where a joint meets a limit, or the elbow the border of its keep-out, is the root of a + b cos + c sin: at most two each.
2. Between neighbouring roots nothing changes, so one test at the middle decides an interval.
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
        Arcs of all eight branches. There are ``2 * joints on the circle + half_spaces`` places a branch, which no target can
        exceed; a whole circle is one arc of width 2 pi; a target that is bad or out of reach has none. Limits that touch
        leave an arc of width zero.

    Raises:
        ValueError: Wrong shapes or dtypes, or a :class:`Pose` for a 6-joint arm.

    **Differentiability**: the ends in target and arm, while the number of arcs stays the same; derivative zero where an arc
    just appears (its true rate is infinite there).

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
    borders = _sorted(_borders(arm, f))
    return _runs(borders, _feasible(arm, f, borders))


@stage
def _borders(arm: Arm, f: SwivelFunctions) -> Array:
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
        meets.append(jnp.where(cuts[:, None, None], found, jnp.pi).reshape(-1, 2, n))
    if f.keep_out.shape[0]:
        upper_arm = jnp.sqrt(jnp.sum((arm.elbow - arm.shoulder) ** 2))
        found, _ = roots(jnp.moveaxis(f.keep_out, 1, 0) / upper_arm, floor)
        meets.append(jnp.broadcast_to(found.reshape(-1, 1, n), (found.shape[0] * found.shape[1], 2, n)))
    return jnp.concatenate(meets)


@stage
def _sorted(borders: Array) -> Array:
    """Borders ascending along the first axis.

    By counting: a border's place is the number of those before it. That is quadratic in a short axis, but straight vector
    code over the batch, where a sort is a scalar call per row.
    """
    m = borders.shape[0]
    index = jnp.arange(m).reshape(m, 1, 1)
    place = jnp.zeros(borders.shape, jnp.int32)
    for j in range(m):
        before = (borders[j] < borders) | ((borders[j] == borders) & (j < index))
        place = place + before.astype(jnp.int32)
    return _placed(borders, place)


@stage
def _placed(values: Array, place: Array) -> Array:
    m = values.shape[0]
    slot = jnp.arange(m, dtype=jnp.int32).reshape(m, 1, 1)
    total = jnp.zeros_like(values)
    for j in range(m):
        total = total + jnp.where(place[j] == slot, values[j], 0.0)
    return total


@stage
def _feasible(arm: Arm, f: SwivelFunctions, borders: Array) -> Array:
    """Whether each interval from a border to the next is feasible, ``(8, borders, n)``, tested at its middle."""
    slack = tolerances(borders.dtype).singular
    following = jnp.concatenate([borders[1:], borders[:1] + 2 * jnp.pi])
    sin, cos = sincos(0.5 * (borders + following))
    inside = []
    for entries, first, delta in f.triples():
        a, b, c = jnp.moveaxis(entries, 1, 0)[:, :, None]
        values = a + b * cos + c * sin
        inside.append(_in_sectors(values, *_limits(arm, entries, first, delta), slack))
    shoulder, wrist = inside  # (bit, borders, elbow bit, n)
    combined = shoulder[:, None] & wrist[None, :]
    if f.keep_out.shape[0]:
        a, b, c = jnp.moveaxis(f.keep_out, 1, 0)[:, :, None, None]
        upper_arm = jnp.sqrt(jnp.sum((arm.elbow - arm.shoulder) ** 2))
        combined = combined & jnp.all(a + b * cos + c * sin >= -slack * upper_arm, axis=0)
    combined = combined & f.elbow_inside & f.solvable
    # (shoulder, wrist, borders, elbow, n) to branch numbers.
    return jnp.moveaxis(combined, 3, 1).reshape(8, *borders.shape[::2])


def _in_sectors(values: Array, lower: Array, upper: Array, slack: float) -> Array:
    """Whether every angle of a triple lies between its limits, for both solutions, ``(bit, borders, elbow bit, n)``."""
    spread = (slice(None), None, None, None)
    sine = jnp.sqrt(jnp.maximum(1.0 - values[2] * values[2], 0.0))
    solutions = []
    for sign in (1.0, -1.0):
        x, y = [sign * values[0], values[2]], [sign * values[1], sign * sine]
        if values.shape[0] == 5:
            x.append(sign * values[3])
            y.append(sign * values[4])
        x, y = jnp.stack(x), jnp.stack(y)
        after_lower = jnp.cos(lower)[spread] * y - jnp.sin(lower)[spread] * x >= -slack
        before_upper = jnp.sin(upper)[spread] * x - jnp.cos(upper)[spread] * y >= -slack
        width = (upper - lower)[spread]
        both = jnp.where(width <= jnp.pi, after_lower & before_upper, after_lower | before_upper)
        solutions.append(jnp.all(both | (width >= 2 * jnp.pi), axis=0))
    return jnp.stack(solutions)


@stage
def _runs(borders: Array, feasible: Array) -> tuple[Array, Array, Array]:
    """Merges neighbouring feasible intervals ``(8, borders, n)`` into arcs ``(8, borders / 2, n)``."""
    m, _, n = borders.shape
    borders = jnp.tile(jnp.repeat(jnp.moveaxis(borders, 1, 0), 2, axis=0), (2, 1, 1))
    following = jnp.concatenate([borders[:, 1:], borders[:, :1] + 2 * jnp.pi], axis=1)
    starts = feasible & ~jnp.roll(feasible, 1, axis=1)
    ends = feasible & ~jnp.roll(feasible, -1, axis=1)
    whole = jnp.all(feasible, axis=1)
    # Arc number of an interval: the starts up to it, by a triangular product; an end before any start closes the last arc.
    up_to = jnp.tril(jnp.ones((m, m), borders.dtype))
    number = jnp.einsum("ij,bjn->bin", up_to, starts.astype(borders.dtype), precision="highest")
    last = number[:, -1:]
    closes_last = number == 0.0
    end_number = jnp.where(closes_last, last, number)
    following = jnp.where(closes_last, following + 2 * jnp.pi, following)
    slot = jnp.arange(1, m // 2 + 1).astype(borders.dtype)[:, None]
    start, end = jnp.zeros((8, m // 2, n), borders.dtype), jnp.zeros((8, m // 2, n), borders.dtype)
    for i in range(m):
        start = start + jnp.where(starts[:, i, None] & (number[:, i, None] == slot), borders[:, i, None], 0.0)
        end = end + jnp.where(ends[:, i, None] & (end_number[:, i, None] == slot), following[:, i, None], 0.0)
    first_of_whole = whole[:, None] & (slot == 1.0)
    start = jnp.where(first_of_whole, -jnp.pi, start)
    end = jnp.where(first_of_whole, jnp.pi, end)
    return start, end, first_of_whole | (slot <= last)


def _limits(arm: Arm, entries: Array, first: int, delta: Array) -> tuple[Array, Array]:
    """Limits of a triple's joints as directions of their plane vectors, which for the middle one include delta."""
    count = (entries.shape[0] + 1) // 2
    offset = jnp.where(jnp.arange(count) == 1, delta, 0.0)
    return arm.lower[first : first + count] + offset, arm.upper[first : first + count] + offset
