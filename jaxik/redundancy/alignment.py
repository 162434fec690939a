"""Aligned shoulders and wrists: where a spherical joint's outer axes coincide, a second freedom opens.

With its middle angle at 0 or half a turn only the sum, or the difference, of the outer angles is determined. Every
split of it is on target: a family of postures, of which the self-motion's two solutions are the limits from both
sides. Home postures lie there. The family's place is where the cosine of the middle angle is extreme, so it has a
closed form; with the elbow straight too, a joint may be aligned at every swivel.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxik.arm import resting_angle
from jaxik.ik import BRANCHES, branch_bits, branch_number
from jaxik.numerics import arctan2, fused_separately, principal, sincos, sincos_apart, tolerances
from jaxik.redundancy.branch_motion import side_values
from jaxik.redundancy.enclosure import alignment
from jaxik.redundancy.nearness import TURN, Nearest, Nearness, from_lower
from jaxik.redundancy.self_motion import SelfMotion, SphericalJoint
from jaxik.redundancy.sinusoid import values
from jaxik.redundancy.swivel import SwivelBranch

# Search where a joint is aligned all round: parts of the circle, then closer and closer to the best swivel.
_POINTS, _PARTS = 24, 3
_NARROWER, _FINER = 0.1, 9  # 0.17 rad to 1e-10
_SAME = 1e-7  # rad; two evaluations of the same angle agree better but for aligned joints
_WIDEST = 1e-4  # swivels farther from an alignment are found as any other


_arctan2, _values = fused_separately(arctan2), fused_separately(values)


def near_alignment(motion: SelfMotion) -> Array:
    """Return the rows in which a shoulder or wrist comes near an alignment, ``(n,)``."""
    found = [
        jnp.any(_sine(j, _poles(j)) <= alignment(motion.elbow.dtype), axis=(0, 1)) for j in motion.spherical_joints()
    ]
    return (found[0] | found[1]) & motion.solvable


def only_aligned(motion: SelfMotion, start: Array, end: Array, valid: Array) -> Array:
    """Return the targets ``(K,)`` that are feasible at aligned shoulders or wrists alone.

    The solutions of their self-motion say nothing of the splits that are feasible.

    Args:
        motion: The self-motion, rows ``(K,)``.
        start: Starts of the feasible arcs, ``(K, 8, arcs)`` [rad].
        end: Their ends, likewise.
        valid: True for places that hold an arc.
    """
    near = alignment(start.dtype)
    sin, cos = sincos(jnp.moveaxis(0.5 * (start + end), 0, -1))
    (y, x), *_ = side_values(motion.branch(np.arange(BRANCHES)[:, None, None]), sin, cos)
    aligned = jnp.minimum(jnp.hypot(x[0], y[0]), jnp.hypot(x[3], y[3])) <= near
    narrow = aligned & (jnp.moveaxis(end - start, 0, -1) <= near)
    held = jnp.moveaxis(valid, 0, -1)
    return jnp.any(held, axis=(0, 1)) & jnp.all(~held | narrow, axis=(0, 1))


def nearest_aligned(motion: SelfMotion, query: Nearness) -> Nearest:
    """Return the nearest posture of each row among those with an aligned shoulder or wrist."""
    joints, exact = motion.spherical_joints(), tolerances(motion.elbow.dtype).limit
    poles = jnp.concatenate([_shifted(joint, query, _poles(joint)) for joint in joints])
    # The circle is searched where a joint is aligned all round, to rounding.
    near = jnp.where(jnp.arange(len(poles) + _POINTS) < len(poles), alignment(poles.dtype), 4 * exact)
    near = near.astype(poles.dtype)
    all_round = [jnp.sum(jnp.abs(joint.entries[:2]), axis=(0, 1)) <= 4 * exact for joint in joints]

    def search(i: Array, best: Nearest) -> Nearest:
        k = jnp.arange(_POINTS, dtype=poles.dtype)[:, None, None]
        around = TURN * ((_POINTS * i + k) / (_POINTS * _PARTS)) - jnp.pi
        width = TURN / (_POINTS * _PARTS) * _NARROWER ** (i - _PARTS).astype(k.dtype)
        about = best.swivel + width * (2.0 * k / (_POINTS - 1) - 1.0)
        swivel = jnp.concatenate([poles, jnp.where(i < _PARTS, around, about)])
        found = _least(_moved(motion, query, swivel, near[:, None, None]))
        return jax.tree.map(lambda x, y: jnp.where(found.moved < best.moved, x, y), found, best)

    zero = jnp.zeros_like(motion.elbow)
    none = Nearest(zero, zero.astype(jnp.int32), zero + jnp.inf, jnp.zeros((len(query.q_now), *zero.shape), zero.dtype))
    rounds = jnp.where(jnp.any(all_round[0] | all_round[1]), _PARTS + _FINER, 1)
    found = _least(jax.lax.fori_loop(0, rounds, search, none))
    return found._replace(swivel=principal(found.swivel))


def _least(found: Nearest) -> Nearest:
    """The least motion along the first axis after the joints."""
    place = jnp.argmin(found.moved, axis=0)[None]
    swivel, branch, moved = (jnp.take_along_axis(x, place, 0)[0] for x in found[:3])
    return Nearest(swivel, branch, moved, jnp.take_along_axis(found.off, place[None], 1)[:, 0])


def with_split(q: Array, posture: Array) -> Array:
    """Joint angles ``(joint, n)`` on target with the split of aligned joints as in another posture [rad].

    Both postures have the same swivel and branch. The derivative stays that of ``q``.
    """
    hold = jax.lax.stop_gradient
    apart = hold(jnp.abs(q - posture) > _SAME)
    return q + jnp.where(apart, hold(posture - q), 0.0)


def _poles(joint: SphericalJoint) -> Array:
    """Swivels where the middle angle is nearest to 0 and to half a turn, ``(2, elbow bit, n)`` [rad]."""
    _, b, c = joint.entries[2]
    near = _arctan2(c, b)
    return jnp.stack([near, principal(near + jnp.pi)])


def _sine(joint: SphericalJoint, swivel: Array) -> Array:
    x, y = _values(joint.entries[:2], *sincos_apart(swivel))
    return jnp.sqrt(x * x + y * y)


def _shifted(joint: SphericalJoint, query: Nearness, pole: Array) -> Array:
    """Swivels next to poles ``(2, elbow bit, n)`` at which the first angle is that of the nearest split.

    Within a narrow gap from an alignment all angles are passed: the swivel of one is a root of y cos - x sin.
    """
    t = _nearest_split(joint, query, pole)
    sin, cos = sincos_apart(t)
    for _ in range(2):
        trig = sincos_apart(pole)
        x, y = _values(joint.entries[:2], *trig)
        dx, dy = ((e[2] * trig[1] - e[1] * trig[0]) for e in joint.entries[:2])
        slope = dy * cos - dx * sin
        step = (y * cos - x * sin) / jnp.where(slope == 0.0, 1.0, slope)
        pole = pole - jnp.where(jnp.abs(step) < _WIDEST, step, 0.0)
    return pole


def _moved(motion: SelfMotion, query: Nearness, swivel: Array, near: Array) -> Nearest:
    """Least motion at swivels ``(..., elbow bit, n)`` with a joint aligned.

    Infinite where neither is aligned, or no posture is in the ranges.
    """
    shoulder, wrist = (_joint_moved(joint, query, swivel, near) for joint in motion.spherical_joints())
    elbow, fits = _in_range(motion.elbow, query.lower[3], query.upper[3])
    off = jnp.broadcast_to(elbow - query.q_now[3], swivel.shape)
    moved = jnp.where(fits, query.weights[3] * off**2, jnp.inf) + shoulder.moved + wrist.moved
    rows = [*shoulder.off, off, *wrist.off]
    if len(rows) < len(query.q_now):
        rows.append(jnp.broadcast_to(resting_angle(motion.arm) - query.q_now[6], off.shape))
        moved = moved + query.weights[6] * rows[-1] ** 2
    clear = motion.clear_of_keep_out(*sincos_apart(swivel)) & motion.solvable
    if motion.free is not None:
        clear = clear & motion.clear_of_obstacles(swivel)
    moved = jnp.where((shoulder.aligned | wrist.aligned) & clear, moved, jnp.inf)
    branch = branch_number(shoulder.bit, jnp.arange(2, dtype=jnp.int32)[:, None], wrist.bit).astype(jnp.int32)
    return Nearest(swivel, branch, moved, jnp.stack(rows))


class _JointMoved(NamedTuple):
    """Least motion of a spherical joint at swivels, its joints' motion, its bit, and where it is aligned."""

    moved: Array
    off: Array
    bit: Array
    aligned: Array


