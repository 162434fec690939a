"""From the wrist to the elbow's circle: steps 2-4 of the closed form.

The distance from shoulder to wrist fixes the elbow joint up to a sign. In the elbow frame (x along the upper arm, z along
axis 4) the line from shoulder to wrist is l = (A, ±B, T) with A = U + V cos a, B = V sin a, where a is the bend away from
full stretch and T the skew of the arm; the elbow's direction from the centre of its circle is the part of x across l.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxik import columns as col
from jaxik.columns import Mat3, Vec3
from jaxik.geometry import Geometry
from jaxik.numerics import Tolerances, arctan2, unit_sqrt


class Bend(NamedTuple):
    """The elbow's bend for a wrist distance, and the directions it gives in the elbow frame."""

    angle: Array  # bend away from full stretch, [0, pi]
    cos: Array
    sin: Array
    cos_base: Array  # angle at the shoulder between upper arm and shoulder-wrist line
    sin_base: Array
    across: Array  # unit vector of (B, T): 1 and 0 for an arm without skew
    skewed: Array


class Circle(NamedTuple):
    """Where the elbow may lie: the circle's frame in the shoulder frame, and the bend that goes with it."""

    n: Vec3
    r: Vec3
    b: Vec3
    bend: Bend
    out_of_reach: Array
    near_singular: Array


def circle(g: Geometry, w: Vec3, tol: Tolerances) -> Circle:
    """The elbow's circle for a wrist at ``w`` from the shoulder (shoulder frame).

    A wrist out of reach is moved along its ray to the nearest that is not: the bend then stays at its end value and no
    longer depends on the distance.
    """
    reach = g.upper + g.fore
    distance2 = col.dot(w, w)
    centered = distance2 <= (tol.singular * reach) ** 2
    distance = jnp.sqrt(jnp.where(centered, 1.0, distance2))
    pole, zero = g.reference_vectors
    # A wrist in the shoulder has no direction: look away from the reference's singular one.
    n = col.where(centered, col.scale(-1.0, zero), col.scale(1.0 / distance, w))

    quarter = 0.25 / (g.upper * g.fore)
    skew2 = g.skew * g.skew
    sin2_half = (reach * reach + skew2 - distance2) * quarter
    cos2_half = (distance2 - (g.upper - g.fore) ** 2 - skew2) * quarter
    bend = _bend(g, unit_sqrt(sin2_half), unit_sqrt(cos2_half), tol)
    r, b, from_singular2 = g.reference.basis(pole, zero, n, tol)
    near = (bend.sin < tol.near_singular) | centered | (from_singular2 < tol.near_singular**2)
    outside = (sin2_half < -tol.singular) | (cos2_half < -tol.singular)
    return Circle(n, r, b, bend, outside, near)


def elbow_rotations(c: Circle, swivel_cos: Array, swivel_sin: Array) -> Mat3:
    """The frame [n, e, n × e] of the arm plane at a swivel angle, in the shoulder frame."""
    e = col.combine((swivel_cos, swivel_sin), (c.r, c.b))
    return c.n, e, col.cross(c.n, e)


def arm_plane(bend: Bend, side: float) -> Mat3:
    """The same frame [l̂, o, l̂ × o] seen from the elbow frame, for the elbow bent to one side (+1, -1)."""
    across = side * bend.across
    return (
        (bend.cos_base, bend.sin_base * across, bend.sin_base * bend.skewed),
        (bend.sin_base, -bend.cos_base * across, -bend.cos_base * bend.skewed),
        (jnp.zeros_like(across), bend.skewed, -across),
    )


def _bend(g: Geometry, sin_half: Array, cos_half: Array, tol: Tolerances) -> Bend:
    cos = cos_half * cos_half - sin_half * sin_half
    sin = 2.0 * sin_half * cos_half
    along, aside = g.upper + g.fore * cos, g.fore * sin
    return Bend(2.0 * arctan2(sin_half, cos_half), cos, sin, *_directions(g, along, aside, tol))


def _directions(g: Geometry, along: Array, aside: Array, tol: Tolerances) -> tuple[Array, Array, Array, Array]:
    """Unit vectors of (A, |B T|) and of (B, T), each held at its limit where it has no direction."""
    floor2 = (tol.singular * g.upper) ** 2
    off2 = aside * aside + g.skew * g.skew
    flat = off2 <= floor2
    off = jnp.where(flat, aside, jnp.sqrt(jnp.where(flat, 1.0, off2)))
    safe_off = jnp.where(flat, 1.0, off)
    across = jnp.where(flat, 1.0, aside / safe_off)
    skewed = jnp.where(flat, 0.0, g.skew / safe_off)
    length2 = along * along + off * off
    folded = length2 <= floor2
    inverse = 1.0 / jnp.sqrt(jnp.where(folded, 1.0, length2))
    return jnp.where(folded, 0.0, along * inverse), jnp.where(folded, 1.0, off * inverse), across, skewed
