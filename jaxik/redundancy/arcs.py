"""The exact set of swivels at which a target is feasible: arcs of the elbow's circle, in closed form.

1. Where a joint meets a limit, or the elbow the border of its keep-out, is the root of a + b cos + c sin: at most two.
2. Between neighboring roots nothing changes, so one test at the middle decides an interval.
3. A limit test needs no angle: the plane vector of the angle lies in the sector between its limits, two signs.
4. Runs of feasible intervals are the arcs.

No sampling, fixed shapes: a pose with any feasible swivel always shows it, however narrow the arc.
"""

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from jaxik.arm import Arm, ArmModel, OuterJointArm, RefinedArm, as_arm
from jaxik.ik import Status, over_targets, raise_unless_ok, replace_bad_rows, target_columns
from jaxik.numerics import (
    CHUNK,
    fused_separately,
    merge_leading,
    sincos,
    sincos_apart,
    sort_columns,
    to_batch_first,
    tolerances,
)
from jaxik.obstacles import World, columns_of, in_columns, in_world, moves
from jaxik.redundancy.arc_intervals import following, runs
from jaxik.redundancy.outer_joint_arcs import any_within, parameter_arcs
from jaxik.redundancy.refined_arcs import refined_arcs
from jaxik.redundancy.self_motion import SelfMotion, SphericalJoint, self_motion
from jaxik.redundancy.sinusoid import angle_equations, roots
from jaxik.targets import Target, TargetLike, as_target, batch_shape, check_target

if TYPE_CHECKING:
    from typing import Self

_REFINED_CHUNK = 16  # rows of an arm that is solved by refinement: each is solved a thousand times
_BODY_CHUNK = 256  # rows of an arm with a body per chunk: a chunk takes as many rounds as its most obstructed row
_SAMPLED_CHUNK = 32  # likewise of an arm with an outer joint, which takes some thousand postures per row


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class SwivelArcs:
    """Feasible swivels of every branch: arcs in ascending order of their starts, unused places at the end.

    Attributes:
        start: Start of each arc, ``(*batch, 8, arcs)`` [rad] in [-pi, pi].
        end: Its end, ``(*batch, 8, arcs)`` [rad], ``start <= end <= start + 2 pi``; an arc across the seam ends
            beyond pi.
        valid: True for places that hold an arc; the others are zero.
        status: :class:`jaxik.Status` as integers, ``(*batch,)``: OK where any branch has an arc.
    """

    start: Float[Array, "*batch branch arc"]
    end: Float[Array, "*batch branch arc"]
    valid: Bool[Array, "*batch branch arc"]
    status: Int[Array, "*batch"]

    @property
    def ok(self) -> Bool[Array, "*batch"]:
        """True where any branch has a feasible swivel."""
        return self.status == Status.OK

    @property
    def width(self) -> Float[Array, "*batch branch"]:
        """Total feasible swivel of each branch [rad]."""
        return jnp.sum(self.end - self.start, axis=-1)

    def contains(self, swivel: Float[ArrayLike, "*batch"]) -> Bool[Array, "*batch branch"]:
        """Return whether a swivel lies in an arc of each branch, ends included.

        Args:
            swivel: Swivels, ``(*batch,)`` [rad], of any turn.
        """
        offset = jnp.asarray(swivel)[..., None, None] - self.start
        offset = offset - 2 * jnp.pi * jnp.floor(offset / (2 * jnp.pi))
        return jnp.any(self.valid & (offset <= self.end - self.start), axis=-1)

    def raise_if_invalid(self) -> "Self":
        """Return the arcs themselves, so that calls chain; for use outside ``jit``.

        Raises:
            UnreachableError: A target has no feasible swivel in any branch; with the targets and the reason.
        """
        raise_unless_ok(self.status, "no feasible swivel in any branch")
        return self


