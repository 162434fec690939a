"""The feasible angles of an outer joint, per branch: intervals of its circle.

1. The room of every branch (see :mod:`jaxik.redundancy.outer_joint_motion`) is taken at ``NODES`` angles, and at more
   between those at which a joint turns fast, as near an alignment.
2. An interval or gap between two nodes shows as a local extremum of the room at a node next to it: from each such node
   that is near to zero, the extremum itself is searched by golden sections.
3. Every change of sign is followed to its root: halving, then secants, and one step of Newton's method, which also has
   the derivative of the root.

There is no bound on the room's rate, which is infinite where two roots meet: what has two extrema between neighboring
nodes can be missed. Agreement with sweeps is measured by the tests.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxik.arm import OuterJointArm
from jaxik.numerics import fused_separately, principal
from jaxik.redundancy.outer_joint_motion import postures, room_in_branch

NODES = 128  # cells of 2.8 degrees
SPLIT, PARTS, ROUNDS = 24, 8, 2  # cells that are divided, into how many, and how often
EXTREMA = 16  # extrema of a target searched, those nearest to zero
CHANGES = 72  # changes of sign of a target between nodes
ARCS = 8  # places per branch
Held = tuple[OuterJointArm, Array, Array]
_GOLDEN = 0.5 * (5**0.5 - 1)
_SECTIONS = 24  # of a bracket of 0.1 rad: to 1e-6 rad
_HALVINGS, _SECANTS = 12, 5


class Brackets(NamedTuple):
    """Angles on both sides of borders of a target, ``(k, n)`` each.

    Attributes:
        low: Angle before the border [rad].
        high: Angle behind it [rad].
        branch: Branch.
        rising: True where the branch is feasible behind the border.
        valid: True for places that hold a border.
    """

    low: Array
    high: Array
    branch: Array
    rising: Array
    valid: Array


def parameter_arcs(arm: OuterJointArm, position: Array, directions: Array) -> tuple[Array, Array, Array]:
    """Return start, end and validity of the feasible intervals, ``(8, ARCS, n)`` each, for targets ``(3, n)``."""
    dtype, n = position.dtype, position.shape[-1]
    held: Held = jax.lax.stop_gradient((arm, position, directions))
    nodes = jnp.linspace(-jnp.pi, jnp.pi, NODES, endpoint=False, dtype=dtype)
    nodes = jnp.broadcast_to(nodes[:, None], (NODES, n))
    q, room = postures(*held, nodes)
    for _ in range(ROUNDS):
        nodes, q, room = _divided(held, nodes, q, room)
    brackets = [changes(nodes, room), _hidden(held, nodes, room)]
    found = jax.tree.map(lambda *x: jnp.concatenate(x), *brackets)
    roots = _root(held, found)
    roots = _with_derivative(arm, position, directions, found.branch, roots)
    return arcs_between(found, roots, room[:, 0] >= 0.0)


def any_within(arm: OuterJointArm, position: Array, directions: Array) -> Array:
    """Return for which targets ``(3, n)`` any branch is feasible at any node, ``(n,)``."""
    nodes = jnp.linspace(-jnp.pi, jnp.pi, NODES, endpoint=False, dtype=position.dtype)
    _, room = postures(arm, position, directions, jnp.broadcast_to(nodes[:, None], (NODES, position.shape[-1])))
    return jnp.any(room >= 0.0, axis=(0, 1))


def _divided(held: Held, nodes: Array, q: Array, room: Array) -> tuple[Array, Array, Array]:
    """Nodes ``(k, n)`` in order, postures and room, with the cells divided in which a joint turns the most."""
    turned = jnp.max(jnp.abs(principal(jnp.roll(q, -1, axis=2) - q)), axis=(0, 1))
    _, cell = jax.lax.top_k(turned.T, SPLIT)
    low = jnp.take_along_axis(nodes, cell.T, axis=0)
    width = jnp.take_along_axis(_next(nodes) - nodes, cell.T, axis=0)
    parts = jnp.arange(1, PARTS, dtype=nodes.dtype)[:, None, None] / PARTS
    more = (low + parts * width).reshape(-1, nodes.shape[1])
    more_q, more_room = postures(*held, more)
    nodes = jnp.concatenate([nodes, more])
    order = jnp.argsort(nodes, axis=0)
    q, room = jnp.concatenate([q, more_q], axis=2), jnp.concatenate([room, more_room], axis=1)
    return (
        jnp.take_along_axis(nodes, order, axis=0),
        jnp.take_along_axis(q, order[None, None], axis=2),
        jnp.take_along_axis(room, order[None], axis=1),
    )


def _next(nodes: Array) -> Array:
    """The next node of each, round the circle."""
    return jnp.concatenate([nodes[1:], nodes[:1] + 2 * jnp.pi])


def changes(nodes: Array, room: Array, count: int = CHANGES) -> Brackets:
    """Neighboring nodes between which a branch changes; ``room (branches, nodes, n)`` is negative where infeasible."""
    inside = room >= 0.0
    changes = inside != jnp.roll(inside, -1, axis=1)
    score = jnp.where(changes, 1.0, 0.0).astype(room.dtype)
    valid, branch, node = _largest(score, count)
    low, high = (jnp.take_along_axis(x, node, axis=0) for x in (nodes, _next(nodes)))
    return Brackets(low, high, branch, ~_picked(inside, branch, node), valid > 0.0)


def _hidden(held: Held, nodes: Array, room: Array) -> Brackets:
    """Both sides of intervals and gaps that no node lies in."""
    inside = room >= 0.0
    sign = jnp.where(inside, -1.0, 1.0).astype(room.dtype)
    toward = sign * room  # negative, and nearer to zero toward a hidden change
    peak = (toward >= sign * jnp.roll(room, 1, axis=1)) & (toward >= sign * jnp.roll(room, -1, axis=1))
    score, branch, node = _largest(jnp.where(peak, toward, -jnp.inf), EXTREMA)
    up = _picked(sign, branch, node)
    before = jnp.concatenate([nodes[-1:] - 2 * jnp.pi, nodes[:-1]])
    low, middle, high = (jnp.take_along_axis(x, node, axis=0) for x in (before, nodes, _next(nodes)))
    ends = low, high

    def height(x: Array) -> Array:
        return up * room_in_branch(*held, branch, x)

    def section(_: Array, state: tuple[Array, ...]) -> tuple[Array, ...]:
        low, high, x1, x2, f1, f2 = state
        left = f1 >= f2
        low, high = jnp.where(left, low, x1), jnp.where(left, x2, high)
        fresh = jnp.where(left, high - _GOLDEN * (high - low), low + _GOLDEN * (high - low))
        value = height(fresh)
        x1, x2 = jnp.where(left, fresh, x2), jnp.where(left, x1, fresh)
        f1, f2 = jnp.where(left, value, f2), jnp.where(left, f1, value)
        return low, high, x1, x2, f1, f2

    first, second = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    start = low, high, first, second, height(first), height(second)
    *_, x1, x2, f1, f2 = jax.lax.fori_loop(0, _SECTIONS, section, start)
    top, value = jnp.where(f1 >= f2, x1, x2), jnp.maximum(f1, f2)
    found = (score > -jnp.inf) & (value > 0.0)
    before, behind = jnp.where(top > middle, middle, ends[0]), jnp.where(top > middle, ends[1], middle)
    opens = up > 0.0
    parts = (before, top, opens), (top, behind, ~opens)
    sides = [Brackets(a, b, branch, rising, found) for a, b, rising in parts]
    return jax.tree.map(lambda *x: jnp.concatenate(x), *sides)


def _largest(score: Array, count: int) -> tuple[Array, Array, Array]:
    """The largest of scores ``(8, nodes, n)``, their branches and nodes, ``(count, n)`` each."""
    flat = jnp.moveaxis(score.reshape(-1, score.shape[-1]), 0, -1)
    value, index = jax.lax.top_k(flat, count)
    value, index = value.T, index.T.astype(jnp.int32)
    return value, index // score.shape[1], index % score.shape[1]


def _picked(x: Array, branch: Array, node: Array) -> Array:
    """Entries of ``(8, nodes, n)`` at branches and nodes ``(count, n)``."""
    flat = x.reshape(-1, x.shape[-1])
    return jnp.take_along_axis(flat, branch * x.shape[1] + node, axis=0)


def _root(held: Held, brackets: Brackets) -> Array:
    """Follow every border to where the room vanishes."""
    sign = jnp.where(brackets.rising, 1.0, -1.0).astype(brackets.low.dtype)

    def value(x: Array) -> Array:
        return sign * room_in_branch(*held, brackets.branch, x)

    def halve(_: Array, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = ends
        middle = 0.5 * (low + high)
        below = value(middle) < 0.0
        return jnp.where(below, middle, low), jnp.where(below, high, middle)

    low, high = jax.lax.fori_loop(0, _HALVINGS, halve, (brackets.low, brackets.high))

    def secant(_: Array, state: tuple[Array, ...]) -> tuple[Array, ...]:
        low, high, f_low, f_high = state
        drop = f_high - f_low
        x = jnp.where(drop > 0.0, low - f_low * (high - low) / jnp.where(drop > 0.0, drop, 1.0), 0.5 * (low + high))
        x = jnp.clip(x, low, high)
        f = value(x)
        below = f < 0.0
        # Illinois: the end that stays counts half, so that both ends close in.
        f_low, f_high = jnp.where(below, f, 0.5 * f_low), jnp.where(below, 0.5 * f_high, f)
        return jnp.where(below, x, low), jnp.where(below, high, x), f_low, f_high

    low, high, f_low, f_high = jax.lax.fori_loop(0, _SECANTS, secant, (low, high, value(low), value(high)))
    return jnp.where(-f_low < f_high, low, high)


def _with_derivative(arm: OuterJointArm, position: Array, directions: Array, branch: Array, root: Array) -> Array:
    """The roots after a step of Newton's method whose derivative is theirs (implicit function theorem)."""
    root = jax.lax.stop_gradient(root)

    def room(x: Array) -> Array:
        return room_in_branch(arm, position, directions, branch, x)

    value, slope = jax.jvp(room, (root,), (jnp.ones_like(root),))
    slope = jax.lax.stop_gradient(slope)
    step = value / jnp.where(slope == 0.0, 1.0, slope)
    small = jax.lax.stop_gradient(jnp.isfinite(step) & (slope != 0.0) & (jnp.abs(step) < 1e-6))
    return root - jnp.where(small, step, 0.0)


