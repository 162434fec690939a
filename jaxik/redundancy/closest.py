"""The posture that comes closest to a target which limits, reach or the keep-out forbid.

1. A target that can be reached is, exactly: by :func:`solve_nearest`.
2. Else descend by Newton's method in the box of the limits from points spread over it.
3. The lowest of the minima found is the answer, elbow and body moved out of what rounding left them in. Its derivative
   follows from the implicit function theorem.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from jaxik.arm import Arm, ArmModel, as_arm
from jaxik.errors import ArmClassError
from jaxik.ik import Residual, Status, raise_unless_ok, replace_bad_rows, residual, target_columns
from jaxik.kinematics import carry_axes
from jaxik.numerics import sincos, to_batch_first, to_batch_last, tolerances
from jaxik.obstacles import World, columns_of, in_columns, in_rows, in_world
from jaxik.redundancy.closest_search import Goal, Minimum, descend, move_out, overlaps, slope
from jaxik.redundancy.nearest import solve_nearest
from jaxik.redundancy.parameter_nearest import has_swivel
from jaxik.targets import Target, TargetLike, as_array, as_target, check_joints, check_target

if TYPE_CHECKING:
    from typing import Self

# Starts spread over the ranges. Of 200 targets of the paper's arm one ended higher than with 96 random starts: 0.7 %.
STARTS = 32
# Rows searched at once: their descents fill about 40 MB, and more rows gain nothing.
CHUNK = 256


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ClosestSolution:
    """The closest posture of each row.

    Attributes:
        q: Joint angles, ``(*batch, n_joints)`` [rad], exactly within the limits.
        status: :class:`jaxik.Status` of the target as integers, ``(*batch,)``: OK or NEAR_SINGULAR where it is reached;
            else what forbids it: LIMITS, KEEP_OUT, COLLISION, OUT_OF_REACH, UNSOLVED (of an arm solved by refinement),
            or a bad row, whose ``q`` is the present posture.
        residual: Distance left to the target, ``(*batch,)`` in meters and radians.
        cost: Weighted sum of the squares of what is left, ``(*batch,)``; see :func:`solve_closest`.
        held: True for joints whose limit keeps them from coming closer, ``(*batch, n_joints)``.
        elbow_held: True where the keep-out does, ``(*batch,)``.
        body_held: True where an obstacle does, or the body itself, ``(*batch,)``.
    """

    q: Float[Array, "*batch joint"]
    status: Int[Array, "*batch"]
    residual: Residual
    cost: Float[Array, "*batch"]
    held: Bool[Array, "*batch joint"]
    elbow_held: Bool[Array, "*batch"]
    body_held: Bool[Array, "*batch"]

    @property
    def ok(self) -> Bool[Array, "*batch"]:
        """True where the target itself is reached."""
        return self.status <= Status.NEAR_SINGULAR

    def raise_if_invalid(self) -> "Self":
        """Return the solution itself, so that calls chain; for use outside ``jit``.

        Raises:
            UnreachableError: A row does not reach its target; with the rows and the reason.
        """
        raise_unless_ok(self.status, "no posture on them")
        return self


def solve_closest(
    arm: Arm | ArmModel,
    target: TargetLike,
    q_now: Float[ArrayLike, "*batch joint"] | None = None,
    *,
    weights: Float[ArrayLike, "2"] | Sequence[float] | None = None,
    world: World | None = None,
) -> ClosestSolution:
    """Return the posture within limits and keep-out, and clear of obstacles, whose tool comes closest to a target.

    A target that can be reached is reached exactly, with the least joint motion from ``q_now`` (:func:`solve_nearest`).
    Else the posture minimizes ``weights[0] * d² + weights[1] * 4 sin²(angle / 2)`` with d the distance of the tool
    point [m] and the angle between the rotations, or between the directions of a pointing target; 4 sin²(angle / 2) is
    the squared angle where it is small. It is the lowest of the minima found from 32 starts, not proved to be the
    least.

    Args:
        arm: The arm.
        target: A :class:`Pose` or :class:`Pointing` with leading batch axes, as for :func:`solve_ik`.
        q_now: Present joint angles, ``(*batch, n_joints)`` [rad], broadcast against the target; the middle of the
            ranges by default.
        weights: Weights of the squared distance [1/m²] and angle [1/rad²], ``(2,)``, not negative. By default
            ``(1 / arm.length², 1)``: a radian counts as an arm length.
        world: Obstacles, for an arm with a body (:func:`jaxik.with_body`); its batch axes, one world per row, broadcast
            too. If every posture found collides, the one returned does: :func:`jaxik.clearance` tells.

    Returns:
        Posture, status, what is left, and the joints whose limits are in the way.

    Raises:
        ValueError: Wrong shapes or dtypes, or a :class:`Pose` for a 6-joint arm; a world for an arm without a body.

    **Differentiability**: in target, arm, world and weights by the implicit function theorem, joints at their limits
    moving with these. Where a self-motion leaves the distance as it is, the derivative is that of the least joint
    motion. Where another minimum becomes the lowest, or a joint just meets its limit, it is that of the posture
    returned.

    References:
        J. Nocedal, S. Wright, "Numerical Optimization", 2nd ed., 2006, sections 16.7 (boxes) and 17.3 (multipliers).

    Example:
        >>> import jaxik
        >>> model = jaxik.presets.iiwa7()
        >>> far = jaxik.Pose.from_quaternion([2.0, 0.0, 0.4], wxyz=[1.0, 0.0, 0.0, 0.0])
        >>> closest = solve_closest(model, far, weights=[1.0, 0.01])
        >>> jaxik.Status(int(closest.status)).name, bool(closest.residual.position > 0.5)
        ('OUT_OF_REACH', True)
    """
    arm, target = in_world(as_arm(arm, any_class=True), world), as_target(target)
    if arm.surroundings is not None and not has_swivel(arm):
        raise ArmClassError(
            f"S-R-S arms only are kept clear of obstacles here, so far; got a {arm.kinematic_class} arm with a body: "
            "leave it out, and look with jaxik.clearance"
        )
    if q_now is not None:
        q_now = as_array(f"q_now of shape (*batch, {arm.n_joints})", q_now)
    if weights is not None:
        weights = jnp.asarray(as_array("weights of shape (2,)", weights))
        if weights.shape != (2,):
            raise ValueError(f"expected weights of shape (2,), for distance and angle, got {weights.shape}")
    return _solve_closest(arm, target, q_now, weights)


@jax.jit
def _solve_closest(arm: Arm, target: Target, q_now: ArrayLike | None, weights: ArrayLike | None) -> ClosestSolution:
    target, others = check_target(arm, target, *(x for x in (q_now, weights) if x is not None))
    dtype = target.position.dtype
    arm = arm.astype(dtype)
    q_now = 0.5 * (arm.lower + arm.upper) if q_now is None else others[0]
    weights = jnp.stack([1.0 / arm.length**2, jnp.ones((), dtype)]) if weights is None else others[-1]
    check_joints(arm, q_now)
    nearest = solve_nearest(arm, target, q_now)
    batch = nearest.status.shape
    position, directions, zeros = target_columns(target, jnp.zeros((), dtype), batch)
    now, reached = (to_batch_last(x, batch, 1) for x in (q_now, nearest.q))
    status = to_batch_last(nearest.status, batch, 0)
    checked = replace_bad_rows(arm, position, directions, zeros)
    columns = checked.directions.shape[1]
    turn_weight = jnp.broadcast_to(weights[1] / (2.0 if columns == 3 else 1.0), (columns,))
    distance_weights = jnp.concatenate([weights[:1], turn_weight])
    total = weights[0] * arm.length**2 + weights[1]
    goal = Goal(checked.position, checked.directions, distance_weights / jnp.where(total > 0.0, total, 1.0))
    # The keep-out with a margin for rounding, so that whoever computes the elbow finds it outside.
    eps = float(jnp.finfo(dtype).eps)
    margin = 16.0 * eps * (arm.length + jnp.sqrt(jnp.sum(arm.shoulder**2)))
    keep_out = dataclasses.replace(arm.keep_out, offset=arm.keep_out.offset - margin)
    tight = dataclasses.replace(arm, keep_out=keep_out)
    if arm.surroundings is not None:
        around = arm.surroundings.grown(margin)
        tight = in_columns(dataclasses.replace(tight, surroundings=around), columns_of(around.world, batch))

    forbidden = (status > Status.NEAR_SINGULAR) & (status < Status.INVALID_TARGET)
    found = _search_rows(*jax.lax.stop_gradient((tight, goal, forbidden)))
    noise = 1e3 * eps
    low = forbidden & (found.q <= arm.lower[:, None]) & (found.gradient > noise)
    high = forbidden & (found.q >= arm.upper[:, None]) & (found.gradient < -noise)
    half_spaces = len(arm.keep_out.offset)
    elbow_held = forbidden & jnp.any(found.multiplier[:half_spaces] > noise, axis=0)
    body_held = forbidden & jnp.any(found.multiplier[half_spaces:] > noise, axis=0)
    kept = jnp.clip(jnp.where(jnp.isfinite(now), now, 0.0), arm.lower[:, None], arm.upper[:, None])
    closest = _implicit(tight, goal, found.q, found.multiplier, low, high)
    q = jnp.where(forbidden, closest, jnp.where(status <= Status.NEAR_SINGULAR, reached, kept))
    # A reached target is left by rounding at most; multipliers leave half the digits.
    most = jnp.where(forbidden, eps**0.5, jnp.where(status <= Status.NEAR_SINGULAR, tolerances(dtype).limit, 0.0))
    still = jax.lax.stop_gradient(q)
    q = move_out(jax.lax.stop_gradient(tight), still, most.astype(dtype)) + (q - still)
    off, turn = (x[0] for x in residual(arm, q[None], position, directions))
    if not has_swivel(arm):  # where the grid of parameters has overlooked a posture, a descent may come upon it
        hit = forbidden & (off <= tolerances(dtype).target * arm.length) & (turn <= tolerances(dtype).target)
        status = jnp.where(hit, jnp.int32(Status.OK), status)
    cost = weights[0] * off**2 + 4.0 * weights[1] * jnp.sin(0.5 * turn) ** 2
    q, status, off, turn, cost, held, elbow_held, body_held = (
        to_batch_first(x, batch) for x in (q, status, off, turn, cost, low | high, elbow_held, body_held)
    )
    return ClosestSolution(q, status, Residual(off, turn), cost, held, elbow_held, body_held)


def _search_rows(arm: Arm, goal: Goal, wanted: Array) -> Minimum:
    """The lowest minimum found of each wanted row, chunk by chunk; others are searched only to fill the last chunk."""
    n, size = len(wanted), min(CHUNK, len(wanted))
    order, count = jnp.argsort(~wanted, stable=True), jnp.sum(wanted, dtype=jnp.int32)

    def of_chunk(begin: Array) -> tuple[Array, Minimum]:
        rows = jax.lax.dynamic_slice(order, (begin,), (size,))
        own = in_rows(arm, lambda x: x[..., rows])
        return rows, _search(own, Goal(goal.position[..., rows], goal.directions[..., rows], goal.weights))

    def chunk(carried: tuple[Array, Minimum]) -> tuple[Array, Minimum]:
        begin, found = carried
        rows, some = of_chunk(begin)
        return begin + size, jax.tree.map(lambda x, y: x.at[..., rows].set(y), found, some)

    shapes = jax.eval_shape(of_chunk, count)[1]
    found = jax.tree.map(lambda x: jnp.zeros((*x.shape[:-1], n), x.dtype), shapes)
    return jax.lax.while_loop(lambda c: c[0] < count, chunk, (jnp.zeros((), jnp.int32), found))[1]


def _search(arm: Arm, goal: Goal) -> Minimum:
    """The lowest minimum found of each row."""
    n = goal.position.shape[-1]
    goal = Goal(jnp.tile(goal.position, STARTS), jnp.tile(goal.directions, STARTS), goal.weights)
    arm = in_rows(arm, lambda x: jnp.tile(x, STARTS))
    found = descend(arm, goal, jnp.repeat(_spread(arm), n, axis=1))
    # The first of equal minima, so that rounding does not choose. If no posture keeps the elbow out, all are infinite.
    cost = found.cost.reshape(STARTS, n)
    least = jnp.min(cost, axis=0)
    equal = 64.0 * float(jnp.finfo(cost.dtype).eps) * (1.0 + least)
    rows = n * jnp.argmax(cost <= least + equal, axis=0) + jnp.arange(n)
    return jax.tree.map(lambda x: x[..., rows], found)


def _spread(arm: Arm) -> Array:
    """Points spread over the box of the limits, a turn of joints without any, ``(joint, STARTS)``.

    Multiples of the inverse powers of the root of x^(joints + 1) = x + 1: M. Roberts, "The unreasonable effectiveness
    of quasirandom sequences", 2018.
    """
    joints = arm.n_joints
    root = 1.0
    for _ in range(40):
        root = (1.0 + root) ** (1.0 / (joints + 1))
    at = (0.5 + np.arange(1, STARTS + 1) * root ** -np.arange(1.0, joints + 1)[:, None]) % 1.0
    middle, half = 0.5 * (arm.lower + arm.upper), jnp.minimum(0.5 * (arm.upper - arm.lower), jnp.pi)
    return middle[:, None] + half[:, None] * jnp.asarray(2.0 * at - 1.0, half.dtype)


def _bent_overlaps(arm: Arm, q: Array) -> Array:
    """Second derivatives of the body's overlaps, ``(M + 1, joint, joint, n)``."""

    def slopes(q: Array) -> Array:
        points, _, axes = carry_axes(arm, *sincos(q), arm.tool_rotation[:, :0])
        return overlaps(arm, q, points, axes)[1]

    seeds = jnp.broadcast_to(jnp.eye(len(q), dtype=q.dtype)[..., None], (len(q), *q.shape))
    return jnp.moveaxis(jax.vmap(lambda seed: jax.jvp(slopes, (q,), (seed,))[1])(seeds), 0, 2)


