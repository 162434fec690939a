"""Following a moving target: the next posture of a control loop, never faster than the joints may be."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxik.arm import Arm, ArmModel, as_arm
from jaxik.ik import Residual, Status, over_targets, replace_bad_rows, residual, target_columns
from jaxik.numerics import principal, sort_columns, to_batch_first, to_batch_last, tolerances
from jaxik.obstacles import World, columns_of, in_columns, in_world, moves
from jaxik.redundancy.arcs import borders_of_limits, feasible_between
from jaxik.redundancy.clear_step import clear_step
from jaxik.redundancy.follow_step import FollowStatus, FollowStep
from jaxik.redundancy.nearest import THREAD_CHUNK
from jaxik.redundancy.nearest_search import nearest_posture, ranges_of
from jaxik.redundancy.nearness import Nearness, stacked, within_a_turn
from jaxik.redundancy.parameter_nearest import check_nearest, has_swivel
from jaxik.redundancy.posture_search import Wanted, nearest_in_stages
from jaxik.redundancy.self_motion import SelfMotion, self_motion_of_columns
from jaxik.redundancy.step_ranges import Moving, StepRanges, step_ranges, toward
from jaxik.targets import Target, TargetLike, as_array, as_floats, as_target, batch_shape, check_joints, check_target


def follow(
    arm: Arm | ArmModel,
    target: TargetLike,
    q_now: Float[ArrayLike, "*batch joint"],
    dt: Float[ArrayLike, ""],
    *,
    weights: Float[ArrayLike, "joint"] | None = None,
    world: World | None = None,
    acceleration: Float[ArrayLike, "*joint"] | None = None,
    last: FollowStep | None = None,
) -> FollowStep:
    """Return the next posture of an arm that follows a moving target, as in teleoperation.

    If any posture on target can be reached within the step, the one with the least weighted motion is taken: whether
    there is one is decided exactly, by the feasible arcs for ranges that end where the joints can be after ``dt``; for
    arms of other classes than S-R-S by descents from the present posture and from samples of the redundancy parameter.
    Otherwise the joints move straight toward the nearest posture on target, as fast as the slowest of them may. Thus an
    arm that has to change its branch, or that was left behind by its target, catches up.

    A joint that comes near its limit slows down where the target allows it: the elbow turns before the end of its arc
    and is not stopped there from full speed.

    With ``acceleration``, no step changes a joint's velocity by more than ``acceleration * dt`` either, and joints
    brake in time before their limits. A target that stops at once is then overshot, and met again; a lost frame brakes
    the arm. Limits are kept for any target while ``dt`` stays the same; where a velocity of the caller leaves no way to
    stop before a limit, or is too fast, limits and speeds come first. Keep-out and obstacles are not braked for: let
    bodies have a margin for the way to stop.

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
        acceleration: Largest joint accelerations, a number or ``(n_joints,)`` [rad/s²], with ``last``; None for no
            limit.
        last: The last step, whose velocity and goal this one goes on from; ``FollowStep.at_rest(q_now)`` to begin.

    Returns:
        The next posture, its status, lag, velocity and goal. For loops: ``jax.lax.scan`` over frames, with the posture
        as the state, or with the whole step where accelerations are limited.

    Raises:
        ValueError: Wrong shapes or dtypes, or a :class:`Pose` for a 6-joint arm; a world for an arm without a body;
            ``acceleration`` without ``last``.

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
    rows, fixed = (q_now,), (dt, weights, acceleration)
    if acceleration is not None:
        if last is None:
            raise ValueError("acceleration needs last, the last step: jaxik.FollowStep.at_rest(q_now) to begin")
        rows += (last.velocity, last.goal)
        fixed = dt, weights, as_array("acceleration, a number or (joint,)", acceleration)
    if moves(arm):  # the rows of the world would have to be in the chunks too
        found = _follow(arm, target, *rows, *fixed)
    else:
        found = over_targets(_follow, arm, target, *rows, rank=1, fixed=fixed, chunk=THREAD_CHUNK)
    q, status, off, turn, velocity, goal = found
    return FollowStep(q, status, Residual(off, turn), velocity, goal)


@jax.jit
def _follow(arm: Arm, target: Target, *values: Any) -> tuple[Array, ...]:
    """Fields of the step, from the present angles, velocities and goals if any, dt, weights and accelerations."""
    *rows, dt, weights, acceleration = values
    target, rows = check_target(arm, target, *rows)
    for x in rows:
        check_joints(arm, x)
    dtype = rows[0].dtype
    weights = jnp.ones(arm.n_joints, dtype) if weights is None else as_floats(weights)[0].astype(dtype)
    if weights.shape != (arm.n_joints,) or jnp.shape(dt) != ():
        raise ValueError(f"expected weights ({arm.n_joints},) and dt (), got {weights.shape} and {jnp.shape(dt)}")
    batch, world = batch_shape(target, *(x[..., 0] for x in rows)), None
    if arm.surroundings is not None:
        batch = np.broadcast_shapes(batch, arm.surroundings.world.batch)
        world = columns_of(arm.astype(dtype).surroundings.world, batch)
    arm, target, rows, dt, weights = jax.lax.stop_gradient((arm.astype(dtype), target, rows, dt, weights))
    position, directions, _ = target_columns(target, jnp.zeros((), dtype), batch)
    now, *before = (to_batch_last(x, batch, 1) for x in rows)
    dt, moving = jnp.asarray(dt, dtype), None
    if acceleration is not None:
        if jnp.shape(acceleration) not in ((), (arm.n_joints,)):
            raise ValueError(f"expected acceleration () or ({arm.n_joints},), got {jnp.shape(acceleration)}")
        most = jax.lax.stop_gradient(jnp.broadcast_to(jnp.asarray(acceleration, dtype), arm.n_joints))
        moving = Moving(before[0], before[1], most)
    q, status, goal = _next(arm, weights, position, directions, now, dt, moving, jax.lax.stop_gradient(world))
    bad = status == FollowStatus.BAD_INPUT
    lag = (jnp.where(bad, jnp.inf, x[0]) for x in residual(arm, q[None], position, directions))
    way = jnp.where(jnp.isfinite(now), q - now, 0.0)
    velocity = jnp.where(dt > 0.0, way / jnp.where(dt > 0.0, dt, 1.0), 0.0)
    return tuple(to_batch_first(x, batch) for x in (q, status, *lag, velocity, goal))


