"""The nearest posture on target of arms without circles of the elbow: a grid of the parameter, then descents.

1. Postures at ``NODES`` parameters, in every branch the arm's solver has. Where one is nearer than its neighbors in the
   branch, a minimum may lie between these, nearer by no more than they are apart: that bounds it, but for curvature.
2. From such nodes, the lowest bound first, and from the present posture, descents along the self-motion in joint space
   (:mod:`jaxik.redundancy.tangent`): each step is Newton's for the motion, cut where a limit, the keep-out or an
   obstacle is met, so that it converges quadratically both inside an interval and at its end. Where branches meet,
   nothing ends.
3. Lanes take row after row, and go through its nodes until the bound exceeds the least motion found.

A minimum that no node leads to is missed; the tests measure how often. All that is asked of an arm is its solver at a
parameter.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxik.arm import Arm
from jaxik.ik import Status, all_branches
from jaxik.numerics import fused_separately, tolerances
from jaxik.obstacles import in_rows, room_at_nodes, rooms
from jaxik.redundancy.nearness import TURN, from_lower
from jaxik.redundancy.tangent import Tangent, tangent, way_within

NODES = 64  # of the parameter, 5.6 degrees apart on a whole circle
STARTS = 16  # of a row at most
STEPS, SETTLING = 20, 5  # of a descent at most, and the last of them, which only lead onto the target
TRIAL = 4  # steps after which a descent that leads to more motion than another is given up
SHARE, LANES = 4, 32  # one lane for so many rows, and at least so many
TRUST = 0.3  # rad along the curve: the longest step
TURNED = 0.4  # rad by which a step may turn the curve's direction
_OUTSIDE = 0.1  # rad; violation that a curve may bring to nothing between nodes
_STRAY = 60.0  # rad; cost of a violation by a radian, more than any motion gains, for the choice of starts
_FAR = 0.3  # rad between nodes, which have a start between them
_WIDEST = 1.0  # rad between nodes; beyond, a bound says nothing


class Wanted(NamedTuple):
    """Targets, present postures and weights of n rows.

    Attributes:
        position: Tool points, ``(3, n)`` [m].
        directions: Rotations, ``(3, 3, n)``.
        q_now: Present joint angles, ``(joint, n)`` [rad].
        weights: Weights of the squared joint motion, ``(joint,)``.
    """

    position: Array
    directions: Array
    q_now: Array
    weights: Array


class Found(NamedTuple):
    """The nearest posture found of n rows.

    Attributes:
        q: Joint angles, ``(joint, n)`` [rad].
        stage: Index of the ranges it is in; their number where none was found, ``(n,)``.
    """

    q: Array
    stage: Array


def parameter_nodes(arm: Arm, count: int) -> Array:
    """Return parameters in the middle of equal cells of the range of the parameter, ``(count,)`` [rad]."""
    low, high = jnp.asarray(-jnp.pi, arm.lower.dtype), jnp.asarray(jnp.pi, arm.lower.dtype)
    joint = getattr(arm, "outer_joint", None)
    if joint is not None:
        inside = arm.upper[joint] - arm.lower[joint] < TURN
        low = jnp.where(inside, arm.lower[joint], low)
        high = jnp.where(inside, arm.upper[joint], high)
    return low + (high - low) * (jnp.arange(count, dtype=low.dtype) + 0.5) / count


def nearest_in_stages(arm: Arm, wanted: Wanted, lower: Array, upper: Array, kept_out: tuple[bool, ...]) -> Found:
    """Return the nearest posture in the first of several ranges that holds any.

    Args:
        arm: The arm; the world about its body, if it has one, has its rows last.
        wanted: Targets, present posture and weights.
        lower: Lower ends of the ranges, ``(stage, joint, n)`` [rad].
        upper: Upper ends, at most a turn above [rad].
        kept_out: For each stage, whether the elbow is kept out of its half-spaces, and the arm's body from obstacles.
    """
    n = wanted.q_now.shape[-1]
    nodes = parameter_nodes(arm, NODES)
    q, status = _postures(arm, wanted, nodes)
    depth = _depth(arm, q)
    stages = len(kept_out)
    keeps = jnp.asarray(kept_out)

    def search(state: tuple[Array, Found]) -> tuple[Array, Found]:
        stage, found = state
        low, high = lower[stage], upper[stage]
        starts = _starts(wanted, low, high, q, status, jnp.where(keeps[stage], depth, 0.0))
        unsettled = found.stage == stages
        best, moved = _descended(arm, wanted, low, high, keeps[stage], starts, unsettled)
        new = unsettled & jnp.isfinite(moved)
        return stage + 1, Found(jnp.where(new, best, found.q), jnp.where(new, stage, found.stage))

    def unfinished(state: tuple[Array, Found]) -> Array:
        stage, found = state
        return (stage < stages) & jnp.any(found.stage == stages)

    none = Found(wanted.q_now, jnp.full((n,), stages, jnp.int32))
    return lax.while_loop(unfinished, search, (jnp.zeros((), jnp.int32), none))[1]


def _postures(arm: Arm, wanted: Wanted, nodes: Array) -> tuple[Array, Array]:
    """Joint angles ``(joint, branch, nodes, n)`` at the nodes, and which are on target ``(branch, nodes, n)``."""
    k, n = len(nodes), wanted.position.shape[-1]

    def repeated(x: Array) -> Array:
        return jnp.broadcast_to(x[..., None, :], (*x.shape[:-1], k, n)).reshape(*x.shape[:-1], k * n)

    solved = all_branches(arm, repeated(wanted.position), repeated(wanted.directions), jnp.repeat(nodes, n))
    q, status = solved.q, solved.status
    q = jnp.moveaxis(q.reshape(*q.shape[:2], k, n), 1, 0)
    return q, status.reshape(-1, k, n)


def _depth(arm: Arm, q: Array) -> Array:
    """Depth of the body inside something at nodes ``(joint, branch, nodes, n)`` [arm lengths]; zero without one."""
    if arm.surroundings is None:
        return jnp.zeros(q.shape[1:], q.dtype)
    return jnp.maximum(-room_at_nodes(arm, q), 0.0)


class _Starts(NamedTuple):
    """Postures to descend from, those of the least bound first.

    Attributes:
        q: Joint angles, ``(joint, STARTS, n)`` [rad].
        bound: Bound of the motion, ``(STARTS, n)`` [rad²]; infinite for none.
    """

    q: Array
    bound: Array


class _Nodes(NamedTuple):
    """Postures of the nodes in the turns of the ranges.

    Attributes:
        q: Joint angles, ``(joint, branch, nodes, n)`` [rad].
        motion: Their weighted squared motion, ``(branch, nodes, n)`` [rad²].
        stray: Largest violation of a range, likewise [rad].
        apart: Weighted squared distance to the next node, ``(branch, nodes - 1, n)`` [rad²].
        step: Largest motion of a joint to it, likewise [rad].
    """

    q: Array
    motion: Array
    stray: Array
    apart: Array
    step: Array


@fused_separately
def _in_turns(wanted: Wanted, lower: Array, upper: Array, q: Array) -> _Nodes:
    """Postures of nodes in the turns of the ranges."""
    turned, (motion, stray, apart, longest) = [], [jnp.zeros((), q.dtype)] * 4
    for joint in range(len(q)):
        low, high, weight = lower[joint], upper[joint], wanted.weights[joint]
        angle = from_lower(q[joint], low)
        beyond, short = angle - high, low + TURN - angle
        angle = jnp.where((beyond > 0.0) & (short < beyond), angle - TURN, angle)
        off, step = angle - wanted.q_now[joint], angle[:, 1:] - angle[:, :-1]
        motion, apart = motion + weight * off * off, apart + weight * step * step
        stray = jnp.maximum(stray, jnp.maximum(low - angle, angle - high))
        longest = jnp.maximum(longest, jnp.abs(step))
        turned.append(angle)
    return _Nodes(jnp.stack(turned), motion, jnp.maximum(stray, 0.0), apart, longest)


@fused_separately
def _bounds(nodes: _Nodes, status: Array, depth: Array) -> Array:
    """Bounds of the motions that descents may lead to, infinite where none is to begin, ``(2, branch, nodes, n)``.

    From nodes lower than their neighbors, and from the middles between nodes far apart. What is farther outside its
    range than a joint turns from node to node stays outside.
    """
    motion = jnp.where(status <= Status.KEEP_OUT, nodes.motion, jnp.inf)
    rank = motion + _STRAY * (nodes.stray + depth)
    none = jnp.full_like(rank[:, :1], jnp.inf)

    def before(x: Array, first: Array) -> Array:
        return jnp.concatenate([first, x], axis=1)

    def behind(x: Array, last: Array) -> Array:
        return jnp.concatenate([x, last], axis=1)

    zero = jnp.zeros_like(none)
    apart = jnp.minimum(nodes.apart, _WIDEST)
    widest = jnp.maximum(before(apart, zero), behind(apart, zero))
    step = jnp.maximum(before(nodes.step, zero), behind(nodes.step, zero))
    root = jnp.sqrt(motion)
    lowest = (rank <= before(rank[:, :-1], none)) & (rank <= behind(rank[:, 1:], none))
    lowest &= nodes.stray <= _OUTSIDE + 1.5 * step
    at_nodes = jnp.where(lowest, jnp.maximum(root - jnp.sqrt(widest), 0.0) ** 2, jnp.inf)
    ahead, step = behind(apart, zero), behind(nodes.step, zero)
    between = jnp.maximum(0.5 * (root + behind(root[:, 1:], none) - jnp.sqrt(ahead)), 0.0) ** 2
    far = (ahead > _FAR**2) & (jnp.minimum(nodes.stray, behind(nodes.stray[:, 1:], none)) <= _OUTSIDE + step)
    return jnp.stack([at_nodes, jnp.where(far, between, jnp.inf)])


def _starts(wanted: Wanted, lower: Array, upper: Array, q: Array, status: Array, depth: Array) -> _Starts:
    at = _in_turns(wanted, lower, upper, q)
    n, nodes = q.shape[-1], q.shape[1] * q.shape[2]
    bound, pick = _least(_bounds(at, status, depth).reshape(-1, n), STARTS - 1)
    node = pick % nodes
    behind = jnp.minimum(node + pick // nodes, nodes - 1)
    first, last = (jnp.take_along_axis(at.q.reshape(len(q), -1, n), x[None], axis=1) for x in (node, behind))
    present = jnp.clip(wanted.q_now, lower, jnp.maximum(lower, upper))[:, None]
    none = jnp.zeros((1, n), bound.dtype)
    return _Starts(jnp.concatenate([present, 0.5 * (first + last)], axis=1), jnp.concatenate([none, bound]))


def _least(values: Array, count: int) -> tuple[Array, Array]:
    """The least of values ``(m, n)`` and their places, ``(count, n)`` each; far faster than sorting rows."""
    places = jnp.arange(len(values), dtype=jnp.int32)[:, None]

    def pick(values: Array, _: None) -> tuple[Array, tuple[Array, Array]]:
        least = jnp.min(values, axis=0)
        place = jnp.min(jnp.where(values == least, places, len(values)), axis=0)
        return jnp.where(places == place, jnp.inf, values), (least, place)

    return lax.scan(pick, values, None, length=count)[1]


class _Lanes(NamedTuple):
    """Descents in k lanes, each of one row at a time.

    Attributes:
        row: Row of each lane, ``(k,)``; n in a lane that has none.
        start: Index of the start it came from, ``(k,)``.
        steps: Steps of the descent, ``(k,)``.
        q: Joint angles, ``(joint, k)`` [rad].
        best: The row's nearest posture so far, ``(joint, k)`` [rad].
        moved: Its motion, ``(k,)`` [rad²].
    """

    row: Array
    start: Array
    steps: Array
    q: Array
    best: Array
    moved: Array


def _descended(
    arm: Arm, wanted: Wanted, lower: Array, upper: Array, keep_out: Array, starts: _Starts, open_rows: Array
) -> tuple[Array, Array]:
    """Return the nearest posture of each open row, ``(joint, n)``, and its motion, infinite where none was found."""
    joints, n = wanted.q_now.shape
    last = STARTS - 1
    k = min(n, max(LANES, -(-n // SHARE)))
    queue = jnp.argsort(~open_rows, stable=True).astype(jnp.int32)
    count = jnp.sum(open_rows, dtype=jnp.int32)

    def step(state: tuple[_Lanes, Array, Array, Array]) -> tuple[_Lanes, Array, Array, Array]:
        lanes, taken, best, moved = state
        at = jnp.minimum(lanes.row, n - 1)
        own = Wanted(wanted.position[:, at], wanted.directions[..., at], wanted.q_now[:, at], wanted.weights)
        curve = tangent(arm, own.position, own.directions, lanes.q)
        low, high = lower[:, at], upper[:, at]
        settles = lanes.steps >= STEPS - SETTLING
        if arm.surroundings is not None:
            curve = _with_bodies(in_rows(arm, lambda x: x[..., at]), curve, lanes.q)
        q, length, motion, fits = _step(arm, own, low, high, keep_out, settles, lanes.q, curve)
        nearer = fits & (motion < lanes.moved)
        lanes = lanes._replace(
            best=jnp.where(nearer, q, lanes.best),
            moved=jnp.where(nearer, motion, lanes.moved),
            q=q,
            steps=lanes.steps + 1,
        )
        still = length <= _converged(q.dtype)
        lost = (lanes.steps >= TRIAL) & ((motion > lanes.moved) | (curve.error > TRUST**2))
        ended = still | lost | (lanes.steps >= STEPS)
        start = jnp.where(ended, lanes.start + 1, lanes.start)
        next_bound = starts.bound[jnp.minimum(start, last), at]
        through = (lanes.row == n) | (ended & ((start > last) | ~(next_bound < lanes.moved)))
        home = jnp.where(through, lanes.row, n)
        best = best.at[:, home].set(lanes.best, mode="drop")
        moved = moved.at[home].set(lanes.moved, mode="drop")
        turn = taken + jnp.cumsum(through, dtype=jnp.int32) - 1
        fresh = through & (turn < count)
        row = jnp.where(fresh, queue[jnp.minimum(turn, n - 1)], jnp.where(through, n, lanes.row))
        start = jnp.where(fresh, 0, start)
        begins = fresh | (ended & ~through)
        at = jnp.minimum(row, n - 1)
        lanes = _Lanes(
            row,
            start,
            jnp.where(begins, 0, lanes.steps),
            jnp.where(begins, starts.q[:, jnp.minimum(start, last), at], lanes.q),
            lanes.best,
            jnp.where(fresh, jnp.inf, lanes.moved),
        )
        return lanes, jnp.minimum(taken + jnp.sum(through, dtype=jnp.int32), count), best, moved

    zero, dtype = jnp.zeros((k,), jnp.int32), wanted.q_now.dtype
    nothing = jnp.zeros((joints, k), dtype)
    lanes = _Lanes(zero + n, zero, zero, nothing, nothing, jnp.full((k,), jnp.inf, dtype))
    state = lanes, jnp.zeros((), jnp.int32), wanted.q_now, jnp.full((n,), jnp.inf, dtype)
    busy = lambda s: (s[1] < count) | jnp.any(s[0].row < n)  # noqa: E731
    return lax.while_loop(busy, step, state)[2:]


def _with_bodies(arm: Arm, at: Tangent, q: Array) -> Tangent:
    """The self-motion with the distances of the body's spheres beside those of the elbow."""
    room, rate = jax.jvp(lambda q: rooms(arm, q, arm.surroundings.world), (q,), (at.direction,))
    return at._replace(room=jnp.concatenate([at.room, room]), room_rate=jnp.concatenate([at.room_rate, rate]))


