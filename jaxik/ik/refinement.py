"""Newton's method on the chain itself with one joint held, batch last.

Every function takes joint angles ``(7, ..., n)`` and targets that broadcast against them, ``(3, ..., n)`` and
``(3, 3, ..., n)``. Six equations (the tool's pose) in six unknowns (the joints that are free) are solved through the
normal equations with a damping that vanishes with the error (Levenberg and Marquardt), so that nothing pivots and a
step at a singular posture stays finite.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxik.arm import RefinedArm
from jaxik.kinematics import turns
from jaxik.numerics import clipped_sqrt, fused_separately, sincos_apart, vec3

LONGEST_STEP = 0.6
"""Largest change of a joint in one step [rad]; beyond it the linear model of a rotation is poor."""

DAMPING = 0.01
"""Damping over the squared error: enough to calm the first steps, too little to slow the last ones."""

ROUGH_STEPS = 5
"""Steps in single precision: most columns are then within its rounding."""

LAST_STEPS = 12
"""Most steps after these. Two are the rule; where two solutions nearly meet each step halves the error."""

SMALL = 1e-2
"""Error that a column near a fold may have for some steps without falling [arm lengths, rad]."""

BLOCK = 512
"""Columns refined at once: the arrays of a step then stay in a core's cache."""

FARTHEST_PARTNER = 1.5
"""Largest change of a joint from a solution to its partner [rad]: further off the parabola is no guide."""


class Miss(NamedTuple):
    """Displacement from the tool to its target, to first order.

    Attributes:
        twist: Translation [arm lengths] and rotation [rad] from the tool to its target, ``(6, ..., n)``.
        jacobian: Rates of the tool in the free joints, ``(6, 6, ..., n)``.
    """

    twist: Array
    jacobian: Array


def miss(arm: RefinedArm, q: Array, position: Array, rotation: Array) -> Miss:
    """Return the distance to the target as a twist, and the Jacobian of the free joints, both in the base frame."""
    turn = turns(arm.axes, *sincos_apart(q))
    scale = 1.0 / jax.lax.stop_gradient(arm.length)
    links = jnp.diff(jnp.stack(arm.stations), axis=0)
    like = jnp.zeros_like(q[0])
    frame, point = turn[0], arm.points[0].reshape(3, *[1] * like.ndim) + like
    axes, points = [arm.axes[0].reshape(3, *[1] * like.ndim) + like], [point]
    for joint in range(1, 7):
        axis, point = _outwards(frame, arm.axes[joint], links[joint - 1], point)
        axes.append(axis)
        points.append(point)
        frame = _turned(frame, turn[joint])
    reached = _turned(frame, _behind(arm.tool_rotation, like.ndim))
    point = _moved(frame, links[6], point)
    free = [joint for joint in range(7) if joint != arm.outer_joint]
    columns = jnp.stack([axes[i] for i in free], axis=1), jnp.stack([points[i] for i in free], axis=1)
    return Miss(_twist(reached, point, position, rotation, scale), _columns(*columns, point, scale))


@fused_separately
def _outwards(frame: Array, axis: Array, link: Array, point: Array) -> tuple[Array, Array]:
    batch = frame.ndim - 2
    return vec3.matvec(frame, _behind(axis, batch)), point + vec3.matvec(frame, _behind(link, batch))


@fused_separately
def _moved(frame: Array, link: Array, point: Array) -> Array:
    return point + vec3.matvec(frame, _behind(link, frame.ndim - 2))


@fused_separately
def _turned(frame: Array, turn: Array) -> Array:
    return vec3.matmul(frame, turn)


@fused_separately
def _twist(reached: Array, point: Array, position: Array, rotation: Array, scale: Array) -> Array:
    x, y, z = (vec3.cross(reached[:, i], rotation[:, i]) for i in range(3))
    cosine = 0.5 * (sum(vec3.dot(reached[:, i], rotation[:, i]) for i in range(3)) - 1.0)
    # Sine of the angle along its axis, over (1 + cosine) / 2: 2 tan(angle / 2), bounded near half a turn.
    along = (x + y + z) / jnp.maximum(1.0 + cosine, 0.2)
    return jnp.concatenate([scale * (position - point), along])


@fused_separately
def _columns(axes: Array, points: Array, point: Array, scale: Array) -> Array:
    return jnp.concatenate([scale * vec3.cross(axes, point[:, None] - points), axes])


def damped_step(jacobian: Array, twist: Array, damping: Array) -> Array:
    """Return the step of the free joints ``(6, ..., n)`` by least squares with damping ``(..., n)``."""
    return _solve(_normal(jacobian, twist[:, None], damping))[:, 0]


@fused_separately
def _normal(jacobian: Array, right: Array, damping: Array) -> Array:
    """Normal equations with right-hand sides ``(6, k, ..., n)`` behind the matrix."""
    both = jnp.concatenate([jacobian, right], axis=1)
    product = jacobian[0][:, None] * both[0][None]
    for row in range(1, 6):
        product = product + jacobian[row][:, None] * both[row][None]
    eye = jnp.eye(6, both.shape[1], dtype=damping.dtype)
    return product + _behind(eye, damping.ndim) * damping


