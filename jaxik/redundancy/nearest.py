"""The posture on target that is nearest to where the arm is: least weighted joint motion over all branches and arcs.

1. Cut each elbow's circle where a joint meets a limit, meets its present angle (or the opposite one), or turns back,
   and at a coarse grid. All of these are roots of a + b cos + c sin.
2. On each piece every joint moves one way and stays on one side of its present angle, so the smaller of its distances
   at the two ends is its least: their weighted sum is a true lower bound of the motion on the piece.
3. Refine the pieces with the smallest bounds to a stationary point, all at once, and take the best.

A narrow minimum cannot slip through a grid here: next to a singular posture, where a joint swings by half a turn within
a sliver of the circle, the cuts fall on that sliver.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int

from jaxik.arm import Arm
from jaxik.ik import Status, closed_form, target_columns
from jaxik.numerics import (
    fused_separately,
    merge_leading,
    sincos,
    sort_columns,
    to_batch_first,
    to_batch_last,
    tolerances,
    wrap,
)
from jaxik.redundancy.arcs import borders_of_limits, feasible_between
from jaxik.redundancy.swivel_functions import SwivelFunctions, angle_equations, roots, swivel_functions, triple_angles
from jaxik.targets import Target, as_floats, batch_shape, check_joints, check_target

# Rows solved at once: their pieces fill about 50 MB, and more rows gain nothing.
CHUNK = 4096
# Grid points that bound the length of a piece, pieces refined per row, samples of a refined piece, and Newton steps.
GRID, REFINED, CUTS, NEWTON = 16, 8, 8, 16


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class NearestSolution:
    """The nearest posture of each row.

    Attributes:
        q: Joint angles, ``(*batch, n_joints)`` [rad], exactly within the limits where ``status`` is usable.
        status: :class:`Status` as integers, ``(*batch,)``. Where no swivel of any branch is feasible: what stands
            against the nearest posture with limits and keep-out left aside, which is then in ``q``.
        swivel: ``(*batch,)`` [rad].
        branch: ``(*batch,)``, 0 to 7.
        motion: Weighted squared joint motion, ``(*batch,)`` [rad²].
    """

    q: Float[Array, "*batch joint"]
    status: Int[Array, "*batch"]
    swivel: Float[Array, "*batch"]
    branch: Int[Array, "*batch"]
    motion: Float[Array, "*batch"]


@jax.jit
def solve_nearest(
    arm: Arm,
    target: Target,
    q_now: Float[ArrayLike, "*batch joint"],
    weights: Float[ArrayLike, "joint"] | None = None,
) -> NearestSolution:
    """The feasible posture on target that takes the least weighted joint motion from the present one.

    It minimizes sum(weights * (q - q_now)²) over every branch and every feasible arc, not over samples of them.

    Args:
        arm: The arm.
        target: A :class:`Pose` or :class:`Pointing` with leading batch axes, as for :func:`solve_ik`.
        q_now: Present joint angles, ``(*batch, n_joints)`` [rad], broadcast against the target.
        weights: Price of each joint's motion, ``(n_joints,)``, not negative; all 1 by default.

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
    q, status, swivel, branch, motion = _in_chunks(lambda *rows: _nearest(arm, weights, *rows), columns)
    return NearestSolution(*(to_batch_first(x, batch) for x in (q, status, swivel, branch, motion)))