def _converged(dtype: jnp.dtype) -> float:
    """Length of a step whose square is rounding [rad]."""
    return 0.1 * float(jnp.finfo(dtype).eps) ** 0.5


@fused_separately
def _step(
    arm: Arm, wanted: Wanted, lower: Array, upper: Array, keep_out: Array, settles: Array, q: Array, at: Tangent
) -> tuple[Array, Array, Array, Array]:
    """The next posture of every lane, the length of the step, the motion there, and whether it can be taken."""
    weights = wanted.weights[:, None]
    far = jnp.sqrt(_sum(at.correction * at.correction))
    onto = q + jnp.minimum(1.0, TRUST / jnp.maximum(far, TRUST)) * at.correction
    off = onto - wanted.q_now
    slope = _sum(weights * off * at.direction)
    curvature = _sum(weights * (at.direction * at.direction + off * at.bend))
    convex = curvature > 0.0
    longest = jnp.minimum(TRUST, TURNED / jnp.maximum(jnp.sqrt(_sum(at.bend * at.bend)), TURNED))
    move = jnp.where(convex, -slope / jnp.where(convex, curvature, 1.0), -longest * jnp.sign(slope))
    move = jnp.where(settles, 0.0, move)
    low, high = way_within(at.direction, lower - onto, upper - onto)
    least, most = jnp.max(low, axis=0), jnp.min(high, axis=0)
    low, high = way_within(at.room_rate, jnp.where(keep_out, -at.room, -jnp.inf), jnp.full_like(at.room, jnp.inf))
    least = jnp.maximum(least, jnp.max(low, axis=0, initial=-jnp.inf))
    most = jnp.minimum(most, jnp.min(high, axis=0, initial=jnp.inf))
    move = jnp.where(least <= most, jnp.clip(move, least, most), 0.5 * (least + most))
    move = jnp.clip(jnp.where(jnp.isfinite(move), move, 0.0), -longest, longest)
    new = onto + move * at.direction + 0.5 * move * move * at.bend
    slack = tolerances(q.dtype).near_singular ** 1.5
    fits = jnp.all((new >= lower - slack) & (new <= upper + slack), axis=0)
    fits &= jnp.all(at.room + move * at.room_rate >= -slack * arm.length, axis=0) | ~keep_out
    length = jnp.max(jnp.abs(new - q), axis=0)
    fits &= length <= 1e2 * _converged(q.dtype)
    settled = jnp.where(fits, jnp.clip(new, lower, jnp.maximum(lower, upper)), new)
    return settled, length, _sum(weights * (settled - wanted.q_now) ** 2), fits


def _sum(x: Array) -> Array:
    return functools.reduce(jnp.add, list(x))
