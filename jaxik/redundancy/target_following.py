"""Following a moving target: the next posture of a control loop, never faster than the joints may be."""

import enum
from dataclasses import dataclass
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from jaxik.arm import Arm, ArmModel, as_arm
from jaxik.errors import UnreachableError
from jaxik.ik import Residual, Status, over_targets, replace_bad_rows, residual, target_columns
from jaxik.numerics import principal, sort_columns, to_batch_first, to_batch_last, tolerances
from jaxik.obstacles import World, columns_of, in_columns, in_world, moves
from jaxik.redundancy.arcs import borders_of_limits, feasible_between
from jaxik.redundancy.clear_step import clear_step
from jaxik.redundancy.nearest import THREAD_CHUNK
from jaxik.redundancy.nearest_search import nearest_posture, ranges_of
from jaxik.redundancy.nearness import Nearness, stacked, within_a_turn
from jaxik.redundancy.parameter_nearest import check_nearest, has_swivel
from jaxik.redundancy.posture_search import Wanted, nearest_in_stages
from jaxik.redundancy.self_motion import SelfMotion, self_motion_of_columns
from jaxik.targets import Target, TargetLike, as_array, as_floats, as_target, batch_shape, check_joints, check_target

if TYPE_CHECKING:
    from typing import Self


class FollowStatus(enum.IntEnum):
    """Outcome of a step."""

    ON_TARGET = 0
    LAGGING = 1
    BLOCKED = 2
    INFEASIBLE = 3
    COLLISION = 4
    BAD_INPUT = 5

    @property
    def message(self) -> str:
        """Meaning of the status and the next step to take, in one sentence."""
        return _MESSAGES[self]


_MESSAGES = {
    FollowStatus.ON_TARGET: "the tool is on the target",
    FollowStatus.LAGGING: "the joints move as fast as they may toward the target; the next steps catch up",
    FollowStatus.BLOCKED: "the keep-out or an obstacle is in the way to the nearest posture on target; the joints move "
    "along it and may have to stop (jaxik.clearance says which it is)",
    FollowStatus.INFEASIBLE: "reach, limits, keep-out or obstacles forbid the target; the joints go as near as they "
    "may (jaxik.solve_closest finds the closest pose)",
    FollowStatus.COLLISION: "the arm's body meets an obstacle or itself and cannot leave it within the step "
    "(jaxik.clearance says which); the joints move out of it as fast as they may",
    FollowStatus.BAD_INPUT: "NaN, infinity or no rotation in the target or the present posture; the arm stays in place",
}


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class FollowStep:
    """The next posture of each row.

    Attributes:
        q: Joint angles, ``(*batch, n_joints)`` [rad]: within the limits if ``q_now`` is, no farther from it than the
            speed limits allow in ``dt``, and clear of obstacles unless the status is COLLISION.
        status: :class:`FollowStatus` as integers, ``(*batch,)``.
        lag: Distance of the tool from the target, ``(*batch,)`` in meters and radians.
    """

    q: Float[Array, "*batch joint"]
    status: Int[Array, "*batch"]
    lag: Residual

    @property
    def ok(self) -> Bool[Array, "*batch"]:
        """True where the tool is on the target."""
        return self.status == FollowStatus.ON_TARGET

    def raise_if_invalid(self) -> "Self":
        """Return the step itself, so that calls chain; for use outside ``jit``. A lag is no error.

        Raises:
            UnreachableError: A row has a bad input, a target that is forbidden or a collision; with the row and the
                reason.
        """
        worst = int(jnp.max(self.status, initial=0))
        if worst >= FollowStatus.INFEASIBLE:
            row = int(jnp.argmax(jnp.ravel(self.status)))
            raise UnreachableError(f"row {row}: {FollowStatus(worst).message}")
        return self