def _solve(equations: Array) -> Array:
    """Solve symmetric positive equations ``(6, 6 + k, ..., n)`` by elimination, row by row."""
    rows = []
    for _ in range(5):
        rows.append(equations[0, :])
        equations = _eliminated(equations)
    rows.append(equations[0, :])
    solved = (rows[5][1:] / rows[5][0])[None]
    for row in rows[4::-1]:
        solved = _substituted(row, solved)
    return solved


@fused_separately
def _eliminated(equations: Array) -> Array:
    first, others = equations[0], equations[1:]
    return others[:, 1:] - (others[:, :1] / first[:1]) * first[1:]


@fused_separately
def _substituted(row: Array, solved: Array) -> Array:
    """Solve one more row, whose unknowns but the first are known."""
    count = solved.shape[0]
    total = row[1 + count :]
    for i in range(count):
        total = total - row[1 + i] * solved[i]
    return jnp.concatenate([(total / row[0])[None], solved])


def refined(arm: RefinedArm, q: Array, position: Array, rotation: Array) -> Array:
    """Return joint angles ``(7, m)`` refined onto their targets ``(3, m)`` and ``(3, 3, m)``.

    The first steps are taken in single precision, whose error the last ones remove. Then the columns are sorted by
    their error and refined block by block, so that a block stops as soon as its own columns are done.
    """
    columns = q.shape[-1]
    block = min(BLOCK, columns)
    # The last block is filled with copies of the last column.
    fill = jnp.minimum(jnp.arange(-(-columns // block) * block), columns - 1)
    q, position, rotation = (x[..., fill] for x in (q, position, rotation))
    q = _in_blocks(_rough_steps, arm, (q, position, rotation))
    order = jnp.argsort(_size2(miss(arm, q, position, rotation).twist))
    blocks = q[:, order], position[:, order], rotation[:, :, order]
    return jnp.zeros_like(q).at[:, order].set(_in_blocks(_last_steps, arm, blocks))[:, :columns]


def _in_blocks(steps: Callable, arm: RefinedArm, columns: tuple[Array, ...]) -> Array:
    """Apply a function of columns to blocks of them."""
    total = columns[0].shape[-1]
    if total <= BLOCK:
        return steps(arm, *columns)
    split = tuple(jnp.moveaxis(x.reshape(*x.shape[:-1], total // BLOCK, BLOCK), -2, 0) for x in columns)
    done = jax.lax.map(lambda block: steps(arm, *block), split)
    return jnp.moveaxis(done, 0, -2).reshape(7, total)


def _rough_steps(arm: RefinedArm, q: Array, position: Array, rotation: Array) -> Array:
    dtype = q.dtype
    single = jax.tree.map(lambda x: x.astype(jnp.float32), (arm, position, rotation))

    def step(_: Array, q: Array) -> Array:
        now = miss(single[0], q, *single[1:])
        return _stepped(arm, q, damped_step(now.jacobian, now.twist, _damping(_size2(now.twist))))

    rough = jax.lax.fori_loop(0, ROUGH_STEPS, step, q.astype(jnp.float32)).astype(dtype)
    # The held joint keeps all of its digits.
    held = jnp.arange(7)[:, None] == arm.outer_joint
    return jnp.where(held, q, rough)


def _last_steps(arm: RefinedArm, q: Array, position: Array, rotation: Array) -> Array:
    least = (0.01 * converged_within(q.dtype)) ** 2

    def unfinished(state: tuple[Array, ...]) -> Array:
        return (state[0] < LAST_STEPS) & jnp.any(state[3])

    def step(state: tuple[Array, ...]) -> tuple[Array, ...]:
        count, q, before, open_ = state
        now = miss(arm, q, position, rotation)
        size2 = _size2(now.twist)
        # A column whose error is large and no longer falls is in a minimum of it, and one on its target is done: it
        # stays, so that its result does not depend on the others.
        falls = (count < 4) | (size2 < 0.9 * before) | (size2 < SMALL**2)
        open_ = open_ & falls & (size2 > least)
        change = damped_step(now.jacobian, now.twist, _damping(size2))
        return count + 1, jnp.where(open_, _stepped(arm, q, change), q), size2, open_

    start = jnp.int32(0), q, jnp.full_like(q[0], jnp.inf), jnp.ones_like(q[0], bool)
    return jax.lax.while_loop(unfinished, step, start)[1]


def converged_within(dtype: jnp.dtype) -> float:
    """Largest error of a solution, arm lengths and rad: 1.6e-10 in float64, 4.7e-5 in float32."""
    return float(jnp.finfo(dtype).eps) ** 0.625


def _size2(twist: Array) -> Array:
    return jnp.sum(twist * twist, axis=0)


def _damping(size2: Array) -> Array:
    return DAMPING * jnp.minimum(size2, 1.0) + 30.0 * float(jnp.finfo(size2.dtype).eps)


@fused_separately
def _stepped_by(q: Array, change: Array) -> Array:
    return q + change * jnp.minimum(1.0, LONGEST_STEP / jnp.maximum(jnp.max(jnp.abs(change), axis=0), LONGEST_STEP))


def _stepped(arm: RefinedArm, q: Array, change: Array) -> Array:
    return _stepped_by(q, with_held(arm, change))


def with_held(arm: RefinedArm, free: Array) -> Array:
    """Return values of the free joints ``(6, ..., n)`` with a zero for the one that is held, ``(7, ..., n)``."""
    still = jnp.zeros_like(free[:1])
    return jnp.concatenate([free, still] if arm.outer_joint else [still, free])


def least_pivot(jacobian: Array) -> Array:
    """Return the root of the least pivot of the normal equations, ``(..., n)``: zero where the Jacobian is singular.

    It is at least the least singular value, and at most sqrt(6) times that if it is the last pivot.
    """
    equations = _normal(jacobian, jacobian[:, :0], jnp.zeros_like(jacobian[0, 0]))
    pivots = [equations[0, 0]]
    for _ in range(5):
        equations = _eliminated(equations)
        pivots.append(equations[0, 0])
    return clipped_sqrt(jnp.min(jnp.stack(pivots), axis=0))


class Weakest(NamedTuple):
    """The motion of the free joints that moves the tool least.

    Attributes:
        direction: Unit joint velocity, ``(6, ..., n)``.
        rate: Twist of the tool per unit of it, ``(6, ..., n)``; its length is the least singular value.
    """

    direction: Array
    rate: Array


def weakest(jacobian: Array) -> Weakest:
    """Return the weakest motion, by inverse iteration from the best of the unit vectors."""
    floor = jnp.full_like(jacobian[0, 0], 30.0 * float(jnp.finfo(jacobian.dtype).eps))
    eye = jnp.broadcast_to(_behind(jnp.eye(6, dtype=floor.dtype), floor.ndim), jacobian.shape)
    # The identity as right-hand sides of the normal equations themselves, not of the least squares problem.
    square = _normal(jacobian, jnp.zeros_like(jacobian[:, :0]), floor)
    inverse = _solve(jnp.concatenate([square, eye], axis=1))
    return Weakest(*_strongest(inverse, jacobian))


@fused_separately
def _strongest(inverse: Array, jacobian: Array) -> tuple[Array, Array]:
    """The direction that a symmetric matrix stretches most, and the twist that it makes."""
    diagonal = jnp.stack([inverse[i, i] for i in range(6)])
    best = jnp.argmax(diagonal, axis=0)
    v = jnp.take_along_axis(inverse, best[None, None], axis=1)[:, 0]
    for _ in range(3):
        v = v / jnp.sqrt(jnp.sum(v * v, axis=0))
        v = _times(inverse, v)
    v = v / jnp.sqrt(jnp.sum(v * v, axis=0))
    return v, _times(jacobian, v)


def _times(matrix: Array, v: Array) -> Array:
    """Product of a matrix ``(6, 6, ...)`` and a vector ``(6, ...)``."""
    product = matrix[:, 0] * v[0]
    for i in range(1, 6):
        product = product + matrix[:, i] * v[i]
    return product


def partners(arm: RefinedArm, q: Array, position: Array, rotation: Array) -> Array:
    """Return the guess of a second solution for each one: across the fold that its weakest motion leads to.

    Along the weakest motion the tool leaves its target as t rate + t² bend / 2, which vanishes again at the other root,
    t = -2 rate² / (rate · bend). It is where the solution goes that a nearby arm has not, or has twice. A guess needs
    single precision only.
    """
    arm, single, position, rotation = jax.tree.map(lambda x: x.astype(jnp.float32), (arm, q, position, rotation))
    now = miss(arm, single, position, rotation)
    motion = weakest(now.jacobian)
    h = float(jnp.finfo(jnp.float32).eps) ** 0.25
    ahead, behind = (
        miss(arm, single + s * h * with_held(arm, motion.direction), position, rotation).twist for s in (1.0, -1.0)
    )
    return q + with_held(arm, _across(now.twist, ahead, behind, h, *motion)).astype(q.dtype)


def _across(twist: Array, ahead: Array, behind: Array, h: float, direction: Array, rate: Array) -> Array:
    bend = (2.0 * twist - ahead - behind) / (h * h)
    product = jnp.sum(rate * bend, axis=0)
    least = float(jnp.finfo(twist.dtype).tiny) ** 0.5
    t = -2.0 * jnp.sum(rate * rate, axis=0) / jnp.where(jnp.abs(product) < least, least, product)
    return jnp.clip(t, -FARTHEST_PARTNER, FARTHEST_PARTNER) * direction


def _behind(constant: Array, batch: int) -> Array:
    """A constant with batch axes of length one behind it."""
    return constant.reshape(constant.shape + (1,) * batch)