def _next(
    arm: Arm,
    weights: Array,
    position: Array,
    directions: Array,
    q_now: Array,
    dt: Array,
    moving: Moving | None,
    world: World | None,
) -> tuple[Array, Array, Array]:
    """Next postures ``(joint, n)``, statuses and goals."""
    lower, upper = arm.lower[:, None], arm.upper[:, None]
    finite = jnp.all(jnp.isfinite(q_now), axis=0)
    now = jnp.where(finite, q_now, jnp.clip(0.0, lower, upper))
    if moving is not None:
        finite = finite & jnp.all(jnp.isfinite(moving.velocity), axis=0)
        moving = moving._replace(velocity=jnp.where(finite, moving.velocity, 0.0))
    ranges = step_ranges(arm, now, dt, moving)
    goal_of = _swivel_goal if has_swivel(arm) else _parameter_goal
    goal, within, feasible, bad = goal_of(arm, weights, position, directions, now, ranges, world)
    bad = bad | ~finite
    goal = jnp.clip(goal, lower, upper)
    rest = jnp.clip(now, ranges.low, ranges.high)
    step = clear_step(arm, world, rest, jnp.where(within, goal, toward(goal, now, ranges, dt, moving)), *ranges[:2])
    q = jnp.where(bad, rest, jnp.clip(step.q, ranges.low, ranges.high))
    status = jnp.where(within, jnp.int32(FollowStatus.ON_TARGET), jnp.int32(FollowStatus.LAGGING))
    status = jnp.where(step.changed, jnp.int32(FollowStatus.BLOCKED), status)
    status = jnp.where(feasible | within, status, jnp.int32(FollowStatus.INFEASIBLE))
    status = jnp.where(step.meets, jnp.int32(FollowStatus.COLLISION), status)
    return q, jnp.where(bad, jnp.int32(FollowStatus.BAD_INPUT), status), jnp.where(bad, q, goal)


def _swivel_goal(
    arm: Arm,
    weights: Array,
    position: Array,
    directions: Array,
    now: Array,
    ranges: StepRanges,
    world: World | None,
) -> tuple[Array, Array, Array, Array]:
    """The posture to move to; where it can be reached in the step, where it is feasible, and where a row is bad."""
    motion = self_motion_of_columns(arm, position, directions, world)
    lower, upper = arm.lower[:, None], arm.upper[:, None]
    near = within_a_turn(now, weights, lower, upper)
    ends = jnp.stack([jnp.stack(ranges[:2]), ranges.early])

    def narrowed(i: Array, state: tuple[Array, Array]) -> tuple[Array, Array]:
        """Go on to narrower ranges where they hold a posture."""
        step = within_a_turn(now, weights, *ends[i])
        found = _any_in(motion, step)
        chosen = jnp.where(found, jnp.stack(step[2:]), state[0])
        return chosen, found | state[1]

    least = jnp.any(ends[0] != ends[1]).astype(jnp.int32) + 1  # far from limits both are the same
    chosen, within = jax.lax.fori_loop(0, least, narrowed, (jnp.stack(near[2:]), jnp.zeros(now.shape[1:], bool)))
    nearest = nearest_posture(motion, near._replace(lower=chosen[0], upper=chosen[1]))
    goal = now + nearest.off
    slack = tolerances(now.dtype).near_singular ** 1.5  # at the ends of the ranges, as for limits
    within = within & _inside(goal, *ranges[:2], slack)
    feasible = motion.solvable & _inside(goal, lower, upper, _ROUNDING)
    free = motion.branch(nearest.branch).free
    if free is not None:
        feasible = feasible & free.contain(principal(nearest.swivel), tolerances(now.dtype).limit)
    return goal, within, feasible, motion.status >= Status.INVALID_TARGET


def _inside(q: Array, low: Array, high: Array, slack: float) -> Array:
    return jnp.all((q >= low - slack) & (q <= high + slack), axis=0)


def _parameter_goal(
    arm: Arm,
    weights: Array,
    position: Array,
    directions: Array,
    now: Array,
    ranges: StepRanges,
    world: World | None,
) -> tuple[Array, Array, Array, Array]:
    """The same for arms without swivel."""
    arm = arm if world is None else in_columns(arm, world)
    checked = replace_bad_rows(arm, position, directions, jnp.zeros_like(position[0]))
    step = within_a_turn(now, weights, *ranges[:2])
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