def _in_chunks(solve, columns):
    """Applies a function of batch-last arrays to chunks of the batch, so that memory stays bounded."""
    n = columns[0].shape[-1]
    if n <= CHUNK:
        return solve(*columns)
    chunks = -(-n // CHUNK)

    def split(x: Array) -> Array:
        padded = jnp.concatenate([x, jnp.repeat(x[..., -1:], chunks * CHUNK - n, axis=-1)], axis=-1)
        return jnp.moveaxis(padded.reshape(*x.shape[:-1], chunks, CHUNK), -2, 0)

    solved = jax.lax.map(lambda rows: solve(*rows), jax.tree.map(split, columns))
    return jax.tree.map(lambda x: jnp.moveaxis(x, 0, -2).reshape(*x.shape[1:-1], -1)[..., :n], solved)


class Piece(NamedTuple):
    """Pieces of one branch's circle with its angle functions; ``rows`` is ``(n,)`` or ``(pieces, n)``."""

    start: Array  # rows [rad]
    length: Array
    shoulder: Array  # entries (5, 3, *rows)
    wrist: Array  # (5 or 3, 3, *rows)
    elbow: Array  # joint 4, rows
    solution: tuple[Array, Array]  # +1 or -1 of shoulder and wrist, rows
    number: Array  # of the branch, rows
    delta: tuple[Array, Array]  # of shoulder and wrist, (1,)
    keep_out: Array  # (half_spaces, 3, n)


def _nearest(arm: Arm, weights: Array, position: Array, directions: Array, q_now: Array) -> tuple[Array, ...]:
    finite = jnp.all(jnp.isfinite(q_now), axis=0)
    q_now = jnp.where(finite, q_now, 0.0)
    f = swivel_functions(arm, position, directions)
    # Stopped on the way in: derivatives of the search would be compiled only to be dropped.
    swivel, number = _search(*jax.lax.stop_gradient((arm, weights, f, q_now)))
    swivel = _follow(arm, weights, _on_branch(f, number), q_now, swivel)
    branches = closed_form(arm, position, directions, swivel)
    chosen = jnp.arange(8, dtype=number.dtype)[:, None] == number
    q = jnp.sum(jnp.where(chosen[:, None], branches.q(), 0.0), axis=0)
    q = _within(arm, toward(arm, q, q_now))
    inside = jnp.all((q >= arm.lower[:, None]) & (q <= arm.upper[:, None]), axis=0)
    status = jnp.where(number // 2 % 2 == 1, branches.elbow_status[1], branches.elbow_status[0])
    status = jnp.maximum(status, jnp.where(inside, jnp.int32(Status.OK), jnp.int32(Status.LIMITS)))
    motion = jnp.sum(weights[:, None] * (q - q_now) ** 2, axis=0)
    return q, jnp.where(finite, status, jnp.int32(Status.NONFINITE_INPUT)), wrap(swivel), number, motion


def _search(arm: Arm, weights: Array, f: SwivelFunctions, q_now: Array) -> tuple[Array, Array]:
    """Swivel and branch of least motion, by bounds and refinement."""
    cuts = sort_columns(_cuts(arm, f, q_now))
    allowed = feasible_between(arm, f, cuts)
    # Without any feasible piece the limits are left aside; the status will say so.
    allowed = allowed | ~jnp.any(allowed, axis=(0, 1, 2, 3))
    bound = jnp.where(allowed, _bounds(arm, weights, f, q_now, cuts), jnp.inf)
    pieces, bound = _least(f, cuts, bound)
    swivel, motion = _refined(arm, weights, pieces, q_now)
    motion = jnp.where(jnp.isfinite(bound), motion, jnp.inf)
    best = jnp.argmin(motion, axis=0)[None]
    return jnp.take_along_axis(swivel, best, 0)[0], jnp.take_along_axis(pieces.number, best, 0)[0]


@fused_separately
def _cuts(arm: Arm, f: SwivelFunctions, q_now: Array) -> Array:
    """Where to cut the circle, ``(cuts, elbow bit, n)`` in (-pi, pi]."""
    floor = tolerances(q_now.dtype).singular
    n = q_now.shape[-1]
    cuts = [borders_of_limits(arm, f)]
    for entries, first, delta in f.triples():
        x, y, z = entries[0], entries[1], entries[2]
        joints = (entries.shape[0] + 1) // 2
        at = q_now[first : first + joints] + jnp.where(jnp.arange(joints)[:, None] == 1, delta, 0.0)
        meets = [jnp.moveaxis(angle_equations(entries, jnp.arange(joints), at[:, None]), 0, 1)]
        turns = [_turning(x, y)] + ([_turning(entries[3], entries[4])] if joints == 3 else [])
        # The middle angle turns where its cosine does.
        turns.append(jnp.stack([jnp.zeros_like(z[0]), z[2], -z[1]]))
        equations = jnp.concatenate([*meets, jnp.stack(turns)])
        cuts.append(merge_leading(roots(jnp.moveaxis(equations, 1, 0), floor)[0], 2))
    grid = jnp.linspace(-jnp.pi, jnp.pi, GRID, endpoint=False, dtype=q_now.dtype)
    cuts.append(jnp.broadcast_to(grid[:, None, None], (GRID, 2, n)))
    return jnp.concatenate(cuts)


def _turning(x: Array, y: Array) -> Array:
    """Coefficients whose roots are where the direction of (x, y) turns back: x y' - y x' = 0."""
    return jnp.stack([x[1] * y[2] - y[1] * x[2], x[0] * y[2] - y[0] * x[2], y[0] * x[1] - x[0] * y[1]])


@fused_separately
def _bounds(arm: Arm, weights: Array, f: SwivelFunctions, q_now: Array, cuts: Array) -> Array:
    """Least possible motion on each piece, ``(shoulder bit, wrist bit, cuts, elbow bit, n)``."""
    sin, cos = sincos(cuts)
    least = []
    for entries, first, delta in f.triples():
        signs = jnp.array([1.0, -1.0], cuts.dtype)[:, None, None, None]
        angles = triple_angles(entries[:, :, None, None], signs, delta, sin, cos)
        total = jnp.zeros((), cuts.dtype)
        for joint, angle in enumerate(angles, start=first):
            off = toward_joint(arm, joint, angle, q_now[joint]) - q_now[joint]
            ends = jnp.minimum(off * off, jnp.roll(off * off, -1, axis=1))
            total = total + weights[joint] * ends
        least.append(total)
    elbow = weights[3] * (toward_joint(arm, 3, f.elbow, q_now[3]) - q_now[3]) ** 2
    return least[0][:, None] + least[1][None, :] + elbow


def _least(f: SwivelFunctions, cuts: Array, bound: Array) -> tuple[Piece, Array]:
    """The pieces with the smallest bounds, ``(REFINED, n)``, and the bounds."""
    m = len(cuts)
    value, index = jax.lax.top_k(-merge_leading(bound, 1).T, REFINED)
    value, index = -value.T, index.T
    elbow = index % 2
    cut = index // 2 % m
    solution = index // (2 * m)
    number = 4 * (solution // 2) + 2 * elbow + solution % 2
    starts = jnp.take_along_axis(merge_leading(cuts, 1), cut * 2 + elbow, 0)
    following = jnp.concatenate([cuts[1:], cuts[:1] + 2 * jnp.pi])
    ends = jnp.take_along_axis(merge_leading(following, 1), cut * 2 + elbow, 0)
    piece = _on_branch(f, number)
    return piece._replace(start=starts, length=ends - starts), value


def _on_branch(f: SwivelFunctions, number: Array) -> Piece:
    """The angle functions of a branch, chosen per row."""
    left = (number // 2 % 2) == 1
    lift = (slice(None),) * 2 + (None,) * (number.ndim - 1)

    def pick(entries: Array) -> Array:
        return jnp.where(left, entries[:, :, 1][lift], entries[:, :, 0][lift])

    dtype = f.elbow.dtype
    zero = jnp.zeros(number.shape, dtype)
    solution = (1.0 - 2.0 * (number // 4).astype(dtype), 1.0 - 2.0 * (number % 2).astype(dtype))
    elbow = jnp.where(left, f.elbow[1], f.elbow[0])
    delta = f.shoulder_delta, f.wrist_delta
    return Piece(zero, zero, pick(f.shoulder), pick(f.wrist), elbow, solution, number, delta, f.keep_out)


def _joints(arm: Arm, p: Piece, q_now: Array, swivel: Array) -> tuple[Array, ...]:
    """Joint angles of pieces at swivels ``(..., *rows)``, in the turn nearest to the present ones."""
    sin, cos = sincos(wrap(swivel))
    shoulder = triple_angles(p.shoulder, p.solution[0], p.delta[0], sin, cos)
    wrist = triple_angles(p.wrist, p.solution[1], p.delta[1], sin, cos)
    angles = (*shoulder, p.elbow, *wrist)
    turned = [toward_joint(arm, j, a, q_now[j]) for j, a in enumerate(angles)]
    if len(turned) < arm.n_joints:  # a pointing target leaves the last of seven joints at rest
        turned.append(jnp.clip(0.0 * arm.lower[6], arm.lower[6], arm.upper[6]) + 0.0 * swivel)
    return tuple(turned)


@fused_separately
def _motion(arm: Arm, weights: Array, p: Piece, q_now: Array, swivel: Array) -> Array:
    """Weighted squared joint motion at swivels, ``(..., *rows)``."""
    joints = _joints(arm, p, q_now, swivel)
    return sum((w * (q - now) ** 2 for w, q, now in zip(weights, joints, q_now, strict=True)), start=0.0 * swivel)


@fused_separately
def _curved(arm: Arm, weights: Array, p: Piece, q_now: Array, swivel: Array) -> tuple[Array, Array]:
    """First and second derivative of the motion in the swivel."""

    def slope(s: Array) -> Array:
        joints, rates = jax.jvp(lambda s: _joints(arm, p, q_now, s), (s,), (jnp.ones_like(s),))
        terms = zip(weights, joints, rates, q_now, strict=True)
        return sum((2.0 * w * (q - now) * rate for w, q, rate, now in terms), start=0.0 * s)

    return jax.jvp(slope, (swivel,), (jnp.ones_like(swivel),))


def _refined(arm: Arm, weights: Array, p: Piece, q_now: Array) -> tuple[Array, Array]:
    """The least motion on each piece: its best cut, then Newton's method kept inside the neighboring cuts."""
    # Stay off the very ends, which rounding may put on the far side of a limit.
    margin = 16 * float(jnp.finfo(p.start.dtype).eps)
    low, length = p.start + margin, jnp.maximum(p.length - 2 * margin, 0.0)
    fractions = jnp.linspace(0.0, 1.0, CUTS + 1, dtype=p.start.dtype)
    samples = _motion(arm, weights, p, q_now, low + fractions[:, None, None] * length)
    best = jnp.argmin(samples, axis=0)
    left = low + length * fractions[jnp.maximum(best - 1, 0)]
    right = low + length * fractions[jnp.minimum(best + 1, CUTS)]
    at_best = low + length * fractions[best]

    def narrow(_: Array, state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        left, right, x = state
        slope, curvature = _curved(arm, weights, p, q_now, x)
        left, right = jnp.where(slope < 0.0, x, left), jnp.where(slope > 0.0, x, right)
        newton = x - slope / jnp.where(curvature > 0.0, curvature, 1.0)
        good = (curvature > 0.0) & (newton >= left) & (newton <= right)
        return left, right, jnp.where(good, newton, 0.5 * (left + right))

    *_, x = jax.lax.fori_loop(0, NEWTON, narrow, (left, right, at_best))
    candidates = jnp.stack([at_best, x])
    motions = jnp.stack([jnp.min(samples, axis=0), _motion(arm, weights, p, q_now, x)])
    better = motions[1] < motions[0]
    return jnp.where(better, *candidates[::-1]), jnp.where(better, *motions[::-1])


@fused_separately
def _follow(arm: Arm, weights: Array, p: Piece, q_now: Array, swivel: Array) -> Array:
    """The same swivel, with the derivative that keeps it the nearest (implicit function theorem)."""
    hold = jax.lax.stop_gradient
    slope, curvature = _curved(arm, weights, p, q_now, swivel)
    convex = curvature > 0.0
    inside = -(slope - hold(slope)) / hold(jnp.where(convex, curvature, 1.0))

    def room(s: Array) -> Array:
        q = jnp.stack(jnp.broadcast_arrays(*_joints(arm, p, q_now, s)))
        a, b, c = jnp.moveaxis(p.keep_out, 1, 0)
        sin, cos = sincos(wrap(s))
        return jnp.concatenate([q - arm.lower[:, None], arm.upper[:, None] - q, a + b * cos + c * sin])

    # At an end of an arc the motion still falls: the constraint with the least room is the one that holds it.
    room_now, rate = jax.jvp(room, (swivel,), (jnp.ones_like(swivel),))
    active = jnp.argmin(jnp.where(hold(rate) == 0.0, jnp.inf, jnp.abs(hold(room_now))), axis=0)[None]
    room_now, rate = (jnp.take_along_axis(x, active, 0)[0] for x in (room_now, rate))
    at_end = -(room_now - hold(room_now)) / hold(jnp.where(rate == 0.0, 1.0, rate))
    # Newton stops where slope / curvature is rounding; a real end leaves far more.
    stationary = convex & (jnp.abs(slope) <= jnp.sqrt(jnp.finfo(slope.dtype).eps) * curvature)
    return swivel + jnp.where(hold(stationary), inside, at_end)


def toward(arm: Arm, q: Array, q_now: Array) -> Array:
    """Each angle in the turn that the limits admit, or of several the nearest to the present one, ``(joints, n)``."""
    return jnp.stack([toward_joint(arm, j, q[j], q_now[j]) for j in range(arm.n_joints)])


def toward_joint(arm: Arm, joint: int, angle: Array, now: Array) -> Array:
    """The same for one joint."""
    turn = 2 * jnp.pi
    low, high = arm.lower[joint], arm.upper[joint]
    # An angle on its lower limit to rounding must not wrap to the far end.
    slack = 1e5 * float(jnp.finfo(angle.dtype).eps)
    only = angle - turn * jnp.floor((angle - low + slack) / turn)
    nearest = angle - turn * jnp.round((angle - now) / turn)
    nearest = jnp.where(nearest > high, nearest - turn, jnp.where(nearest < low, nearest + turn, nearest))
    return jnp.where(high - low >= turn, nearest, only)


def _within(arm: Arm, q: Array) -> Array:
    """An angle on its limit to rounding is put on it.

    Where an arc ends, rounding of the swivel comes out of a triple divided by the sine of its middle angle: near an
    aligned one a few hundred thousand times as large. 1.5e-9 rad in float64.
    """
    slack = tolerances(q.dtype).near_singular ** 1.5
    low, high = arm.lower[:, None], arm.upper[:, None]
    return jnp.where((q < low) & (q > low - slack), low, jnp.where((q > high) & (q < high + slack), high, q))
