"""Descent of the distance from a target inside the joint limits: Newton's method in a box, from many starts at once.

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

# Iterations of Newton's method, and rounds of multipliers of the keep-out, each of which gains a digit or more.
ITERATIONS, ROUNDS = 50, 8
# Weight of the squared intrusion into the keep-out, relative to the squared distance from the target in arm lengths, in
# the first round, and its growth per round: where a half-space is met at a small angle, its multiplier is large.
PENALTY, GROWTH = 100.0, 5.0


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
        depth: Intrusion of the elbow into each half-space in arm lengths, negative outside, ``(half_spaces, n)``.
        depth_gradient: Its derivatives, ``(half_spaces, joint, n)``.
        depth_hessian: Its second derivatives, ``(half_spaces, joint, joint, n)``.
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
    off = jnp.concatenate([points[:, 3:], directions], axis=1) - jnp.concatenate(
        [goal.position[:, None], goal.directions], axis=1
    )
    weighted = goal.weights[:, None] * off
    on_axis = np.array([0, 0, 0, 1, 2, 2, 2])[: arm.n_joints]  # shoulder, elbow and wrist
    levers = points[:, 3:] - points[:, on_axis]
    behind = jnp.broadcast_to(directions[:, :, None], (3, columns, arm.n_joints, q.shape[-1]))
    moved = jnp.concatenate([levers[:, None], behind], axis=1)
    first = vec3.cross(axes[:, None], moved)  # (3, distance, joint, n)
    gradient = 2.0 * jnp.sum(vec3.dot(weighted[:, :, None], first), axis=0)
    gauss = jnp.einsum("w,xwin,xwjn->ijn", goal.weights, first, first)
    curved = jnp.einsum("xwin,xwjn->ijn", vec3.cross(weighted[:, :, None], axes[:, None]), first)
    upper = jnp.moveaxis(arm.keep_out.normal, 1, 0)
    elbow = points[:, 1] - points[:, 0]
    above = jnp.arange(arm.n_joints)[:, None] < 3
    swept = jnp.where(above, vec3.cross(axes, jnp.broadcast_to(elbow[:, None], axes.shape)), 0.0)
    bent = vec3.cross(jnp.broadcast_to(upper[:, :, None, None], (*upper.shape, 1, 1)), axes[:, None])
    room = arm.keep_out.offset - arm.keep_out.normal @ arm.shoulder
    return Slope(
        cost=jnp.sum(goal.weights[:, None] * vec3.dot(off, off), axis=0),
        gradient=gradient,
        hessian=2.0 * (gauss + _symmetric(curved)),
        depth=(vec3.dot(upper[..., None], elbow[:, None]) - room[:, None]) / arm.length,
        depth_gradient=vec3.dot(upper[..., None, None], swept[:, None]) / arm.length,
        depth_hessian=_symmetric(jnp.einsum("xhin,xjn->hijn", bent, swept)) / arm.length,
    )


def _symmetric(x: Array) -> Array:
    """Fill the lower triangle of ``(..., joint, joint, n)`` from the upper one."""
    upper = jnp.triu(jnp.ones(x.shape[-3:-1], x.dtype))[..., None]
    strict = jnp.triu(jnp.ones(x.shape[-3:-1], x.dtype), 1)[..., None]
    return x * upper + jnp.swapaxes(x * strict, -3, -2)


class _State(NamedTuple):
    q: Array
    at: Slope
    damping: Array
    multiplier: Array
    penalty: Array

    def augmented(self, at: Slope) -> tuple[Array, Array, Array]:
        """Augmented Lagrangian of the keep-out: value, gradient and Hessian."""
        push = jnp.maximum(self.multiplier + self.penalty * at.depth, 0.0)
        value = at.cost + jnp.sum(push * push - self.multiplier**2, axis=0) / (2.0 * self.penalty)
        gradient = at.gradient + jnp.sum(push[:, None] * at.depth_gradient, axis=0)
        stiff = jnp.where(push > 0.0, self.penalty, 0.0)[:, None, None]
        outer = at.depth_gradient[:, :, None] * at.depth_gradient[:, None, :]
        return value, gradient, at.hessian + jnp.sum(push[:, None, None] * at.depth_hessian + stiff * outer, axis=0)


def descend(arm: Arm, goal: Goal, q: Array) -> tuple[Array, Array, Array]:
    """Descend from joint angles ``(joint, n)`` within the limits to local minima of the distance.

    Returns:
        Joint angles, multipliers of the half-spaces ``(half_spaces, n)``, and the distances, infinite where the elbow
        is in its keep-out.
    """
    lower, upper = arm.lower[:, None], arm.upper[:, None]
    eps = float(jnp.finfo(q.dtype).eps)

    def step(state: _State) -> _State:
        value, gradient, hessian = state.augmented(state.at)
        held = ((state.q <= lower) & (gradient > 0.0)) | ((state.q >= upper) & (gradient < 0.0))
        move, convex = solve_free(hessian, gradient, held, state.damping)
        q = jnp.clip(state.q - move, lower, upper)
        at = slope(arm, goal, q)
        better = convex & (state.augmented(at)[0] < value)
        pick = lambda new, old: jnp.where(better, new, old)  # noqa: E731
        damping = jnp.clip(jnp.where(better, 0.2 * state.damping, 5.0 * state.damping), eps, 1e6)
        return state._replace(q=pick(q, state.q), at=jax.tree.map(pick, at, state.at), damping=damping)

    def unfinished(carried: tuple[_State, Array]) -> Array:
        state, count = carried
        _, gradient, _ = state.augmented(state.at)
        free = state.q - jnp.clip(state.q - gradient, lower, upper)
        still = (jnp.max(jnp.abs(free), axis=0) > 10 * eps * jnp.maximum(state.penalty / PENALTY, 1.0)) & (
            state.damping < 1e5
        )
        return (count < ITERATIONS) & jnp.any(still)

    def round_of(state: _State, _: None) -> tuple[_State, None]:
        state = state._replace(damping=jnp.full_like(state.damping, 1e-2))
        state = jax.lax.while_loop(unfinished, lambda c: (step(c[0]), c[1] + 1), (state, jnp.zeros((), int)))[0]
        multiplier = jnp.maximum(state.multiplier + state.penalty * state.at.depth, 0.0)
        return state._replace(multiplier=multiplier, penalty=GROWTH * state.penalty), None

    spaces = arm.keep_out.normal.shape[0]
    none, first = jnp.zeros((spaces, q.shape[-1]), q.dtype), jnp.asarray(PENALTY, q.dtype)
    start = _State(q, slope(arm, goal, q), jnp.ones_like(q[0]), none, first)
    state, _ = jax.lax.scan(round_of, start, None, length=ROUNDS if spaces else 1)
    inside = jnp.any(state.at.depth > np.sqrt(eps), axis=0)
    return _moved_out(arm, goal, state.q), state.multiplier, jnp.where(inside, jnp.inf, state.at.cost)


def _moved_out(arm: Arm, goal: Goal, q: Array) -> Array:
    """Move the elbow out of its keep-out by what the multipliers left of the way, to rounding."""
    least = float(jnp.finfo(q.dtype).eps)
    for _ in range(3):
        for space in range(arm.keep_out.normal.shape[0]):
            at = slope(arm, goal, q)
            depth, rate = jnp.maximum(at.depth[space], 0.0), at.depth_gradient[space]
            way = depth / jnp.maximum(jnp.sum(rate * rate, axis=0), least)
            moved = q - rate * jnp.where(depth <= np.sqrt(least), way, 0.0)
            q = jnp.clip(moved, arm.lower[:, None], arm.upper[:, None])
    return q


def solve_free(hessian: Array, gradient: Array, held: Array, damping: Array) -> tuple[Array, Array]:
    """Newton's step of the joints that are not held, ``(joint, n)``, and where the damped Hessian is positive definite.

    Cholesky's factorization, written out: a matrix of one row per joint is too small for a library call per target.
    """
    size = len(gradient)
    free = jnp.where(held, 0.0, 1.0).astype(gradient.dtype)
    diagonal = damping * free + jnp.where(held, 1.0, 0.0)
    scale = jnp.max(jnp.abs(jnp.diagonal(hessian, axis1=0, axis2=1)), axis=-1)
    a = [[hessian[i, j] * free[i] * free[j] for j in range(i + 1)] for i in range(size)]
    b = [gradient[i] * free[i] for i in range(size)]
    convex = jnp.ones(gradient.shape[1:], bool)
    least = float(jnp.finfo(gradient.dtype).eps) * scale
    for j in range(size):
        pivot = a[j][j] + diagonal[j]
        convex = convex & (pivot > least)
        inverse = 1.0 / jnp.where(pivot > least, pivot, 1.0)
        for i in range(j + 1, size):
            factor = a[i][j] * inverse
            for k in range(j + 1, i + 1):
                a[i][k] = a[i][k] - factor * a[k][j]
            b[i] = b[i] - factor * b[j]
        a[j][j] = inverse
    x: list[Array] = [jnp.zeros_like(b[0])] * size
    for j in reversed(range(size)):
        x[j] = (b[j] - sum((a[i][j] * x[i] for i in range(j + 1, size)), jnp.zeros_like(b[0]))) * a[j][j]
    return jnp.stack(x), convex