def follow(
    arm: Arm | ArmModel,
    target: TargetLike,
    q_now: Float[ArrayLike, "*batch joint"],
    dt: Float[ArrayLike, ""],
    *,
    weights: Float[ArrayLike, "joint"] | None = None,
    world: World | None = None,
) -> FollowStep:
    """Return the next posture of an arm that follows a moving target, as in teleoperation.

    If any posture on target can be reached within the step, the one with the least weighted motion is taken: whether
    there is one is decided exactly, by the feasible arcs for ranges that end where the joints can be after ``dt``; for
    arms of other classes than S-R-S by descents from the present posture and from samples of the redundancy parameter.
    Otherwise the joints move straight toward the nearest posture on target, as fast as the slowest of them may. Thus an
    arm that has to change its branch, or that was left behind by its target, catches up.

    Among obstacles, the posture on target is one that is clear of them, and a step that would enter one moves along it
    or is shortened. From a collision, as with an obstacle that moved into the arm, the step leads out. Postures are
    clear, and the way between two of them departs from clear by the square of the step: let bodies have a margin
    (:meth:`Body.grown`). Where the arm would have to go round an obstacle, it may come to rest in front of it;
    :func:`jaxik.plan` goes round.

    Args:
        arm: The arm, with speed limits.
        target: A :class:`Pose` or :class:`Pointing` with leading batch axes, as for :func:`solve_ik`.
        q_now: Present joint angles, ``(*batch, n_joints)`` [rad], broadcast against the target.
        dt: Time until the next call [s].
        weights: Weight of each joint's squared motion, ``(n_joints,)``, not negative; all 1 by default.
        world: Obstacles at the end of the step, for an arm with a body (:func:`jaxik.with_body`); its batch axes, one
            world per row, broadcast too.

    Returns:
        The next posture, its status and lag. For loops: ``jax.lax.scan`` over frames, with the posture as the state.

    Raises:
        ValueError: Wrong shapes or dtypes, or a :class:`Pose` for a 6-joint arm; a world for an arm without a body.

    **Differentiability**: none; the derivatives of ``q`` are zero.

    Example:
        >>> import jaxik
        >>> model, q = jaxik.presets.iiwa7(), jnp.array([0.3, 0.8, -0.2, -1.2, 0.5, 0.9, 0.1])
        >>> hand = jaxik.forward_kinematics(model, q)
        >>> moved = jaxik.Pose(hand.position + jnp.array([0.0, 0.0, 0.001]), hand.rotation)
        >>> bool(jaxik.follow(model, moved, q, 0.01).ok)
        True
    """
    arm, target = in_world(as_arm(arm, any_class=True), world), as_target(target)
    check_nearest(arm, target)
    weights = None if weights is None else as_array("weights of shape (joint,)", weights)
    q_now, dt = as_array("q_now of shape (*batch, joint)", q_now), as_array("dt, one time", dt)
    if moves(arm):  # the rows of the world would have to be in the chunks too
        q, status, off, turn = _follow(arm, target, q_now, dt, weights)
    else:
        q, status, off, turn = over_targets(
            _follow, arm, target, q_now, rank=1, fixed=(dt, weights), chunk=THREAD_CHUNK
        )
    return FollowStep(q, status, Residual(off, turn))


@jax.jit
def _follow(arm: Arm, target: Target, q_now: ArrayLike, dt: ArrayLike, weights: ArrayLike | None) -> tuple[Array, ...]:
    """Fields of the step."""
    target, (q_now,) = check_target(arm, target, q_now)
    check_joints(arm, q_now)
    dtype = q_now.dtype
    weights = jnp.ones(arm.n_joints, dtype) if weights is None else as_floats(weights)[0].astype(dtype)
    if weights.shape != (arm.n_joints,) or jnp.shape(dt) != ():
        raise ValueError(f"expected weights ({arm.n_joints},) and dt (), got {weights.shape} and {jnp.shape(dt)}")
    batch, world = batch_shape(target, q_now[..., 0]), None
    if arm.surroundings is not None:
        batch = np.broadcast_shapes(batch, arm.surroundings.world.batch)
        world = columns_of(arm.astype(dtype).surroundings.world, batch)
    arm, target, q_now, dt, weights = jax.lax.stop_gradient((arm.astype(dtype), target, q_now, dt, weights))
    position, directions, _ = target_columns(target, jnp.zeros((), dtype), batch)
    now = to_batch_last(q_now, batch, 1)
    q, status = _next(arm, weights, position, directions, now, jnp.asarray(dt, dtype), jax.lax.stop_gradient(world))
    off, turn = (x[0] for x in residual(arm, q[None], position, directions))
    return tuple(to_batch_first(x, batch) for x in (q, status, off, turn))