def _joint_moved(joint: SphericalJoint, query: Nearness, swivel: Array, near: Array) -> _JointMoved:
    """The nearest of a joint's two solutions and, where it is aligned, of its splits."""
    x, y, z, *third = _values(joint.entries, *sincos_apart(swivel))
    sine = jnp.sqrt(x * x + y * y)
    aligned = sine <= near
    flip = jnp.array([0.0, jnp.pi], z.dtype).reshape(2, *(1,) * z.ndim)
    middle = _arctan2(sine, z)
    solutions = [_arctan2(y, x) + flip, jnp.stack([middle, -middle]) - joint.delta]
    solutions += [_arctan2(third[1], third[0]) + flip] if third else []
    splits, exists = _splits(joint, query, swivel)
    angles = jnp.concatenate([jnp.stack(solutions), splits], axis=1)
    off, moved = _evaluated(joint, query, angles)
    # Next to an alignment the outer angles of a solution are rounding, each its own, so that they miss the target.
    resolved = jnp.broadcast_to(sine > alignment(z.dtype), (2, *z.shape))
    allowed = jnp.concatenate([resolved, aligned & exists])
    moved = jnp.where(allowed, moved, jnp.inf)
    best = jnp.argmin(moved, axis=0)[None]
    off = jnp.take_along_axis(off, best[None], 1)[:, 0]
    return _JointMoved(jnp.min(moved, axis=0), off, (best[0] == 1).astype(jnp.int32), aligned)