def swivel_arcs(arm: Arm | ArmModel, target: TargetLike, *, world: World | None = None) -> SwivelArcs:
    """Return the exact swivels at which each branch keeps all joints in their limits and the elbow out of its keep-out.

    Args:
        arm: The arm.
        target: A :class:`Pose` or :class:`Pointing` with leading batch axes, as for :func:`solve_ik`.
        world: Obstacles, for an arm with a body (:func:`jaxik.with_body`): swivels at which the body meets them, or
            itself, are in no arc. Batch axes, one world per target, broadcast against those of the target.

    Returns:
        Arcs of all eight branches. There are ``2 * joints on the circle + half_spaces`` places per branch, which no
        target can exceed; a whole circle is one arc of width 2 pi; a target that is bad or out of reach has none.
        Limits that touch leave an arc of width zero. With a body the places are the same, and where obstacles leave
        more arcs than there is room for, or more than 16 for one side of the elbow, some narrow ones are left out. The
        status is COLLISION where limits leave an arc and the body none. The intervals of an outer joint's angle are
        found from 128 angles and more. Those of an arm that is solved by refinement are found from 256 angles, to 1e-7
        rad, for each of the 16 places of :func:`solve_ik`: what is narrower than 1.4 degrees can be missed.

    Raises:
        ValueError: Wrong shapes or dtypes, or a :class:`Pose` for a 6-joint arm; a world for an arm without a body.

    **Differentiability**: the ends in target and arm, while the number of arcs stays the same; derivative zero where an
    arc just appears (its true rate is infinite there).

    References:
        The paper's Figure 18; M. Shimizu et al., IEEE T-RO 24(5), 2008, section IV, for joint limits one at a time.
    """
    arm, target = in_world(as_arm(arm, any_class=True), world), as_target(target)
    if arm.surroundings is not None:
        as_arm(arm, any_class=True, closed_form=True, instead="this one takes them without a body")
    if moves(arm):  # the rows of the world would have to be in the chunks too
        return _swivel_arcs(arm, target)
    if arm.surroundings is None:
        return over_targets(_swivel_arcs, arm, target, chunk=CHUNK if arm.closed_form else _REFINED_CHUNK)
    return over_targets(_swivel_arcs, arm, target, chunk=_BODY_CHUNK if type(arm) is Arm else _SAMPLED_CHUNK)


@jax.jit
def _swivel_arcs(arm: Arm, target: Target) -> SwivelArcs:
    target, _ = check_target(arm, target)
    arm = arm.astype(target.position.dtype)
    if moves(arm):
        target = _spread(target, arm.surroundings.world.batch)
    if isinstance(arm, OuterJointArm | RefinedArm):
        return _parameter_arcs(arm, target)
    return feasible_arcs(self_motion(arm, target))


def _spread(target: Target, batch: tuple[int, ...]) -> Target:
    """Targets broadcast to the rows of a world."""
    batch, one = np.broadcast_shapes(batch_shape(target), batch), batch_shape(target)
    return jax.tree.map(lambda x: jnp.broadcast_to(x, (*batch, *x.shape[len(one) :])), target)


def _parameter_arcs(arm: OuterJointArm | RefinedArm, target: Target) -> SwivelArcs:
    """Feasible parameters of an arm without a swivel."""
    batch = batch_shape(target)
    position, directions, zeros = target_columns(target, jnp.zeros((), target.position.dtype), batch)
    checked = replace_bad_rows(arm, position, directions, zeros)
    bad = checked.invalid | checked.nonfinite
    columns = checked.position, checked.directions
    if isinstance(arm, RefinedArm):
        start, end, valid = refined_arcs(arm, *columns)
    else:
        around = arm
        if arm.surroundings is not None:
            around = in_columns(arm, columns_of(arm.surroundings.world, batch))
        start, end, valid = parameter_arcs(around, *columns)
    start, end, valid = (jnp.where(bad, jnp.zeros((), x.dtype), x) for x in (start, end, valid))
    status = jnp.full(bad.shape, Status.LIMITS, jnp.int32)
    if arm.surroundings is not None and isinstance(arm, OuterJointArm):
        within = any_within(replace(arm, surroundings=None), *columns)
        status = jnp.where(within, jnp.int32(Status.COLLISION), status)
    status = jnp.where(checked.invalid, jnp.int32(Status.INVALID_TARGET), status)
    status = jnp.where(checked.nonfinite, jnp.int32(Status.NONFINITE_INPUT), status)
    status = jnp.where(jnp.any(valid, axis=(0, 1)), jnp.int32(Status.OK), status)
    return SwivelArcs(*(to_batch_first(x, batch) for x in (start, end, valid, status)))


