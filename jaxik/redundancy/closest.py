"""The posture that comes closest to a target which limits, reach or the keep-out forbid.

1. A target that can be reached is, exactly: by :func:`solve_nearest`.
2. Else start from the closed form, its eight branches at a grid of swivels, put onto their limits, of which the best of
   every branch and sector descend by Newton's method in the box of the limits; and from points spread over the box.
3. The lowest of the minima found is the answer. Its derivative follows from the implicit function theorem.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from jaxik.arm import Arm, ArmModel, as_arm
from jaxik.ik import Residual, Status, closed_form, raise_unless_ok, replace_bad_rows, residual, target_columns
from jaxik.numerics import to_batch_first, to_batch_last
from jaxik.redundancy.branch_motion import near_range
from jaxik.redundancy.closest_search import PENALTY, Goal, Slope, descend, slope
from jaxik.redundancy.nearest import solve_nearest
from jaxik.targets import Target, TargetLike, as_array, as_target, check_joints, check_target

if TYPE_CHECKING:
    from typing import Self

# Swivels per branch that are tried; sectors of the circle whose best descends, in every branch; and starts spread over
# the ranges. With these no target of 600 ended higher than the best of 100 random starts; half the starts miss a few.
SWIVELS, SECTORS, SPREAD = 24, 3, 16


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ClosestSolution:
    """The closest posture of each row.

    Attributes:
        q: Joint angles, ``(*batch, n_joints)`` [rad], exactly within the limits.
        status: :class:`jaxik.Status` of the target as integers, ``(*batch,)``: OK or NEAR_SINGULAR where it is reached;
            else what forbids it: LIMITS, KEEP_OUT, OUT_OF_REACH, or a bad row, whose ``q`` is the present posture.
        residual: Distance left to the target, ``(*batch,)`` in meters and radians.
        cost: Weighted sum of the squares of what is left, ``(*batch,)``; see :func:`solve_closest`.
        held: True for joints whose limit keeps them from coming closer, ``(*batch, n_joints)``.
        elbow_held: True where the keep-out does, ``(*batch,)``.
    """

    q: Float[Array, "*batch joint"]
    status: Int[Array, "*batch"]
    residual: Residual
    cost: Float[Array, "*batch"]
    held: Bool[Array, "*batch joint"]
    elbow_held: Bool[Array, "*batch"]

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
) -> ClosestSolution:
    """Return the posture within limits and keep-out whose tool comes closest to a target.

    A target that can be reached is reached exactly, with the least joint motion from ``q_now`` (:func:`solve_nearest`).
    Else the posture minimizes ``weights[0] * d² + weights[1] * 4 sin²(angle / 2)`` with d the distance of the tool
    point [m] and the angle between the rotations, or between the directions of a pointing target; 4 sin²(angle / 2) is
    the squared angle where it is small. It is the lowest of the minima found from 40 starts, not proved to be the
    least.

    Args:
        arm: The arm.
        target: A :class:`Pose` or :class:`Pointing` with leading batch axes, as for :func:`solve_ik`.
        q_now: Present joint angles, ``(*batch, n_joints)`` [rad], broadcast against the target; the middle of the
            ranges by default.
        weights: Weights of the squared distance [1/m²] and angle [1/rad²], ``(2,)``, not negative. By default
            ``(1 / arm.length², 1)``: a radian counts as an arm length.

    Returns:
        Posture, status, what is left, and the joints whose limits are in the way.

    Raises:
        ValueError: Wrong shapes or dtypes, or a :class:`Pose` for a 6-joint arm.

    **Differentiability**: in target, arm and ``weights`` by the implicit function theorem, joints at their limits
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
    arm, target = as_arm(arm), as_target(target)
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
    goal = Goal(checked.position, checked.directions, jnp.concatenate([weights[:1], turn_weight]))

    q, multiplier = _search(*jax.lax.stop_gradient((arm, goal)))
    at = slope(arm, goal, q)
    gradient = at.gradient + jnp.sum(multiplier[:, None] * at.depth_gradient, axis=0)
    noise = 1e3 * float(jnp.finfo(dtype).eps) * (weights[0] * arm.length**2 + weights[1])
    low, high = (q <= arm.lower[:, None]) & (gradient > noise), (q >= arm.upper[:, None]) & (gradient < -noise)
    forbidden = (status > Status.NEAR_SINGULAR) & (status < Status.INVALID_TARGET)
    q = _implicit(arm, at, q, multiplier, low, high)
    kept = jnp.clip(jnp.where(jnp.isfinite(now), now, 0.0), arm.lower[:, None], arm.upper[:, None])
    q = jnp.where(forbidden, q, jnp.where(status <= Status.NEAR_SINGULAR, reached, kept))
    off, turn = (x[0] for x in residual(arm, q[None], position, directions))
    cost = weights[0] * off**2 + 4.0 * weights[1] * jnp.sin(0.5 * turn) ** 2
    held, elbow_held = forbidden & (low | high), forbidden & jnp.any(multiplier > noise, axis=0)
    q, status, off, turn, cost, held, elbow_held = (
        to_batch_first(x, batch) for x in (q, status, off, turn, cost, held, elbow_held)
    )
    return ClosestSolution(q, status, Residual(off, turn), cost, held, elbow_held)