def _nearest_split(joint: SphericalJoint, query: Nearness, swivel: Array) -> Array:
    """First angle of the nearest split of a joint that is aligned at given swivels [rad]."""
    splits, exists = _splits(joint, query, swivel)
    off, moved = _evaluated(joint, query, splits)
    best = jnp.argmin(jnp.where(exists, moved, jnp.inf), axis=0)[None]
    return jnp.take_along_axis(off[0], best, 0)[0] + query.q_now[joint.first]


def _splits(joint: SphericalJoint, query: Nearness, swivel: Array) -> tuple[Array, Array]:
    """Angles of the nearest splits of an aligned joint's turn, and where there are any.

    One for each number of turns in it: ``(angle, splits, ...)`` [rad] and ``(splits, ...)``.
    """
    now, lower, upper = (x[joint.first : joint.first + joint.angles] for x in (query.q_now, query.lower, query.upper))
    trig = sincos_apart(swivel)
    x, y, z = _values(joint.entries[:3], *trig)
    if joint.angles == 2:  # a hand that points: its roll is free
        t = jnp.broadcast_to(jnp.clip(now[0], lower[0], jnp.maximum(lower[0], upper[0])), z.shape)[None]
        rest, exists = [], jnp.ones(t.shape, bool)
    else:
        pole, turn = joint.aligned_turn(*trig)
        low, high = jnp.minimum(pole * lower[2], pole * upper[2]), jnp.maximum(pole * lower[2], pole * upper[2])
        first, third = query.weights[joint.first], query.weights[joint.first + 2]
        share = jnp.where(first + third > 0.0, third / jnp.where(first + third > 0.0, first + third, 1.0), 0.5)
        middle = 0.5 * (lower[0] + upper[0] + low + high)
        turn = turn + TURN * jnp.round((middle - turn) / TURN)
        turn = turn + TURN * jnp.array([-1.0, 0.0, 1.0], z.dtype).reshape(3, *(1,) * z.ndim)
        least, most = jnp.maximum(lower[0], turn - high), jnp.minimum(upper[0], turn - low)
        t = jnp.clip(now[0] + share * (turn - now[0] - pole * now[2]), least, jnp.maximum(least, most))
        rest, exists = [pole * (turn - t)], least <= most + tolerances(z.dtype).limit
    sin, cos = sincos_apart(principal(t))
    return jnp.stack([t, _arctan2(x * cos + y * sin, z) - joint.delta, *rest]), exists