@fused_separately
def arcs_between(found: Brackets, roots: Array, first: Array) -> tuple[Array, Array, Array]:
    """Pair every start with the next end round the circle; ``first`` says which branches are feasible at -pi."""
    mine = found.valid & (found.branch == jnp.arange(len(first), dtype=found.branch.dtype)[:, None, None])
    angle = jnp.where(roots >= jnp.pi, roots - 2 * jnp.pi, roots)
    angle = jnp.where(angle < -jnp.pi, angle + 2 * jnp.pi, angle)
    start = jnp.sort(jnp.where(mine & found.rising, angle, jnp.inf), axis=1)[:, :ARCS]
    end = jnp.sort(jnp.where(mine & ~found.rising, angle, jnp.inf), axis=1)[:, : ARCS + 1]
    later = jnp.min(jnp.where(end[:, None] >= start[:, :, None], end[:, None], jnp.inf), axis=2)
    later = jnp.where(jnp.isfinite(later), later, end[:, :1] + 2 * jnp.pi)
    valid = jnp.isfinite(start) & jnp.isfinite(later)
    whole = (first & ~jnp.any(mine, axis=1))[:, None] & (jnp.arange(ARCS) == 0)[:, None]
    start = jnp.where(whole, -jnp.pi, jnp.where(valid, start, 0.0))
    end = jnp.where(whole, jnp.pi, jnp.where(valid, later, 0.0))
    return start, end, valid | whole
