"""The exact set of swivels at which a target is feasible: arcs of the elbow's circle, in closed form.

1. Where a joint meets a limit, or the elbow the border of its keep-out, is the root of a + b cos + c sin: at most two.
2. Between neighboring roots nothing changes, so one test at the middle decides an interval.
3. A limit test needs no angle: the plane vector of the angle lies in the sector between its limits, two signs.
4. Runs of feasible intervals are the arcs.

No sampling, fixed shapes: a pose with any feasible swivel always shows it, however narrow the arc.
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from jaxik.arm import Arm, ArmModel, as_arm
from jaxik.ik import Status, raise_unless_ok
from jaxik.numerics import fused_separately, merge_leading, sincos, sort_columns, tolerances
from jaxik.redundancy.arc_intervals import following, runs
from jaxik.redundancy.self_motion import SelfMotion, SphericalJoint, self_motion
from jaxik.redundancy.sinusoid import angle_equations, roots
from jaxik.targets import Target, TargetLike, as_target, check_target

if TYPE_CHECKING:
    from typing import Self


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


def swivel_arcs(arm: Arm | ArmModel, target: TargetLike) -> SwivelArcs:
    """Return the exact swivels at which each branch keeps all joints in their limits and the elbow out of its keep-out.

    Args:
        arm: The arm.
        target: A :class:`Pose` or :class:`Pointing` with leading batch axes, as for :func:`solve_ik`.

    Returns:
        Arcs of all eight branches. There are ``2 * joints on the circle + half_spaces`` places per branch, which no
        target can exceed; a whole circle is one arc of width 2 pi; a target that is bad or out of reach has none.
        Limits that touch leave an arc of width zero.

    Raises:
        ValueError: Wrong shapes or dtypes, or a :class:`Pose` for a 6-joint arm.

    **Differentiability**: the ends in target and arm, while the number of arcs stays the same; derivative zero where an
    arc just appears (its true rate is infinite there).

    References:
        The paper's Figure 18; M. Shimizu et al., IEEE T-RO 24(5), 2008, section IV, for joint limits one at a time.
    """
    return _swivel_arcs(as_arm(arm), as_target(target))


@jax.jit
def _swivel_arcs(arm: Arm, target: Target) -> SwivelArcs:
    target, _ = check_target(arm, target)
    return feasible_arcs(self_motion(arm.astype(target.position.dtype), target))


def feasible_arcs(motion: SelfMotion) -> SwivelArcs:
    """Return the feasible arcs of a self-motion; its rows become the batch axes."""
    rows = motion.status.shape
    flat = (
        motion
        if len(rows) == 1
        else motion.map_rows(lambda x: x.reshape(*x.shape[: x.ndim - len(rows)], math.prod(rows)))
    )
    borders = sort_columns(borders_of_limits(flat))
    start, end, valid = (
        jnp.moveaxis(x, -1, 0).reshape(*rows, *x.shape[:-1]) for x in runs(borders, feasible_between(flat, borders))
    )
    unsolved = jnp.maximum(motion.status, jnp.int32(Status.LIMITS))
    return SwivelArcs(start, end, valid, jnp.where(jnp.any(valid, axis=(-2, -1)), jnp.int32(Status.OK), unsolved))


@fused_separately
def borders_of_limits(motion: SelfMotion) -> Array:
    """Swivels where a constraint changes sign, ``(borders, elbow bit, n)`` in (-pi, pi]; pi where there is none."""
    arm, floor = motion.arm, tolerances(motion.elbow.dtype).singular
    n = motion.elbow.shape[-1]
    meets = []
    for joint in motion.spherical_joints():
        lower, upper = _limits(arm, joint)
        cuts = jnp.concatenate([upper - lower, upper - lower]) < 2 * jnp.pi
        at = jnp.stack([lower, upper]).reshape(-1)
        angles = jnp.arange(at.shape[0]) % lower.shape[0]
        found, _ = roots(angle_equations(joint.entries, angles, at[:, None, None]), floor)
        meets.append(merge_leading(jnp.where(cuts[:, None, None], found, jnp.pi), 2))
    if motion.keep_out.shape[0]:
        upper_arm = jnp.sqrt(jnp.sum((arm.elbow - arm.shoulder) ** 2))
        found, _ = roots(jnp.moveaxis(motion.keep_out, 1, 0) / upper_arm, floor)
        found = merge_leading(found, 1)[:, None]
        meets.append(jnp.broadcast_to(found, (len(found), 2, n)))
    return jnp.concatenate(meets)


@fused_separately
def _middles(borders: Array) -> tuple[Array, Array]:
    """Sine and cosine halfway from each border to the next."""
    return sincos(0.5 * (borders + following(borders)))


def feasible_between(motion: SelfMotion, borders: Array) -> Array:
    """Return whether each interval is feasible, tested at its middle.

    Args:
        motion: The self-motion of n targets.
        borders: Ends of the intervals, ascending, ``(borders, elbow bit, n)`` [rad].

    Returns:
        ``(shoulder bit, wrist bit, borders, elbow bit, n)``.
    """
    sin, cos = _middles(borders)
    shoulder, wrist = (
        _in_sectors(joint.entries, sin, cos, *_sectors(*_limits(motion.arm, joint)))
        for joint in motion.spherical_joints()
    )
    return _combined(motion, shoulder, wrist, sin, cos)


@fused_separately
def _combined(motion: SelfMotion, shoulder: Array, wrist: Array, sin: Array, cos: Array) -> Array:
    arm, open_elbow = motion.arm, motion.elbow_inside & motion.solvable
    slack = tolerances(sin.dtype).singular * jnp.sqrt(jnp.sum((arm.elbow - arm.shoulder) ** 2))
    for a, b, c in motion.keep_out:
        open_elbow = open_elbow & (a + b * cos + c * sin >= -slack)
    first, second = ([(joint & bit) != 0 for bit in _BITS] for joint in (shoulder, wrist))
    return jnp.stack([jnp.stack([s & w & open_elbow for w in second]) for s in first])


# Both solutions of a spherical joint as digits of one byte: one pass computes what they share once.
_BITS = (1, 2)


@fused_separately
def _in_sectors(entries: Array, sin: Array, cos: Array, lower: Array, upper: Array, width: Array) -> Array:
    """Solutions whose angles all lie between their limits, as sums of _BITS, ``(borders, elbow bit, n)``."""
    x, y, z, *third = (a + b * cos + c * sin for a, b, c in entries)
    sine = jnp.sqrt(jnp.maximum(1.0 - z * z, 0.0))
    outer = {0: _sides(x, y, lower[:, 0], upper[:, 0])}
    if third:
        outer[2] = _sides(third[0], third[1], lower[:, 2], upper[:, 2])
    found = jnp.zeros((), jnp.uint8)
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
    """Directions (cos, sin) of the limits, ``(2, joints)``, and the widths between them."""
    return jnp.stack([jnp.cos(lower), jnp.sin(lower)]), jnp.stack([jnp.cos(upper), jnp.sin(upper)]), upper - lower


def _limits(arm: Arm, joint: SphericalJoint) -> tuple[Array, Array]:
    """Limits of a spherical joint's angles as directions of their plane vectors, the middle one with delta."""
    count = (joint.entries.shape[0] + 1) // 2
    offset = jnp.where(jnp.arange(count) == 1, joint.delta, 0.0)
    own = slice(joint.first, joint.first + count)
    return arm.lower[own] + offset, arm.upper[own] + offset