def _evaluated(joint: SphericalJoint, query: Nearness, angles: Array) -> tuple[Array, Array]:
    """Motion to angles ``(angle, ...)`` of a joint in their ranges, and its cost; infinite where one has no place."""
    own = slice(joint.first, joint.first + joint.angles)
    now, lower, upper = (
        x[own].reshape(joint.angles, *(1,) * (angles.ndim - 2), -1) for x in (query.q_now, query.lower, query.upper)
    )
    inside, fits = _in_range(angles, lower, upper)
    off = inside - now
    cost = query.weights[own].reshape(-1, *(1,) * (angles.ndim - 1)) * off**2
    return off, jnp.sum(jnp.where(fits, cost, jnp.inf), axis=0)


def _in_range(angle: Array, lower: Array, upper: Array) -> tuple[Array, Array]:
    """An angle in the turn that begins at the lower end, and whether it is in the range, to rounding."""
    inside = from_lower(angle, lower)
    fits = (inside <= upper + tolerances(angle.dtype).limit) & (lower <= upper)
    return jnp.clip(inside, lower, jnp.maximum(lower, upper)), fits


def hold_split(motion: SelfMotion, row: int | Array, posture: SwivelBranch, q: Array) -> SelfMotion:
    """Return the self-motion with aligned joints of one target split as in a posture, in its branch at any swivel.

    Args:
        motion: The self-motion of targets with rows ``(K,)``.
        row: The target.
        posture: Swivel and branch of the posture, ``()`` each.
        q: Its joint angles, ``(joint,)`` [rad].
    """
    bits, held = branch_bits(posture.branch), []
    for joint, bit in zip(motion.spherical_joints(), (bits.shoulder, bits.wrist), strict=True):
        entries, trig = joint.entries[..., row], sincos(posture.swivel)
        x, y, z = values(entries[:3], *trig)
        sign, first = jnp.where(bit, -1.0, 1.0).astype(q.dtype), q[joint.first]
        outer = [sign * jnp.cos(first), sign * jnp.sin(first)]
        pole = jnp.where(z > 0.0, 1.0, -1.0).astype(q.dtype)
        # Rounding of a cosine near 1 is its root as an angle; from the sine it is none.
        held_z = pole * jnp.sqrt(jnp.maximum(1.0 - x * x - y * y, 0.0))
        if joint.angles == 3:
            along, aside = values(joint.turn[..., row], *trig)
            third = pole * (arctan2(pole * aside, pole * along) - first)
            outer += [sign * jnp.cos(third), sign * jnp.sin(third)]
        constants = jnp.stack(jnp.broadcast_arrays(*outer[:2], held_z, *outer[2:]))
        fixed = jnp.stack([constants, jnp.zeros_like(constants), jnp.zeros_like(constants)], axis=1)
        aligned = x * x + y * y <= alignment(q.dtype) ** 2
        held.append(joint.entries.at[..., row].set(jnp.where(aligned, fixed, entries)))
    return motion._replace(shoulder=held[0], wrist=held[1])