def feasible_arcs(motion: SelfMotion) -> SwivelArcs:
    """Return the feasible arcs of a self-motion; its rows become the batch axes."""
    rows = motion.status.shape
    flat = (
        motion
        if len(rows) == 1
        else motion.map_rows(lambda x: x.reshape(*x.shape[: x.ndim - len(rows)], math.prod(rows)))
    )
    limits = limits_of(flat)
    borders = sort_columns(borders_of_limits(flat, limits))
    within = feasible = _within_limits_between(flat, borders, limits)
    unsolved = jnp.maximum(motion.status, jnp.int32(Status.LIMITS))
    if flat.free is not None:
        feasible = feasible & _clear_between(flat, borders)
        collides = jnp.any(within, axis=(0, 1, 2, 3)).reshape(rows)
        unsolved = jnp.where(collides, jnp.maximum(unsolved, jnp.int32(Status.COLLISION)), unsolved)
    merged = runs(borders, feasible)
    if (
        flat.free is not None
    ):  # the places that limits need: programs that use arcs are the same with and without a body
        merged = tuple(x[:, : (len(borders) - 2 * len(flat.free.start)) // 2] for x in merged)
    start, end, valid = (jnp.moveaxis(x, -1, 0).reshape(*rows, *x.shape[:-1]) for x in merged)
    return SwivelArcs(start, end, valid, jnp.where(jnp.any(valid, axis=(-2, -1)), jnp.int32(Status.OK), unsolved))


class Ranges(NamedTuple):
    """Ranges of the joints: the arm's limits, or parts of them that depend on the row.

    Attributes:
        lower: Lower ends, ``(joint, n or 1)`` [rad].
        upper: Upper ends, likewise.
        elbow_inside: True where joint 4 is within its range, ``(elbow bit, n)``.
        seams: True if the circle is cut at the ends of ranges of a full turn too, ``()``.
    """

    lower: Array
    upper: Array
    elbow_inside: Array
    seams: ArrayLike = False

    def of(self, joint: SphericalJoint) -> tuple[Array, Array]:
        """Ranges of a spherical joint as angles of its plane vectors, delta included, ``(angle, n or 1)``."""
        own = slice(joint.first, joint.first + joint.angles)
        offset = jnp.where(jnp.arange(joint.angles) == 1, joint.delta, 0.0)[:, None]
        return self.lower[own] + offset, self.upper[own] + offset


def limits_of(motion: SelfMotion) -> Ranges:
    """Return the arm's own limits."""
    return Ranges(motion.arm.lower[:, None], motion.arm.upper[:, None], motion.elbow_inside)


def borders_of_limits(motion: SelfMotion, ranges: Ranges) -> Array:
    """Swivels where a constraint changes sign, ``(borders, elbow bit, n)`` in (-pi, pi]; pi where there is none."""
    meets = []
    for joint in motion.spherical_joints():
        lower, upper = ranges.of(joint)
        found = _meets(joint.entries, *sincos_apart(jnp.concatenate([lower, upper])))
        cuts = (jnp.concatenate([upper - lower, upper - lower]) < 2 * jnp.pi) | ranges.seams
        found = jnp.where(cuts[:, None], found, jnp.pi)
        if joint.angles == 3:
            found = _with_turns(joint, lower, upper, found)
        meets.append(merge_leading(found, 2))
    if motion.keep_out.shape[0]:
        found = _enters(motion.arm, motion.keep_out)[:, None]
        meets.append(jnp.broadcast_to(found, (len(found), *motion.elbow.shape)))
    if motion.free is not None:
        meets += list(motion.free)
    return jnp.concatenate(meets)


@fused_separately
def _meets(entries: Array, sin: Array, cos: Array) -> Array:
    """Swivels where the angles of a spherical joint meet lower and upper limits, ``(2, limits, elbow bit, n)``."""
    angles = np.arange(len(sin)) % (len(sin) // 2)
    return roots(angle_equations(entries, angles, sin[:, None], cos[:, None]), tolerances(entries.dtype).singular)[0]


@fused_separately
def _enters(arm: Arm, keep_out: Array) -> Array:
    """Swivels where the elbow meets its keep-out, ``(2 * half_spaces, n)``."""
    upper_arm = jnp.sqrt(jnp.sum((arm.elbow - arm.shoulder) ** 2))
    return merge_leading(roots(jnp.moveaxis(keep_out, 1, 0) / upper_arm, tolerances(keep_out.dtype).singular)[0], 1)


def _with_turns(joint: SphericalJoint, lower: Array, upper: Array, found: Array) -> Array:
    """Borders ``(2, limits, elbow bit, n)`` where a joint is aligned all round: its turn meets the ends of its sector.

    They take the places of the first angle's limits, which have no borders there.
    """
    all_round = jnp.sum(jnp.abs(joint.entries[:2]), axis=(0, 1)) <= tolerances(found.dtype).aligned

    def turns() -> Array:
        pole = jnp.where(joint.entries[2][0] > 0.0, 1.0, -1.0).astype(found.dtype)
        low = lower[0] + jnp.where(pole > 0.0, lower[2], -upper[2])
        high = upper[0] + jnp.where(pole > 0.0, upper[2], -lower[2])
        x, y = joint.turn
        borders = found
        for place, at in ((0, low), (joint.angles, high)):
            sin, cos = pole * jnp.sin(at), pole * jnp.cos(at)
            ends = roots(cos * y - sin * x, tolerances(found.dtype).singular)[0]
            ends = jnp.where(high - low < 2 * jnp.pi, ends, jnp.pi)
            borders = borders.at[:, place].set(jnp.where(all_round, ends, borders[:, place]))
        return borders

    return jax.lax.cond(jnp.any(all_round), turns, lambda: found)


@fused_separately
def _middles(borders: Array) -> tuple[Array, Array]:
    """Sine and cosine halfway from each border to the next."""
    return sincos(0.5 * (borders + following(borders)))


def feasible_between(motion: SelfMotion, borders: Array, ranges: Ranges) -> Array:
    """Return whether each interval is feasible, tested at its middle.

    Args:
        motion: The self-motion of n targets.
        borders: Ends of the intervals, ascending, ``(borders, elbow bit, n)`` [rad].
        ranges: Ranges of the joints.

    Returns:
        ``(shoulder bit, wrist bit, borders, elbow bit, n)``.
    """
    feasible = _within_limits_between(motion, borders, ranges)
    return feasible if motion.free is None else feasible & _clear_between(motion, borders)


def _within_limits_between(motion: SelfMotion, borders: Array, ranges: Ranges) -> Array:
    """Return whether each interval is within limits and keep-out, as :func:`feasible_between`."""
    sin, cos = _middles(borders)
    joints = motion.spherical_joints()
    shoulder, wrist = (_in_sectors(joint.entries, sin, cos, *_sectors(*ranges.of(joint))) for joint in joints)
    aligned = [(inside & _ALIGNED) != 0 for inside in (shoulder, wrist)]

    def with_families() -> tuple[Array, Array]:
        splits = (_splits_inside(joint, sin, cos, *ranges.of(joint)) for joint in joints)
        s, w = (jnp.where(a, x, inside) for a, x, inside in zip(aligned, splits, (shoulder, wrist), strict=True))
        return s, w

    shoulder, wrist = jax.lax.cond(jnp.any(aligned[0]) | jnp.any(aligned[1]), with_families, lambda: (shoulder, wrist))
    return _combined(motion, ranges.elbow_inside, shoulder, wrist, sin, cos)


@fused_separately
def _clear_between(motion: SelfMotion, borders: Array) -> Array:
    """Return whether the body is free at the middle of each interval, ``(borders, elbow bit, n)``."""
    return jnp.asarray(motion.clear_of_obstacles(0.5 * (borders + following(borders))))


def _splits_inside(joint: SphericalJoint, sin: Array, cos: Array, lower: Array, upper: Array) -> Array:
    """Solutions of an aligned joint with a split within the ranges, as sums of _BITS, ``(borders, elbow bit, n)``.

    The outer ranges together hold a sector of turns, or of differences of turns.
    """
    z = joint.entries[2][0] + joint.entries[2][1] * cos + joint.entries[2][2] * sin
    slack = tolerances(z.dtype).singular
    middle = jnp.where(z > 0.0, 0.0, jnp.pi).astype(z.dtype)
    inside = (lower[1] <= upper[1]) & (_past(middle, lower[1], slack) <= upper[1] - lower[1] + 2 * slack)
    if joint.angles == 3:
        pole, turn = joint.aligned_turn(sin, cos)
        low = lower[0] + jnp.where(pole > 0.0, lower[2], -upper[2])
        width = upper[0] - lower[0] + upper[2] - lower[2]
        inside = inside & (_past(turn, low, slack) <= width + 2 * slack)
    return jnp.where(inside, jnp.uint8(sum(_BITS)), jnp.uint8(0))


def _past(angle: Array, lower: Array, slack: float) -> Array:
    """Distance of an angle past the lower end of a range, less than a turn [rad]."""
    past = angle - lower + slack
    return past - 2 * jnp.pi * jnp.floor(past / (2 * jnp.pi))


@fused_separately
def _combined(motion: SelfMotion, elbow_inside: Array, shoulder: Array, wrist: Array, sin: Array, cos: Array) -> Array:
    open_elbow = elbow_inside & motion.solvable & motion.clear_of_keep_out(sin, cos)
    first, second = ([(joint & bit) != 0 for bit in _BITS] for joint in (shoulder, wrist))
    return jnp.stack([jnp.stack([s & w & open_elbow for w in second]) for s in first])


# Solutions of a spherical joint, and whether it is aligned, as digits of one byte: one pass computes what they share.
_BITS, _ALIGNED = (1, 2), 4


@fused_separately
def _in_sectors(entries: Array, sin: Array, cos: Array, lower: Array, upper: Array, width: Array) -> Array:
    """Solutions whose angles all lie between their limits, as sums of digits, ``(borders, elbow bit, n)``."""
    x, y, z, *third = (a + b * cos + c * sin for a, b, c in entries)
    sine = jnp.sqrt(jnp.maximum(1.0 - z * z, 0.0))
    outer = {0: _sides(x, y, lower[:, 0], upper[:, 0])}
    if third:
        outer[2] = _sides(third[0], third[1], lower[:, 2], upper[:, 2])
    aligned = x * x + y * y <= tolerances(sin.dtype).aligned ** 2
    found = jnp.where(aligned, jnp.uint8(_ALIGNED), jnp.uint8(0))
    for bit, sign in zip(_BITS, (1.0, -1.0), strict=True):
        inside = _between(*_sides(z, sign * sine, lower[:, 1], upper[:, 1]), width[1])
        for joint, (past, short) in outer.items():  # opposite directions in the other solution
            inside = inside & _between(sign * past, sign * short, width[joint])
        found = found + jnp.where(inside, jnp.uint8(bit), jnp.uint8(0))
    return found


def _sides(x: Array, y: Array, lower: Array, upper: Array) -> tuple[Array, Array]:
    """Distances of the direction of (x, y) past the lower limit, and short of the upper, limits as (cos, sin)."""
    return lower[0] * y - lower[1] * x, upper[1] * x - upper[0] * y


def _between(past: Array, short: Array, width: Array) -> Array:
    """Test whether a direction lies between limits: on both their sides, of a wide range on one; a turn holds all."""
    least, most = jnp.where(past < short, past, short), jnp.where(past < short, short, past)
    slack = jnp.where(width >= 2 * jnp.pi, jnp.inf, tolerances(past.dtype).singular)
    return jnp.where(width > jnp.pi, most, least) >= -slack


@fused_separately
def _sectors(lower: Array, upper: Array) -> tuple[Array, Array, Array]:
    """Directions (cos, sin) of the limits, ``(2, joints, n or 1)``, and the widths between them."""
    return jnp.stack([jnp.cos(lower), jnp.sin(lower)]), jnp.stack([jnp.cos(upper), jnp.sin(upper)]), upper - lower