def _next(
    arm: Arm, weights: Array, position: Array, directions: Array, q_now: Array, dt: Array, world: World | None
) -> tuple[Array, Array]:
    """Next postures ``(joint, n)`` and statuses."""
    finite = jnp.all(jnp.isfinite(q_now), axis=0)
    now = jnp.where(finite, q_now, jnp.clip(0.0, arm.lower, arm.upper)[:, None])
    lower, upper = arm.lower[:, None], arm.upper[:, None]
    room = jnp.maximum(arm.velocity_limit * dt, 0.0)[:, None]
    # From outside the limits the way leads inside, as fast as it may.
    low = jnp.minimum(jnp.maximum(lower, now - room), now + room)
    high = jnp.maximum(jnp.minimum(upper, now + room), now - room)
    goal_of = _swivel_goal if has_swivel(arm) else _parameter_goal
    goal, within, feasible, bad = goal_of(arm, weights, position, directions, now, low, high, world)
    bad = bad | ~finite
    way = jnp.clip(goal, lower, upper) - now
    share = jnp.min(jnp.where(jnp.abs(way) > room, room / jnp.maximum(jnp.abs(way), room), 1.0), axis=0)
    step = clear_step(arm, world, now, now + jnp.where(within, 1.0, share) * way, low, high)
    q = jnp.clip(jnp.where(bad, now, step.q), low, high)
    status = jnp.where(within, jnp.int32(FollowStatus.ON_TARGET), jnp.int32(FollowStatus.LAGGING))
    status = jnp.where(step.changed, jnp.int32(FollowStatus.BLOCKED), status)
    status = jnp.where(feasible | within, status, jnp.int32(FollowStatus.INFEASIBLE))
    status = jnp.where(step.meets, jnp.int32(FollowStatus.COLLISION), status)
    return q, jnp.where(bad, jnp.int32(FollowStatus.BAD_INPUT), status)


def _swivel_goal(
    arm: Arm,
    weights: Array,
    position: Array,
    directions: Array,
    now: Array,
    low: Array,
    high: Array,
    world: World | None,
) -> tuple[Array, Array, Array, Array]:
    """The posture to move to; where it can be reached in the step, where it is feasible, and where a row is bad."""
    motion = self_motion_of_columns(arm, position, directions, world)
    lower, upper = arm.lower[:, None], arm.upper[:, None]
    everywhere, step = within_a_turn(now, weights, lower, upper), within_a_turn(now, weights, low, high)
    within = _any_in(motion, step)
    near = Nearness(now, weights, *(jnp.where(within, a, b) for a, b in zip(step[2:], everywhere[2:], strict=True)))
    nearest = nearest_posture(motion, near)
    goal = now + nearest.off
    feasible = motion.solvable & jnp.all((goal >= lower - _ROUNDING) & (goal <= upper + _ROUNDING), axis=0)
    free = motion.branch(nearest.branch).free
    if free is not None:
        feasible = feasible & free.contain(principal(nearest.swivel), tolerances(now.dtype).limit)
    return goal, within, feasible, motion.status >= Status.INVALID_TARGET


def _parameter_goal(
    arm: Arm,
    weights: Array,
    position: Array,
    directions: Array,
    now: Array,
    low: Array,
    high: Array,
    world: World | None,
) -> tuple[Array, Array, Array, Array]:
    """The same for arms without swivel."""
    arm = arm if world is None else in_columns(arm, world)
    checked = replace_bad_rows(arm, position, directions, jnp.zeros_like(position[0]))
    step = within_a_turn(now, weights, low, high)
    near = within_a_turn(now, weights, arm.lower[:, None], arm.upper[:, None])
    wanted = Wanted(checked.position, checked.directions, now, weights)
    found = nearest_in_stages(arm, wanted, *stacked(step, near), (True, True, False))
    return found.q, found.stage == 0, found.stage <= 1, checked.invalid | checked.nonfinite


_ROUNDING = 1e-6  # rad


def _any_in(motion: SelfMotion, near: Nearness) -> Array:
    """Rows with any posture on target in the ranges, ``(n,)``."""
    ranges = ranges_of(motion, near.lower, near.upper)
    cuts = sort_columns(borders_of_limits(motion, ranges))
    return jnp.any(feasible_between(motion, cuts, ranges), axis=(0, 1, 2, 3))
