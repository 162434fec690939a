"""Pieces of the elbow's circle on which every joint moves one way, and bounds of the motion on each.

The circle is cut where a joint meets the end of its range, and where one turns back. Between cuts the angles of a joint
are those between its two ends, so that the distance to the present angle has a bound without any derivative: the sum of
its weighted squares bounds the motion, for all branches at once.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxik.ik import branch_number
from jaxik.numerics import arctan2, fused_separately, merge_leading, principal, sincos_apart, sort_columns, tolerances
from jaxik.redundancy.arc_intervals import following
from jaxik.redundancy.arcs import Ranges, borders_of_limits, feasible_between
from jaxik.redundancy.nearness import Nearness, from_lower
from jaxik.redundancy.self_motion import SelfMotion, SphericalJoint
from jaxik.redundancy.sinusoid import roots, turning_points, values

_GRID = 4  # cuts besides: from an alignment on, an angle turns by less than pi within a quarter of the circle
_ROUNDING = 64  # eps: error of the cut where a joint turns back, in parts of the circle


class Pieces(NamedTuple):
    """Pieces of the circles of n rows.

    Attributes:
        start: Begin of each piece, ``(cuts, elbow bit, n)`` [rad].
        length: Its length, likewise [rad].
        bound: Bound of the motion on each piece, infinite where it is not feasible,
            ``(shoulder bit * wrist bit * cuts * elbow bit, n)`` [rad²].
    """

    start: Array
    length: Array
    bound: Array

    def pick(self, piece: Array, row: Array) -> tuple[Array, Array, Array]:
        """Return begin, length and branch of pieces ``(k,)`` of rows ``(k,)``."""
        cuts = len(self.start)
        elbow, cut, solution = piece % 2, piece // 2 % cuts, piece // (2 * cuts)
        branch = branch_number(solution // 2, elbow, solution % 2).astype(jnp.int32)
        return self.start[cut, elbow, row], self.length[cut, elbow, row], branch


def bounded_pieces(motion: SelfMotion, near: Nearness, ranges: Ranges, known: Array) -> tuple[Pieces, Array]:
    """Return the pieces of each circle with bounds of the motion on them, and the lower ends of the ranges.

    Without any feasible piece, and no posture ``known`` otherwise, ``(n,)``, the ranges are left aside: the caller sees
    that the posture is outside.
    """
    n = near.q_now.shape[-1]
    grid = jnp.linspace(-jnp.pi, jnp.pi, _GRID, endpoint=False, dtype=near.q_now.dtype)
    grid = jnp.broadcast_to(grid[:, None, None], (_GRID, 2, n))
    cuts = sort_columns(jnp.concatenate([borders_of_limits(motion, ranges), _turns_back(motion), grid]))
    feasible = feasible_between(motion, cuts, ranges)
    none = ~(jnp.any(feasible, axis=(0, 1, 2, 3)) | known)
    near = near._replace(lower=jnp.where(none, near.q_now - jnp.pi, near.lower))
    length = following(cuts) - cuts
    trig = sincos_apart(cuts)
    joints = [_joint_bounds(joint, near, trig, length) for joint in motion.spherical_joints()]
    bound = _combined(motion, near, feasible | none, *joints)
    return Pieces(cuts, length, merge_leading(bound, 1)), near.lower


@fused_separately
def _turns_back(motion: SelfMotion) -> Array:
    """Swivels where a joint turns back, the alignments nearest among them, ``(cuts, elbow bit, n)`` [rad]."""
    floor = tolerances(motion.elbow.dtype).singular
    found = []
    for joint in motion.spherical_joints():
        x, y, (_, b, c), *third = joint.entries
        pole = arctan2(c, b)
        found += [pole, principal(pole + jnp.pi)]
        outer = [(x, y), third][: joint.angles - 1]
        found += [root for pair in outer for root in roots(turning_points(*pair), floor**2)[0]]
    return jnp.stack(found)


def _joint_bounds(joint: SphericalJoint, near: Nearness, trig: tuple[Array, Array], length: Array) -> Array:
    """Bounds of a spherical joint's part of the motion, ``(solution, cuts, elbow bit, n)``."""
    own = slice(joint.first, joint.first + joint.angles)
    angles, sine = _angles(joint.entries, *trig)
    return _least(near.q_now[own], near.lower[own], near.weights[own], joint.delta, angles, sine, length)


@fused_separately
def _angles(entries: Array, sin: Array, cos: Array) -> tuple[Array, Array]:
    """Angles of the first solution at cuts, ``(angle, cuts, elbow bit, n)``, and the sine of the middle one."""
    x, y, z, *third = values(entries, sin, cos)
    sine = jnp.sqrt(x * x + y * y)
    opposite, adjacent = [y, sine], [x, z]
    if third:
        opposite, adjacent = [*opposite, third[1]], [*adjacent, third[0]]
    return arctan2(jnp.stack(opposite), jnp.stack(adjacent)), sine


@fused_separately
def _least(now: Array, lower: Array, weights: Array, delta: Array, angles: Array, sine: Array, length: Array) -> Array:
    swing = principal(jnp.roll(angles, -1, axis=1) - angles)
    center = angles + 0.5 * swing
    # A rate N / sine² that should vanish is rounding: so far the angle may have turned beyond the ends.
    least = jnp.minimum(sine, jnp.roll(sine, -1, axis=0))
    eps = float(jnp.finfo(sine.dtype).eps)
    beyond = _ROUNDING * eps * (1.0 + length / jnp.maximum(least * least, eps * eps))
    reach = 0.5 * jnp.abs(swing) + beyond
    solutions = []
    for sign in (1.0, -1.0):
        cost = jnp.zeros((), sine.dtype)
        for place in range(len(angles)):
            if place == 1:
                angle = sign * center[place] - delta
            else:
                angle = center[place] if sign > 0 else center[place] + jnp.pi
            off = jnp.abs(from_lower(angle, lower[place]) - now[place])
            cost = cost + weights[place] * jnp.maximum(off - reach[place], 0.0) ** 2
        solutions.append(cost)
    return jnp.stack(solutions)


@fused_separately
def _combined(motion: SelfMotion, near: Nearness, feasible: Array, shoulder: Array, wrist: Array) -> Array:
    off = from_lower(motion.elbow, near.lower[3]) - near.q_now[3]
    bound = shoulder[:, None] + wrist[None] + near.weights[3] * off * off
    return jnp.where(feasible, bound, jnp.inf)
