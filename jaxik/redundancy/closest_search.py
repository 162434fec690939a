"""Descent of the distance from a target inside the joint limits: Newton's method in a box, from many starts at once.

The elbow's half-spaces, and the distance of every sphere of the body from what it must not meet, are inequalities with
multipliers. Of the spheres' distances the second derivatives are left out, which costs steps and no accuracy.

All arrays have the batch last. With a the axes, v the lever of the tool point (or a column of the tool's rotation), the
first derivatives are a_i × v_i, and the second ones, for i ≤ j, are a_i × (a_j × v_j): the exact Hessian costs little
more than the Jacobian, and large distances from the target need it.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxik.arm import Arm
from jaxik.kinematics import carry_axes
from jaxik.numerics import sincos, vec3
from jaxik.obstacles import rooms_at, sphere_centers

# Iterations of Newton's method per value of the multipliers, and values of these, each of which gains a digit or more.
ITERATIONS, ROUNDS = 50, 8
# Weight of the squared intrusion into the keep-out, relative to the squared distance from the target in arm lengths, in
# the first round, and its growth per round: where a half-space is met at a small angle, its multiplier is large.
PENALTY, GROWTH = 100.0, 5.0
FIRST_DAMPING = 1e-2
# Weight of the remaining intrusion when minima are compared, more than a multiplier usually is. It decides between
# equal minima of which one has its elbow a rounding inside, where a limit that is not quite half a turn holds it.
WAY_OUT = 1e3
# Steps that move the elbow out: one per half-space, and more in the corner of two.
STEPS_OUT = 20


class Goal(NamedTuple):
    """Targets and the weights of their distances.

    Attributes:
        position: Tool points, ``(3, n)`` [m].
        directions: Columns of the rotations, or pointing directions, ``(3, 3 or 1, n)``.
        weights: Weights of the squared distances of the tool point [1/m²] and of each direction, ``(columns + 1,)``.
    """

    position: Array
    directions: Array
    weights: Array


class Slope(NamedTuple):
    """Distance and derivatives, the batch last.

    Attributes:
        cost: Weighted squared distance, ``(n,)``.
        gradient: Its derivatives in the joint angles, ``(joint, n)``.
        hessian: Its second derivatives, ``(joint, joint, n)``.
        depth: Intrusion of the elbow into each half-space, then of each sphere of a body and of the body into itself,
            in arm lengths, negative outside, ``(constraints, n)``.
        depth_gradient: Its derivatives, ``(constraints, joint, n)``.
        depth_hessian: Second derivatives of the elbow's, ``(half_spaces, joint, joint, n)``.
    """

    cost: Array
    gradient: Array
    hessian: Array
    depth: Array
    depth_gradient: Array
    depth_hessian: Array


def slope(arm: Arm, goal: Goal, q: Array) -> Slope:
    """Return the distance from the goal at joint angles ``(joint, n)``, with its derivatives."""
    columns = goal.directions.shape[1]
    points, directions, axes = carry_axes(arm, *sincos(q), arm.tool_rotation[:, 3 - columns :])
    tool = points[:, -1:]
    off = jnp.concatenate([tool, directions], axis=1) - jnp.concatenate(
        [goal.position[:, None], goal.directions], axis=1
    )
    weighted = goal.weights[:, None] * off
    levers = tool - points[:, np.array(arm.station_of_joint)]
    behind = jnp.broadcast_to(directions[:, :, None], (3, columns, arm.n_joints, q.shape[-1]))
    moved = jnp.concatenate([levers[:, None], behind], axis=1)
    first = vec3.cross(axes[:, None], moved)  # (3, distance, joint, n)
    gradient = 2.0 * jnp.sum(vec3.dot(weighted[:, :, None], first), axis=0)
    gauss = jnp.einsum("w,xwin,xwjn->ijn", goal.weights, first, first)
    curved = jnp.einsum("xwin,xwjn->ijn", vec3.cross(weighted[:, :, None], axes[:, None]), first)
    depth, depth_gradient, depth_hessian = _intrusion(arm, points, axes)
    if arm.surroundings is not None:
        depth, depth_gradient = _with_overlaps(arm, depth, depth_gradient, q, points, axes)
    return Slope(
        cost=jnp.sum(goal.weights[:, None] * vec3.dot(off, off), axis=0),
        gradient=gradient,
        hessian=2.0 * (gauss + _symmetric(curved)),
        depth=depth,
        depth_gradient=depth_gradient,
        depth_hessian=depth_hessian,
    )


def _intrusion(arm: Arm, points: Array, axes: Array) -> tuple[Array, Array, Array]:
    """Intrusion of the elbow into each half-space in arm lengths, with its derivatives."""
    upper = jnp.moveaxis(arm.keep_out.normal, 1, 0)
    on_axis = np.array(arm.station_of_joint)
    elbow = points[:, on_axis[3]]
    above = jnp.arange(arm.n_joints)[:, None] < 3
    swept = jnp.where(above, vec3.cross(axes, elbow[:, None] - points[:, on_axis]), 0.0)
    bent = vec3.cross(jnp.broadcast_to(upper[:, :, None, None], (*upper.shape, 1, 1)), axes[:, None])
    # From the first station, which rests, for the sake of rounding.
    room = arm.keep_out.offset - arm.keep_out.normal @ arm.stations[0]
    return (
        (vec3.dot(upper[..., None], (elbow - points[:, 0])[:, None]) - room[:, None]) / arm.length,
        vec3.dot(upper[..., None, None], swept[:, None]) / arm.length,
        _symmetric(jnp.einsum("xhin,xjn->hijn", bent, swept)) / arm.length,
    )


def _with_overlaps(
    arm: Arm, depth: Array, gradient: Array, q: Array, points: Array, axes: Array
) -> tuple[Array, Array]:
    """Intrusions of the elbow, and behind them the overlaps of the body, with their derivatives."""
    overlap, rate = overlaps(arm, q, points, axes)
    return jnp.concatenate([depth, overlap]), jnp.concatenate([gradient, rate])


def overlaps(arm: Arm, q: Array, points: Array, axes: Array) -> tuple[Array, Array]:
    """Return the overlap of each sphere with the world, and the body's own, ``(M + 1, n)`` [arm lengths], and slopes.

    A sphere depends on the joints that move it, and its distance on its center alone: one pass back from all distances
    to all centers gives the directions in which they grow.

    Args:
        arm: The arm with its body; the world has its rows last.
        q: Joint angles, ``(joint, n)`` [rad].
        points: Points on the axes at these angles, as of :func:`jaxik.kinematics.carry_axes`.
        axes: Axes at these angles, ``(3, joint, n)``.

    Returns:
        Overlaps, negative where apart, and their derivatives ``(M + 1, joint, n)``.
    """
    body, world = arm.surroundings.body, arm.surroundings.world
    place = sphere_centers(arm, body, q)
    room, pull = jax.vjp(lambda place: rooms_at(place, body, world), place)
    to_world, own = jnp.ones_like(room).at[-1].set(0.0), jnp.zeros_like(room).at[-1].set(1.0)
    moved = jnp.asarray(np.array(body.link)[:, None] > np.arange(arm.n_joints))[..., None]
    levers = place[:, :, None] - points[:, None, np.array(arm.station_of_joint)]
    swept = jnp.where(moved, vec3.cross(jnp.broadcast_to(axes[:, None], levers.shape), levers), 0.0)
    first, second = (vec3.dot(pull(side)[0][:, :, None], swept) for side in (to_world, own))
    rate = jnp.concatenate([first, jnp.sum(second, axis=0, keepdims=True)])
    return jnp.maximum(-room / arm.length, -1.0), -rate / arm.length


def _symmetric(x: Array) -> Array:
    """Fill the lower triangle of ``(..., joint, joint, n)`` from the upper one."""
    upper = jnp.triu(jnp.ones(x.shape[-3:-1], x.dtype))[..., None]
    strict = jnp.triu(jnp.ones(x.shape[-3:-1], x.dtype), 1)[..., None]
    return x * upper + jnp.swapaxes(x * strict, -3, -2)


class _State(NamedTuple):
    """Descents, the batch last.

    Attributes:
        q: Best joint angles so far, ``(joint, n)`` [rad].
        at: Distance and derivatives there.
        trial: Joint angles tried next, ``(joint, n)`` [rad].
        damping: Added to the diagonal of the Hessian, ``(n,)``.
        multiplier: Multipliers of the constraints, ``(constraints, n)``.
        penalty: Weight of the squared intrusion, ``(n,)``.
        steps: Steps since the multipliers changed, ``(n,)``.
        done: True where a descent has ended, ``(n,)``.
    """

    q: Array
    at: Slope
    trial: Array
    damping: Array
    multiplier: Array
    penalty: Array
    steps: Array
    done: Array

    def augmented(self, at: Slope) -> tuple[Array, Array, Array]:
        """Augmented Lagrangian of the keep-out: value, gradient and Hessian."""
        push = self.push(at)
        value = at.cost + jnp.sum(push * push - self.multiplier**2, axis=0) / (2.0 * self.penalty)
        gradient = at.gradient + jnp.sum(push[:, None] * at.depth_gradient, axis=0)
        stiff = jnp.where(push > 0.0, self.penalty, 0.0)[:, None, None]
        outer = at.depth_gradient[:, :, None] * at.depth_gradient[:, None, :]
        bent = jnp.sum(push[: len(at.depth_hessian), None, None] * at.depth_hessian, axis=0)
        return value, gradient, at.hessian + bent + jnp.sum(stiff * outer, axis=0)

    def push(self, at: Slope) -> Array:
        """Force of each constraint, ``(constraints, n)``."""
        return jnp.maximum(self.multiplier + self.penalty * at.depth, 0.0)


class Minimum(NamedTuple):
    """Local minima of the distance, the batch last.

    Attributes:
        q: Joint angles, ``(joint, n)`` [rad].
        gradient: Derivatives of the Lagrangian of the keep-out, ``(joint, n)``: zero but for joints at their limits.
        multiplier: Multipliers of the constraints, ``(constraints, n)``.
        cost: Weighted squared distance and what the way out of the keep-out may add to it, ``(n,)``; infinite where the
            elbow is deep inside.
    """

    q: Array
    gradient: Array
    multiplier: Array
    cost: Array


def descend(arm: Arm, goal: Goal, q: Array) -> Minimum:
    """Descend from joint angles ``(joint, n)`` within the limits to local minima of the distance.

    The weights of the distance should add up to about 1, with lengths in arm lengths.
    """
    lower, upper = arm.lower[:, None], arm.upper[:, None]
    eps = float(jnp.finfo(q.dtype).eps)

    def slope_left(q: Array, gradient: Array) -> Array:
        return jnp.max(jnp.abs(q - jnp.clip(q - gradient, lower, upper)), axis=0)

    def step(s: _State) -> _State:
        at = slope(arm, goal, s.trial)
        (old, old_gradient, _), (new, new_gradient, _) = s.augmented(s.at), s.augmented(at)
        left, new_left = slope_left(s.q, old_gradient), slope_left(s.trial, new_gradient)
        # The value cannot tell two postures apart that are closer than the root of eps; the gradient can.
        better = (new < old) | ((new <= old + 8.0 * eps * (1.0 + old)) & (new_left < left))
        pick = lambda new, old: jnp.where(better, new, old)  # noqa: E731
        q, at, left = pick(s.trial, s.q), jax.tree.map(pick, at, s.at), pick(new_left, left)
        damping = jnp.clip(pick(0.2 * s.damping, 5.0 * s.damping), eps, 1e6)

        noise = 16.0 * eps * jnp.maximum(s.penalty / PENALTY, 1.0)
        settled = ~s.done & ((left <= noise) | (damping > 1e5) | (s.steps >= ITERATIONS))
        push = s.push(at)
        still = jnp.max(jnp.abs(push - s.multiplier), axis=0, initial=0.0) <= noise
        done = s.done | (settled & (still | (s.penalty > PENALTY * GROWTH ** (ROUNDS - 1.5))))
        s = s._replace(
            damping=jnp.where(settled, jnp.asarray(FIRST_DAMPING, damping.dtype), damping),
            multiplier=jnp.where(settled, push, s.multiplier),
            penalty=jnp.where(settled & ~done, GROWTH * s.penalty, s.penalty),
            steps=jnp.where(settled, 0, s.steps + 1),
        )
        _, gradient, hessian = s.augmented(at)
        held = ((q <= lower) & (gradient > 0.0)) | ((q >= upper) & (gradient < 0.0))
        move, convex = solve_free(hessian, gradient, held, s.damping)
        trial = jnp.where(convex & ~done, jnp.clip(q - move, lower, upper), q)
        return s._replace(q=q, at=at, trial=trial, done=done)

    n, dtype = q.shape[-1], q.dtype
    nowhere = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), jax.eval_shape(slope, arm, goal, q))
    nowhere = nowhere._replace(cost=jnp.full((n,), jnp.inf, dtype))
    multiplier = jnp.zeros_like(nowhere.depth)
    damping, penalty = jnp.full((n,), FIRST_DAMPING, dtype), jnp.full((n,), PENALTY, dtype)
    start = _State(q, nowhere, q, damping, multiplier, penalty, jnp.zeros((n,), jnp.int32), jnp.zeros((n,), bool))
    end = jax.lax.while_loop(lambda s: ~jnp.all(s.done), step, start)
    gradient = end.at.gradient + jnp.sum(end.multiplier[:, None] * end.at.depth_gradient, axis=0)
    depth = jnp.max(end.at.depth, axis=0, initial=0.0)
    cost = jnp.where(depth > eps**0.5, jnp.inf, end.at.cost + WAY_OUT * depth)
    return Minimum(end.q, gradient, end.multiplier, cost)


def move_out(arm: Arm, q: Array, most: Array) -> Array:
    """Move elbow and body out of what they are in where joint motions below a bound suffice, one after the other.

    Args:
        arm: The arm.
        q: Joint angles, ``(joint, n)`` [rad].
        most: Bounds, ``(n,)`` [rad].
    """
    lower, upper = arm.lower[:, None], arm.upper[:, None]

    def step(_: Array, q: Array) -> Array:
        points, _, axes = carry_axes(arm, *sincos(q), arm.tool_rotation[:, :0])
        depth, rate, _ = _intrusion(arm, points, axes)
        if arm.surroundings is not None:
            depth, rate = _with_overlaps(arm, depth, rate, q, points, axes)
        deepest = jnp.argmax(depth, axis=0)[None]
        depth = jnp.maximum(jnp.take_along_axis(depth, deepest, axis=0)[0], 0.0)
        rate = jnp.take_along_axis(rate, deepest[:, None], axis=0)[0]
        rate = jnp.where(((q <= lower) & (rate > 0.0)) | ((q >= upper) & (rate < 0.0)), 0.0, rate)
        steepness = jnp.sum(rate * rate, axis=0)
        move = rate * (depth / jnp.where(steepness > 0.0, steepness, 1.0))
        return jnp.clip(q - jnp.where(jnp.all(jnp.abs(move) <= most, axis=0), move, 0.0), lower, upper)

    constrained = arm.keep_out.normal.shape[0] or arm.surroundings is not None
    return jax.lax.fori_loop(0, STEPS_OUT, step, q) if constrained else q


def solve_free(hessian: Array, gradient: Array, held: Array, damping: Array) -> tuple[Array, Array]:
    """Newton's step of the joints that are not held, ``(joint, n)``, and where the damped Hessian is positive definite.

    Elimination row by row: a matrix of one row per joint is too small for a library call per target.
    """
    free = jnp.where(held, 0.0, 1.0).astype(gradient.dtype)
    least = float(jnp.finfo(gradient.dtype).eps) * jnp.max(jnp.abs(jnp.diagonal(hessian, axis1=0, axis2=1)), axis=-1)
    diagonal = jnp.eye(len(free), dtype=free.dtype)[..., None] * (damping * free + (1.0 - free))
    rows = jnp.concatenate([hessian * free * free[:, None] + diagonal, (gradient * free)[:, None]], axis=1)

    def eliminate(joint: Array, carried: tuple[Array, Array]) -> tuple[Array, Array]:
        rows, convex = carried
        pivot = rows[joint, joint]
        positive = pivot > least
        row = rows[joint] / jnp.where(positive, pivot, 1.0)
        return (rows - rows[:, joint][:, None] * row).at[joint].set(row), convex & positive

    rows, convex = jax.lax.fori_loop(0, len(free), eliminate, (rows, jnp.ones(gradient.shape[1:], bool)))
    return rows[:, -1], convex
