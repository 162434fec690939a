"""The posture on target that is nearest to the present one: least weighted joint motion over all branches and arcs.

1. Cut each elbow's circle where a joint meets a limit, meets its present angle (or the opposite one), or turns back,
   and at a coarse grid. All of these are roots of a + b cos + c sin.
2. On each piece every joint moves one way and stays on one side of its present angle, so the smaller of its distances
   at the two ends is its least: their weighted sum is a lower bound of the motion on the piece.
3. Refine the pieces with the smallest bounds to a stationary point, all at once, and take the best.

A narrow minimum cannot slip through a grid here: next to a singular posture, where a joint swings by half a turn within
a sliver of the circle, the cuts fall on that sliver.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from jaxik.arm import Arm, ArmModel, as_arm
from jaxik.ik import Status, branch_bits, branch_number, closed_form, raise_unless_ok, target_columns
from jaxik.numerics import (
    fused_separately,
    merge_leading,
    sort_columns,
    to_batch_first,
    to_batch_last,
    tolerances,
    toward,
    wrap,
)
from jaxik.redundancy.arc_intervals import following
from jaxik.redundancy.arcs import borders_of_limits, feasible_between
from jaxik.redundancy.branch_motion import BranchMotion
from jaxik.redundancy.self_motion import SelfMotion, self_motion_of_columns
from jaxik.redundancy.sinusoid import angle_equations, roots, turning_points
from jaxik.targets import Target, TargetLike, as_floats, as_target, batch_shape, check_joints, check_target

if TYPE_CHECKING:
    from typing import Self

# Rows solved at once: their pieces fill about 50 MB, and more rows gain nothing.
CHUNK = 4096
# Grid points that bound the length of a piece, pieces refined per row, samples of a refined piece, and Newton steps.
GRID, REFINED, CUTS, NEWTON = 16, 8, 8, 16

Columns = tuple[Array, ...]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class NearestSolution:
    """The nearest posture of each row.

    Attributes:
        q: Joint angles, ``(*batch, n_joints)`` [rad], exactly within the limits where ``ok``.
        status: :class:`jaxik.Status` as integers, ``(*batch,)``. Where no swivel of any branch is feasible: the reason
            for the nearest posture regardless of limits and keep-out, which is then in ``q``.
        swivel: Swivel of the posture, ``(*batch,)`` [rad].
        branch: Its branch, ``(*batch,)``, 0 to 7.
        motion: Weighted squared joint motion, ``(*batch,)`` [rad²].
    """

    q: Float[Array, "*batch joint"]
    status: Int[Array, "*batch"]
    swivel: Float[Array, "*batch"]
    branch: Int[Array, "*batch"]
    motion: Float[Array, "*batch"]

    @property
    def ok(self) -> Bool[Array, "*batch"]:
        """True where a robot can take the posture: in reach, in limits, elbow outside its keep-out."""
        return self.status <= Status.NEAR_SINGULAR

    def raise_if_invalid(self) -> "Self":
        """Return the solution itself, so that calls chain; for use outside ``jit``.

        Raises:
            UnreachableError: A row has no feasible posture; with the rows and the reason.
        """
        raise_unless_ok(self.status, "no feasible posture")
        return self


def solve_nearest(
    arm: Arm | ArmModel,
    target: TargetLike,
    q_now: Float[ArrayLike, "*batch joint"],
    *,
    weights: Float[ArrayLike, "joint"] | None = None,
) -> NearestSolution:
    """Return the feasible posture on target that takes the least weighted joint motion from the present one.

    It minimizes sum(weights * (q - q_now)²) over every branch and every feasible arc, not over samples of them.

    Args:
        arm: The arm.
        target: A :class:`Pose` or :class:`Pointing` with leading batch axes, as for :func:`solve_ik`.
        q_now: Present joint angles, ``(*batch, n_joints)`` [rad], broadcast against the target.
        weights: Weight of each joint's squared motion, ``(n_joints,)``, not negative; all 1 by default.

    Returns:
        Posture, status, swivel, branch and motion of each row.

    Raises:
        ValueError: Wrong shapes or dtypes, or a :class:`Pose` for a 6-joint arm.

    **Differentiability**: in target, ``q_now``, weights and arm, by the implicit function theorem: at a minimum inside
    an arc from the vanishing derivative, at an end of an arc from the limit that ends it. Where two minima tie the
    derivative is that of the one returned.

    References:
        The paper, section 5: of all elbow positions "the one that is reachable with the least energy".
    """
    return _solve_nearest(as_arm(arm), as_target(target), q_now, weights)


@jax.jit
def _solve_nearest(arm: Arm, target: Target, q_now: ArrayLike, weights: ArrayLike | None) -> NearestSolution:
    target, (q_now,) = check_target(arm, target, q_now)
    check_joints(arm, q_now)
    dtype = q_now.dtype
    weights = jnp.ones(arm.n_joints, dtype) if weights is None else as_floats(weights)[0].astype(dtype)
    if weights.shape != (arm.n_joints,):
        raise ValueError(f"expected weights of shape ({arm.n_joints},), got {weights.shape}")
    batch = batch_shape(target, q_now[..., 0])
    arm = arm.astype(dtype)
    position, directions, _ = target_columns(target, jnp.zeros((), dtype), batch)
    columns = (position, directions, to_batch_last(q_now, batch, 1))
    solved = _in_chunks(lambda *rows: _nearest(arm, weights, *rows), columns)
    return NearestSolution(*(to_batch_first(x, batch) for x in solved))


def _in_chunks(solve: Callable[..., Columns], columns: Columns) -> Columns:
    """Apply a function of batch-last arrays to chunks of the batch, so that memory stays bounded."""
    n = columns[0].shape[-1]
    if n <= CHUNK:
        return solve(*columns)
    chunks = -(-n // CHUNK)

    def split(x: Array) -> Array:
        padded = jnp.concatenate([x, jnp.repeat(x[..., -1:], chunks * CHUNK - n, axis=-1)], axis=-1)
        return jnp.moveaxis(padded.reshape(*x.shape[:-1], chunks, CHUNK), -2, 0)

    solved = jax.lax.map(lambda rows: solve(*rows), jax.tree.map(split, columns))
    return jax.tree.map(lambda x: jnp.moveaxis(x, 0, -2).reshape(*x.shape[1:-1], -1)[..., :n], solved)


class Pieces(NamedTuple):
    """Pieces of the circles of n rows, ``(pieces, n)`` each.

    Attributes:
        start: Begin of each [rad].
        length: Its length [rad].
        branch: Its branch.
    """

    start: Array
    length: Array
    branch: Array


def _nearest(arm: Arm, weights: Array, position: Array, directions: Array, q_now: Array) -> Columns:
    finite = jnp.all(jnp.isfinite(q_now), axis=0)
    q_now = jnp.where(finite, q_now, 0.0)
    motion = self_motion_of_columns(arm, position, directions)
    # Stopped on the way in: derivatives of the search would be compiled only to be dropped.
    swivel, branch = _search(*jax.lax.stop_gradient((weights, motion, q_now)))
    swivel = _implicit(weights, motion.branch(branch), q_now, swivel)
    solutions = closed_form(arm, position, directions, swivel)
    chosen = jnp.arange(8, dtype=branch.dtype)[:, None] == branch
    q = jnp.sum(jnp.where(chosen[:, None], solutions.q, 0.0), axis=0)
    q = _onto_limits(arm, toward(q, q_now, arm.lower[:, None], arm.upper[:, None]))
    inside = jnp.all((q >= arm.lower[:, None]) & (q <= arm.upper[:, None]), axis=0)
    status = jnp.where(branch_bits(branch).elbow, solutions.elbow_status[1], solutions.elbow_status[0])
    status = jnp.maximum(status, jnp.where(inside, jnp.int32(Status.OK), jnp.int32(Status.LIMITS)))
    moved = jnp.sum(weights[:, None] * (q - q_now) ** 2, axis=0)
    return q, jnp.where(finite, status, jnp.int32(Status.NONFINITE_INPUT)), wrap(swivel), branch, moved


def _search(weights: Array, motion: SelfMotion, q_now: Array) -> tuple[Array, Array]:
    """Swivel and branch of least motion, by bounds and refinement."""
    cuts = sort_columns(_cuts(motion, q_now))
    allowed = feasible_between(motion, cuts)
    # Without any feasible piece the limits are left aside; the status will say so.
    allowed = allowed | ~jnp.any(allowed, axis=(0, 1, 2, 3))
    bound = jnp.where(allowed, _bounds(weights, motion, q_now, cuts), jnp.inf)
    pieces, bound = _least(cuts, bound)
    swivel, moved = _refined(weights, motion.branch(pieces.branch), pieces, q_now)
    moved = jnp.where(jnp.isfinite(bound), moved, jnp.inf)
    best = jnp.argmin(moved, axis=0)[None]
    return jnp.take_along_axis(swivel, best, 0)[0], jnp.take_along_axis(pieces.branch, best, 0)[0]


@fused_separately
def _cuts(motion: SelfMotion, q_now: Array) -> Array:
    """Cuts of the circle, ``(cuts, elbow bit, n)`` in (-pi, pi]."""
    floor = tolerances(q_now.dtype).singular
    n = q_now.shape[-1]
    cuts = [borders_of_limits(motion)]
    for entries, first, delta in motion.spherical_joints():
        x, y, z = entries[0], entries[1], entries[2]
        joints = (entries.shape[0] + 1) // 2
        at = q_now[first : first + joints] + jnp.where(jnp.arange(joints)[:, None] == 1, delta, 0.0)
        meets = [jnp.moveaxis(angle_equations(entries, jnp.arange(joints), at[:, None]), 0, 1)]
        turns = [turning_points(x, y)] + ([turning_points(entries[3], entries[4])] if joints == 3 else [])
        # The middle angle turns back where its cosine does.
        turns.append(jnp.stack([jnp.zeros_like(z[0]), z[2], -z[1]]))
        equations = jnp.concatenate([*meets, jnp.stack(turns)])
        cuts.append(merge_leading(roots(jnp.moveaxis(equations, 1, 0), floor)[0], 2))
    grid = jnp.linspace(-jnp.pi, jnp.pi, GRID, endpoint=False, dtype=q_now.dtype)
    cuts.append(jnp.broadcast_to(grid[:, None, None], (GRID, 2, n)))
    return jnp.concatenate(cuts)


@fused_separately
def _bounds(weights: Array, motion: SelfMotion, q_now: Array, cuts: Array) -> Array:
    """Least possible motion on each piece, ``(shoulder bit, wrist bit, cuts, elbow bit, n)``."""
    q = motion.branch(np.array([[0], [2]])).angles(cuts)
    least = jnp.stack([_least_squares(motion.arm, q_now, each) for each in (q, motion.other_solution(q))])
    least = weights[:, None, None, None] * least
    shoulder, elbow, wrist = (jnp.sum(least[:, own], axis=1) for own in (slice(0, 3), slice(3, 4), slice(4, None)))
    return shoulder[:, None] + wrist[None, :] + elbow[0]


def _least_squares(arm: Arm, q_now: Array, q: Array) -> Array:
    """Smaller squared distance at the two ends of each piece, ``(joint, cuts, elbow bit, n)`` [rad²]."""
    lower, upper = (limit[:, None, None, None] for limit in (arm.lower, arm.upper))
    now = q_now[:, None, None]
    off2 = (toward(q, now, lower, upper) - now) ** 2
    return jnp.minimum(off2, jnp.roll(off2, -1, axis=1))


def _least(cuts: Array, bound: Array) -> tuple[Pieces, Array]:
    """The pieces with the smallest bounds, ``(REFINED, n)``, and the bounds."""
    m = len(cuts)
    value, index = jax.lax.top_k(-merge_leading(bound, 1).T, REFINED)
    value, index = -value.T, index.T
    elbow, cut, solution = index % 2, index // 2 % m, index // (2 * m)
    branch = branch_number(solution // 2, elbow, solution % 2).astype(index.dtype)
    starts = jnp.take_along_axis(merge_leading(cuts, 1), cut * 2 + elbow, 0)
    ends = jnp.take_along_axis(merge_leading(following(cuts), 1), cut * 2 + elbow, 0)
    return Pieces(starts, ends - starts, branch), value


def _off(branch: BranchMotion, q: Array, q_now: Array) -> Array:
    """Distance of joint angles ``(joint, *more, n)``, in their turns nearest to the present ones, from these [rad]."""
    lift = (slice(None), *(None,) * (q.ndim - 2))
    now, lower, upper = (x[lift] for x in (q_now, branch.arm.lower[:, None], branch.arm.upper[:, None]))
    return toward(q, now, lower, upper) - now


def _motion(weights: Array, branch: BranchMotion, q_now: Array, swivel: Array) -> Array:
    """Weighted squared joint motion at swivels, ``(*more, n)``."""
    off = _off(branch, branch.angles(swivel), q_now)
    return jnp.tensordot(weights, off * off, axes=1)


def _curved(weights: Array, branch: BranchMotion, q_now: Array, swivel: Array) -> tuple[Array, Array]:
    """First and second derivative of the motion in the swivel."""
    rates = branch.rates(swivel)
    off = _off(branch, rates.q, q_now)
    slope = jnp.tensordot(weights, 2.0 * off * rates.first, axes=1)
    return slope, jnp.tensordot(weights, 2.0 * (rates.first**2 + off * rates.second), axes=1)


def _refined(weights: Array, branch: BranchMotion, pieces: Pieces, q_now: Array) -> tuple[Array, Array]:
    """The least motion on each piece: its best cut, then Newton's method kept inside the neighboring cuts."""
    # Stay off the very ends, which rounding may put on the far side of a limit.
    margin = 16 * float(jnp.finfo(pieces.start.dtype).eps)
    low, length = pieces.start + margin, jnp.maximum(pieces.length - 2 * margin, 0.0)
    fractions = jnp.linspace(0.0, 1.0, CUTS + 1, dtype=low.dtype)
    samples = _motion(weights, branch, q_now, low + fractions[:, None, None] * length)
    best = jnp.argmin(samples, axis=0)
    left = low + length * fractions[jnp.maximum(best - 1, 0)]
    right = low + length * fractions[jnp.minimum(best + 1, CUTS)]
    at_best = low + length * fractions[best]

    def narrow(_: Array, state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        left, right, x = state
        slope, curvature = _curved(weights, branch, q_now, x)
        left, right = jnp.where(slope < 0.0, x, left), jnp.where(slope > 0.0, x, right)
        newton = x - slope / jnp.where(curvature > 0.0, curvature, 1.0)
        good = (curvature > 0.0) & (newton >= left) & (newton <= right)
        return left, right, jnp.where(good, newton, 0.5 * (left + right))

    *_, x = jax.lax.fori_loop(0, NEWTON, narrow, (left, right, at_best))
    candidates = jnp.stack([at_best, x])
    motions = jnp.stack([jnp.min(samples, axis=0), _motion(weights, branch, q_now, x)])
    better = motions[1] < motions[0]
    return jnp.where(better, *candidates[::-1]), jnp.where(better, *motions[::-1])


@fused_separately
def _implicit(weights: Array, branch: BranchMotion, q_now: Array, swivel: Array) -> Array:
    """The same swivel, with the derivative that keeps it the nearest (implicit function theorem)."""
    hold = jax.lax.stop_gradient
    slope, curvature = _curved(weights, branch, q_now, swivel)
    convex = curvature > 0.0
    inside = -(slope - hold(slope)) / hold(jnp.where(convex, curvature, 1.0))

    def room(s: Array) -> Array:
        q = branch.angles(s)
        return branch.room(_off(branch, q, q_now) + q_now, s)

    # At an end of an arc the motion still falls: the constraint with the least room is the one that holds it.
    room_now, rate = jax.jvp(room, (swivel,), (jnp.ones_like(swivel),))
    active = jnp.argmin(jnp.where(hold(rate) == 0.0, jnp.inf, jnp.abs(hold(room_now))), axis=0)[None]
    room_now, rate = (jnp.take_along_axis(x, active, 0)[0] for x in (room_now, rate))
    at_end = -(room_now - hold(room_now)) / hold(jnp.where(rate == 0.0, 1.0, rate))
    # Newton stops where slope / curvature is rounding; a real end leaves far more.
    stationary = convex & (jnp.abs(slope) <= jnp.sqrt(jnp.finfo(slope.dtype).eps) * curvature)
    return swivel + jnp.where(hold(stationary), inside, at_end)


def _onto_limits(arm: Arm, q: Array) -> Array:
    """Put an angle that is on its limit to rounding exactly on it.

    Where an arc ends, rounding of the swivel is divided by the sine of the middle angle of a spherical joint: near an
    alignment the error is a few hundred thousand times as large. 1.5e-9 rad in float64.
    """
    slack = tolerances(q.dtype).near_singular ** 1.5
    low, high = arm.lower[:, None], arm.upper[:, None]
    return jnp.where((q < low) & (q > low - slack), low, jnp.where((q > high) & (q < high + slack), high, q))