@jax.custom_jvp
def _implicit(arm: Arm, goal: Goal, q: Array, multiplier: Array, low: Array, high: Array) -> Array:
    """The same joint angles, with the derivative that keeps them the closest (implicit function theorem)."""
    del arm, goal, multiplier, low, high
    return q


@_implicit.defjvp
def _implicit_jvp(primals: tuple, tangents: tuple) -> tuple[Array, Array]:
    """One step of Newton's method on the conditions of a minimum.

    Held joints stay on their limits, and the active half-spaces are equations. The system is singular where a
    self-motion is free: then the least step.
    """
    arm, goal, q, multiplier, low, high = primals
    arm_rate, goal_rate = tangents[:2]
    held, active = low | high, multiplier > 0.0
    limit_rate = jnp.where(low, arm_rate.lower[:, None], jnp.where(high, arm_rate.upper[:, None], 0.0))
    at, rate = jax.jvp(slope, (arm, goal, q), (arm_rate, goal_rate, limit_rate))
    pulled = rate.gradient + jnp.sum(multiplier[:, None] * rate.depth_gradient, axis=0)
    wanted = jnp.concatenate([jnp.where(held, 0.0, pulled), jnp.where(active, rate.depth, 0.0)])

    bent = at.depth_hessian
    if arm.surroundings is not None:
        bent = jnp.concatenate([bent, _bent_overlaps(arm, q)])
    hessian = at.hessian + jnp.sum(multiplier[:, None, None] * bent, axis=0)
    slopes, fixed = at.depth_gradient, jnp.concatenate([held, ~active])
    system = jnp.concatenate(
        [
            jnp.concatenate([hessian, jnp.swapaxes(slopes, 0, 1)], axis=1),
            jnp.concatenate([slopes, jnp.zeros((len(slopes), *slopes.shape[::2]), q.dtype)], axis=1),
        ]
    )
    system = jnp.where(fixed[:, None] | fixed[None], jnp.eye(len(fixed), dtype=q.dtype)[..., None], system)
    values, vectors = jnp.linalg.eigh(jnp.moveaxis(jax.lax.stop_gradient(system), -1, 0))
    size = jnp.abs(values)
    regular = size > jnp.sqrt(jnp.finfo(q.dtype).eps) * jnp.max(size, axis=-1, keepdims=True)
    inverse = jnp.where(regular, 1.0 / jnp.where(regular, values, 1.0), 0.0)
    step = jnp.einsum("nij,nj,nkj,kn->in", vectors, inverse, vectors, wanted)[: len(q)]
    return q, jnp.where(held, limit_rate, -step)