def _search(arm: Arm, goal: Goal) -> tuple[Array, Array]:
    """Joint angles ``(joint, n)`` of the lowest minimum found, and the multipliers of the half-spaces there."""
    n = goal.position.shape[-1]
    starts = jnp.concatenate([_from_closed_form(arm, goal), _spread(arm, n)], axis=1)
    q, multiplier, cost = descend(arm, _repeated(goal, starts.shape[1]), starts.reshape(len(starts), -1))
    cost = cost.reshape(starts.shape[1], n)
    # If no posture keeps the elbow out, all are infinite, and the first is as good as any.
    best = jnp.argmin(cost, axis=0)[None, None]
    pick = lambda x: jnp.take_along_axis(x.reshape(len(x), len(cost), n), best, axis=1)[:, 0]  # noqa: E731
    return pick(q), pick(multiplier)


def _from_closed_form(arm: Arm, goal: Goal) -> Array:
    """The best of each branch and sector of swivels, ``(joint, 8 * SECTORS, n)``, each within the limits."""
    n = goal.position.shape[-1]
    many = _repeated(goal, SWIVELS)
    swivel = jnp.linspace(-jnp.pi, jnp.pi, SWIVELS, endpoint=False, dtype=many.position.dtype)
    q = closed_form(arm, many.position, many.directions, jnp.repeat(swivel, n)).q
    lower, upper = arm.lower[:, None], arm.upper[:, None]
    q = jnp.clip(near_range(arm, jnp.moveaxis(q, 1, 0).reshape(arm.n_joints, -1)), lower, upper)
    at = slope(arm, _repeated(goal, 8 * SWIVELS), q)
    cost = at.cost + PENALTY * jnp.sum(jnp.maximum(at.depth, 0.0) ** 2, axis=0)
    cost, q = cost.reshape(8 * SECTORS, -1, n), q.reshape(arm.n_joints, 8 * SECTORS, -1, n)
    best = jnp.argmin(cost, axis=1)[None, :, None]
    return jnp.take_along_axis(q, best, axis=2)[:, :, 0]


def _spread(arm: Arm, n: int) -> Array:
    """Points spread over the box of the limits, a turn of joints without any, ``(joint, SPREAD, n)``.

    Multiples of the inverse powers of the root of x^(joints + 1) = x + 1: M. Roberts, "The unreasonable effectiveness
    of quasirandom sequences", 2018.
    """
    joints = arm.n_joints
    root = 1.0
    for _ in range(40):
        root = (1.0 + root) ** (1.0 / (joints + 1))
    at = (0.5 + np.arange(1, SPREAD + 1) * root ** -np.arange(1.0, joints + 1)[:, None]) % 1.0
    middle, half = 0.5 * (arm.lower + arm.upper), jnp.minimum(0.5 * (arm.upper - arm.lower), jnp.pi)
    points = middle[:, None] + half[:, None] * jnp.asarray(2.0 * at - 1.0, half.dtype)
    return jnp.broadcast_to(points[:, :, None], (joints, SPREAD, n))


def _repeated(goal: Goal, times: int) -> Goal:
    """The targets several times over, one block after the other."""
    return Goal(jnp.tile(goal.position, times), jnp.tile(goal.directions, times), goal.weights)


def _implicit(arm: Arm, at: Slope, q: Array, multiplier: Array, low: Array, high: Array) -> Array:
    """The same joint angles, with the derivative that keeps them the closest (implicit function theorem).

    One step of Newton's method on the conditions of a minimum, with the held joints on their limits and the active
    half-spaces as equations. Their system is singular where a self-motion is free: then the least step.
    """
    hold = jax.lax.stop_gradient
    held, active = low | high, multiplier > 0.0
    limit = jnp.where(low, arm.lower[:, None], jnp.where(high, arm.upper[:, None], hold(q)))
    change = limit - hold(limit)
    hessian = hold(at.hessian + jnp.sum(multiplier[:, None, None] * at.depth_hessian, axis=0))
    slopes = hold(at.depth_gradient)
    gradient = at.gradient + jnp.sum(hold(multiplier)[:, None] * at.depth_gradient, axis=0)
    pulled = gradient + jnp.sum(hessian * change[None], axis=1)
    pushed = at.depth + jnp.sum(slopes * change[None], axis=1)
    wanted = jnp.concatenate([jnp.where(held, 0.0, pulled), jnp.where(active, pushed, 0.0)])
    fixed = jnp.concatenate([held, ~active])
    system = jnp.concatenate(
        [
            jnp.concatenate([hessian, jnp.swapaxes(slopes, 0, 1)], axis=1),
            jnp.concatenate([slopes, jnp.zeros((len(slopes), *slopes.shape[::2]), q.dtype)], axis=1),
        ]
    )
    system = jnp.where(fixed[:, None] | fixed[None], jnp.eye(len(fixed), dtype=q.dtype)[..., None], system)
    values, vectors = jnp.linalg.eigh(jnp.moveaxis(system, -1, 0))
    size = jnp.abs(values)
    regular = size > jnp.sqrt(jnp.finfo(q.dtype).eps) * jnp.max(size, axis=-1, keepdims=True)
    inverse = hold(jnp.where(regular, 1.0 / jnp.where(regular, values, 1.0), 0.0))
    vectors = hold(vectors)
    step = jnp.einsum("nij,nj,nkj,kn->in", vectors, inverse, vectors, wanted - hold(wanted))[: len(q)]
    return jnp.where(held, limit, hold(q) - step)
