"""Joint angles as functions of the swivel: the closed form with the swivel left open.

At a fixed target every entry of the shoulder's and wrist's ZYZ matrix is a + b cos(psi) + c sin(psi). Each joint angle
is the direction of a plane vector of two such entries, so "the joint is at theta" is one equation of the same form,
with at most two roots on the circle. Feasible arcs, the nearest posture and bounds on both follow without sampling.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxik.arm import Arm, fit_to_limits, within_limits
from jaxik.ik import (
    Bend,
    Geometry,
    elbow_angle,
    geometry,
    into_plane,
    out_of_plane,
    screen,
    usable_circle,
    wrist_and_hand,
)
from jaxik.numerics import arctan2, clipped_sqrt, fused_separately, vec3, wrap

SIDES = ((1.0,), (-1.0,))


class SwivelFunctions(NamedTuple):
    """Coefficients (a, b, c) of a + b cos(psi) + c sin(psi); batch last, elbow bit before it.

    A triple's entries are the plane vectors of its angles: x and y of the first, cosine of the middle (its sine
    follows), x and y of the third. They belong to the solution with a non-negative sine; the other has x and y of
    opposite sign.
    """

    shoulder: Array  # (5, 3, elbow bit, n)
    wrist: Array  # the same, or without the third angle (3, 3, elbow bit, n)
    elbow: Array  # joint 4, (elbow bit, n) [rad]
    elbow_inside: Array  # joint 4 within its limits, (elbow bit, n)
    keep_out: Array  # room of the elbow to each half-space, negative is forbidden, (half_spaces, 3, n) [m]
    solvable: Array  # the target is proper and within reach, (n,)
    shoulder_delta: Array  # what the middle angles are more than their joints, (1,) [rad]
    wrist_delta: Array

    def triples(self) -> tuple[tuple[Array, int, Array], tuple[Array, int, Array]]:
        """Entries, first joint and delta of the shoulder and the wrist."""
        return (self.shoulder, 0, self.shoulder_delta), (self.wrist, 4, self.wrist_delta)


def swivel_functions(arm: Arm, position: Array, directions: Array) -> SwivelFunctions:
    """Coefficients for targets of one float dtype: ``(3, n)`` and ``(3, 3 or 1, n)``."""
    g = geometry(arm)
    target = screen(arm, position, directions, jnp.zeros_like(position[0]))
    w, hand = wrist_and_hand(g, target)
    r, zero, _, b = usable_circle(g, w)
    shoulder, wrist, keep_out = _coefficients(arm, g, r.n, zero, b, hand)
    elbow = fit_to_limits(arm, (3, 3), elbow_angle(g, r))
    inside = within_limits(arm, (3, 3), elbow)
    solvable = ~(r.out_of_reach | target.invalid | target.nonfinite)
    return SwivelFunctions(shoulder, wrist, elbow, inside, keep_out, solvable, g.shoulder_delta, g.wrist_delta)


def roots(coefficients: Array, floor: float) -> tuple[Array, Array]:
    """The swivels where a + b cos + c sin vanishes.

    Args:
        coefficients: ``(..., 3, *rest)`` with (a, b, c) on the axis given by the caller first: ``(3, ...)``.
        floor: Squared amplitude, relative to 1, below which it is taken for constant, or for touching zero.

    Returns:
        Both roots ``(2, ...)`` in (-pi, pi], and whether they exist; pi where not.
    """
    a, b, c = coefficients
    amplitude2 = b * b + c * c
    gap2 = amplitude2 - a * a
    exist = (gap2 >= -floor * amplitude2) & (amplitude2 > floor * floor)
    d = clipped_sqrt(gap2)
    d = jnp.stack([d, -d])
    angle = arctan2(b * d - a * c, -a * b - c * d)
    return jnp.where(exist, angle, jnp.pi), exist


def angle_equations(entries: Array, angles: Array, at: Array) -> Array:
    """Coefficients whose roots are the swivels where an angle of a triple takes a value.

    Args:
        entries: ``(5 or 3, 3, elbow bit, n)``.
        angles: Which angle of the triple each equation is for, 0 to 2, ``(equations,)``.
        at: Its value as direction of the plane vector, delta included, ``(equations, elbow bit or 1, n or 1)`` [rad].

    Returns:
        ``(3, equations, elbow bit, n)``.
    """
    x, y, z = entries[0], entries[1], entries[2]
    count = (entries.shape[0] + 1) // 2
    adjacent = jnp.stack([x, z, entries[3]] if count == 3 else [x, z])[angles]
    opposite = jnp.stack([y, jnp.zeros_like(z), entries[4]] if count == 3 else [y, jnp.zeros_like(z)])[angles]
    middle = (angles == 1)[:, None, None]
    sin, cos = jnp.sin(at), jnp.cos(at)
    # Outer angles: y cos - x sin = 0. Middle one, of which only the cosine is known: z - cos = 0.
    along_y, along_x = jnp.where(middle, 0.0, cos), jnp.where(middle, 1.0, -sin)
    equations = along_y[:, None] * opposite + along_x[:, None] * adjacent
    constant = jnp.array([1.0, 0.0, 0.0], entries.dtype)[:, None, None]
    return jnp.moveaxis(equations - jnp.where(middle, cos, 0.0)[:, None] * constant, 1, 0)


def triple_angles(entries: Array, sign: Array, delta: Array, sin: Array, cos: Array) -> tuple[Array, ...]:
    """Angles of a triple in the solution with sign +1 or -1, entries ``(5 or 3, 3, ...)`` [rad]."""
    x, y, z, *third = (e[0] + e[1] * cos + e[2] * sin for e in entries)
    sine = clipped_sqrt(1.0 - z * z)
    angles = (arctan2(sign * y, sign * x), wrap(sign * arctan2(sine, z) - delta))
    if third:
        angles += (arctan2(sign * third[1], sign * third[0]),)
    return angles


@fused_separately
def _coefficients(arm: Arm, g: Geometry, n: Array, zero: Array, b: Bend, hand: Array) -> tuple[Array, Array, Array]:
    side = jnp.array(SIDES, n.dtype)
    sense = g.reference.sense
    quarter = sense * vec3.cross(n, zero)
    # e = cos r + sin b and n × e = sense (cos b - sin r): constant, cosine and sine parts of the frame [n, e, n × e].
    parts = (
        jnp.stack([n, jnp.zeros_like(n), jnp.zeros_like(n)], axis=1),
        jnp.stack([jnp.zeros_like(n), zero, sense * quarter], axis=1),
        jnp.stack([jnp.zeros_like(n), quarter, -sense * zero], axis=1),
    )
    seen = into_plane(b, side, g.shoulder_from_elbow[:, :, None])
    shoulder = jnp.stack([_entries(vec3.matmul(p[:, :, None], seen)) for p in parts], axis=1)

    def wrist_matrix(part: Array) -> Array:
        x, y, z = out_of_plane(b, side, vec3.matmul(vec3.transpose(part), hand)[:, :, None])
        unbent = jnp.stack([b.cos * x + side * b.sin * y, b.cos * y - side * b.sin * x, z])
        return vec3.matmul(g.wrist_from_elbow[:, :, None], unbent)

    wrist = jnp.stack([_entries(wrist_matrix(p)) for p in parts], axis=1)
    normal = vec3.matmul(g.to_shoulder_frame[..., 0], arm.keep_out.normal.T)[..., None]
    room = arm.keep_out.offset - arm.keep_out.normal @ arm.shoulder
    along, across = g.upper * b.cos_base, g.upper * b.sin_base
    keep_out = jnp.stack(
        [
            room[:, None] - along * vec3.dot(normal, n[:, None]),
            -across * vec3.dot(normal, zero[:, None]),
            -across * vec3.dot(normal, quarter[:, None]),
        ],
        axis=1,
    )
    return shoulder, wrist, keep_out


def _entries(m: Array) -> Array:
    """Plane vectors of the three angles, from a ZYZ matrix or its last column alone."""
    first_and_middle = [m[0, -1], m[1, -1], m[2, -1]]
    third = [-m[2, 0], m[2, 1]] if m.shape[1] == 3 else []
    return jnp.stack(first_and_middle + third)
