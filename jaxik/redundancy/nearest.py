"""The posture on target that is nearest to the present one: least weighted joint motion over all branches and arcs."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from jaxik.arm import Arm, ArmModel, as_arm
from jaxik.ik import Branches, Status, branch_bits, closed_form, over_targets, raise_unless_ok, target_columns
from jaxik.numerics import fused_separately, principal, to_batch_first, to_batch_last, tolerances, with_value, wrap
from jaxik.obstacles import World, columns_of, in_columns, in_world, moves
from jaxik.redundancy.alignment import with_split
from jaxik.redundancy.branch_motion import BranchMotion
from jaxik.redundancy.nearest_search import nearest_posture
from jaxik.redundancy.nearness import TURN, within_a_turn
from jaxik.redundancy.parameter_nearest import check_nearest, has_swivel, nearest_by_parameter
from jaxik.redundancy.self_motion import self_motion_of_columns
from jaxik.targets import Target, TargetLike, as_array, as_floats, as_target, batch_shape, check_joints, check_target

if TYPE_CHECKING:
    from typing import Self

# Rows solved at once: under a trace, and by each thread outside of one. The pieces of a row fill 35 kB, and memory of
# more than 32 MB is allocated anew for every call, which costs a page fault for every 4 kB.
CHUNK = 4096
THREAD_CHUNK = 512

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
    world: World | None = None,
) -> NearestSolution:
    """Return the feasible posture on target that takes the least weighted joint motion from the present one.

    It minimizes sum(weights * (q - q_now)²) over every branch and every feasible arc, not over samples of them. For
    arms of other classes than S-R-S there is no proof: the descents begin at the present posture and at samples of the
    redundancy parameter, and of targets far away a few per cent have a nearer posture still.

    Args:
        arm: The arm.
        target: A :class:`Pose` or :class:`Pointing` with leading batch axes, as for :func:`solve_ik`.
        q_now: Present joint angles, ``(*batch, n_joints)`` [rad], broadcast against the target.
        weights: Weight of each joint's squared motion, ``(n_joints,)``, not negative; all 1 by default.
        world: Obstacles, for an arm with a body (:func:`jaxik.with_body`), which the posture keeps clear of; its batch
            axes, one world per row, broadcast too. The way to the posture is not examined.

    Returns:
        Posture, status, swivel, branch and motion of each row. At an aligned shoulder or wrist every split of the turn
        between its outer joints is on target, and the nearest of all is returned: :func:`solve_ik` at that swivel has
        another split. A bad target leaves the arm where it is.

    Raises:
        ValueError: Wrong shapes or dtypes, or a :class:`Pose` for a 6-joint arm.

    **Differentiability**: in target, ``q_now``, weights and arm, by the implicit function theorem: at a minimum inside
    an arc from the vanishing derivative, at an end of an arc from the limit that ends it. Where two minima tie the
    derivative is that of the one returned.

    References:
        The paper, section 5: of all elbow positions "the one that is reachable with the least energy".
    """
    weights = None if weights is None else as_array("weights of shape (joint,)", weights)
    q_now = as_array("q_now of shape (*batch, joint)", q_now)
    arm, target = in_world(as_arm(arm, any_class=True), world), as_target(target)
    check_nearest(arm, target)
    if moves(arm):  # the rows of the world would have to be in the chunks too
        return NearestSolution(*_solve_nearest(arm, target, q_now, weights))
    solved = over_targets(_solve_nearest, arm, target, q_now, rank=1, fixed=(weights,), chunk=THREAD_CHUNK)
    return NearestSolution(*solved)


@jax.jit
def _solve_nearest(arm: Arm, target: Target, q_now: ArrayLike, weights: ArrayLike | None) -> Columns:
    """Fields of the solution."""
    target, (q_now,) = check_target(arm, target, q_now)
    check_joints(arm, q_now)
    dtype = q_now.dtype
    weights = jnp.ones(arm.n_joints, dtype) if weights is None else as_floats(weights)[0].astype(dtype)
    if weights.shape != (arm.n_joints,):
        raise ValueError(f"expected weights of shape ({arm.n_joints},), got {weights.shape}")
    batch, rows = batch_shape(target, q_now[..., 0]), ()
    arm = arm.astype(dtype)
    if moves(arm):
        batch = np.broadcast_shapes(batch, arm.surroundings.world.batch)
        rows = columns_of(arm.surroundings.world, batch).tree_flatten()[0]
    position, directions, _ = target_columns(target, jnp.zeros((), dtype), batch)
    columns = (position, directions, to_batch_last(q_now, batch, 1), *rows)
    solved = _in_chunks(lambda *rows: _nearest(arm, weights, *rows), columns)
    return tuple(to_batch_first(x, batch) for x in solved)


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


def _nearest(arm: Arm, weights: Array, position: Array, directions: Array, q_now: Array, *world: Array) -> Columns:
    if not has_swivel(arm):
        if arm.surroundings is not None:
            around = World.tree_unflatten(None, world) if world else columns_of(arm.surroundings.world, ())
            arm = in_columns(arm, around)
        return nearest_by_parameter(arm, weights, position, directions, q_now)
    finite = jnp.all(jnp.isfinite(q_now), axis=0)
    q_now = jnp.where(finite, q_now, 0.0)
    motion = self_motion_of_columns(arm, position, directions, World.tree_unflatten(None, world) if world else None)
    near = within_a_turn(q_now, weights, arm.lower[:, None], arm.upper[:, None])
    # Stopped on the way in: derivatives of the search would be compiled only to be dropped.
    found = nearest_posture(*jax.lax.stop_gradient((motion, near)))
    branch = motion.branch(found.branch)
    posture = jax.lax.stop_gradient(q_now) + found.off
    swivel = with_value(_implicit(weights, branch, q_now, found.swivel, posture), found.swivel)
    solutions = closed_form(arm, position, directions, swivel)
    q = _in_branch(solutions, found.branch)
    q = _onto_limits(arm, with_split(q + TURN * jnp.round((posture - q) / TURN), posture))
    inside = jnp.all((q >= arm.lower[:, None]) & (q <= arm.upper[:, None]), axis=0)
    status = jnp.where(branch_bits(found.branch).elbow, solutions.elbow_status[1], solutions.elbow_status[0])
    status = jnp.maximum(status, jnp.where(inside, jnp.int32(Status.OK), jnp.int32(Status.LIMITS)))
    if branch.free is not None:
        slack = tolerances(swivel.dtype).limit  # at the end of an arc, the swivel is there to rounding
        clear = branch.free.contain(principal(swivel), slack)
        status = jnp.maximum(status, jnp.where(clear, jnp.int32(Status.OK), jnp.int32(Status.COLLISION)))
    # A bad row is no reason to move.
    stay = jnp.clip(jax.lax.stop_gradient(q_now), arm.lower[:, None], arm.upper[:, None])
    q = jnp.where((status >= Status.INVALID_TARGET) & finite, stay, q)
    moved = jnp.sum(weights[:, None] * (q - q_now) ** 2, axis=0)
    return q, jnp.where(finite, status, jnp.int32(Status.NONFINITE_INPUT)), wrap(swivel), found.branch, moved


@fused_separately
def _in_branch(solutions: Branches, branch: Array) -> Array:
    """Joint angles ``(joint, n)`` of one branch per row [rad]."""
    bits = branch_bits(branch)

    def one(pair: Array, bit: ArrayLike) -> Array:
        return jnp.where(bit, pair[1], pair[0])

    shoulder, wrist = (
        one(jnp.moveaxis(one(x, bit), 1, 0), bits.elbow)
        for x, bit in ((solutions.shoulder, bits.shoulder), (solutions.wrist, bits.wrist))
    )
    return jnp.concatenate([shoulder, one(solutions.elbow, bits.elbow)[None], wrist])


@fused_separately
def _implicit(weights: Array, branch: BranchMotion, q_now: Array, swivel: Array, near: Array) -> Array:
    """The same swivel, with the derivative that keeps it the nearest (implicit function theorem)."""
    hold = jax.lax.stop_gradient

    def unwound(q: Array) -> Array:
        return q + TURN * jnp.round(hold(near - q) / TURN)

    rates = branch.rates(swivel)
    off = unwound(rates.q) - q_now
    slope = jnp.tensordot(weights, 2.0 * off * rates.first, axes=1)
    curvature = jnp.tensordot(weights, 2.0 * (rates.first**2 + off * rates.second), axes=1)
    convex = curvature > 0.0
    inside = -(slope - hold(slope)) / hold(jnp.where(convex, curvature, 1.0))

    def room(s: Array) -> Array:
        return branch.room(unwound(branch.angles(s)), s)

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
