"""From the wrist to the elbow's circle: steps 2 and 3 of the closed form.

The distance from shoulder to wrist fixes the elbow joint up to a sign. In the elbow frame (x along the upper arm, z
along axis 4) the line from shoulder to wrist is l = (A, ±B, T) with A = U + V cos a, B = V sin a, where a is the bend
away from full stretch and T the skew of the arm; the elbow's direction from the center of its circle is the part of x
across l.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxik.ik.arm_constants import ArmConstants
from jaxik.numerics import Tolerances, fused_separately, tolerances, unit_sqrt, vec3


class Reach(NamedTuple):
    """The wrist seen from the shoulder: its direction, and the bend of the elbow for its distance.

    Attributes:
        n: Unit vector from shoulder to wrist, ``(3, n)``.
        sin_half: Sine of half the bend, which is in [0, pi] from full stretch, ``(n,)``.
        cos_half: Its cosine.
        out_of_reach: True where the wrist is too far or too near, ``(n,)``.
        centered: True where the wrist lies in the shoulder, ``(n,)``.
    """

    n: Array
    sin_half: Array
    cos_half: Array
    out_of_reach: Array
    centered: Array


class Bend(NamedTuple):
    """Directions in the elbow frame that belong to a bend, ``(n,)`` each.

    Attributes:
        cos: Cosine of the bend.
        sin: Its sine.
        cos_base: Cosine of the angle at the shoulder between the upper arm and the shoulder-wrist line.
        sin_base: Its sine.
        across: First entry of the unit vector along (B, T): 1 for an arm without skew.
        skewed: Second entry, 0 for an arm without skew.
    """

    cos: Array
    sin: Array
    cos_base: Array
    sin_base: Array
    across: Array
    skewed: Array


@fused_separately
def reach(g: ArmConstants, w: Array) -> Reach:
    """Return direction and bend for a wrist at ``w`` from the shoulder, ``(3, n)`` in the shoulder frame.

    A wrist out of reach is moved along its ray to the nearest point within: the bend then stays at its end value and
    does not depend on the distance.
    """
    tol = tolerances(w.dtype)
    full = g.upper + g.fore
    distance2 = vec3.dot(w, w)
    centered = distance2 <= (tol.singular * full) ** 2
    distance = jnp.sqrt(jnp.maximum(distance2, (tol.singular * full) ** 2))
    # A wrist in the shoulder has no direction: take one across the reference's singular direction.
    n = jnp.where(centered, -g.reference.vectors()[1], w / distance)
    quarter = 0.25 / (g.upper * g.fore)
    skew2 = g.skew * g.skew
    sin2_half = (full * full + skew2 - distance2) * quarter
    cos2_half = (distance2 - (g.upper - g.fore) ** 2 - skew2) * quarter
    outside = (sin2_half < -tol.singular) | (cos2_half < -tol.singular)
    # Straight to rounding is straight: a bend of rounding would pretend to tell the swivels apart.
    straight = sin2_half <= 8 * float(jnp.finfo(w.dtype).eps) * full * full * quarter
    sin2_half = jnp.where(straight, sin2_half - jax.lax.stop_gradient(jnp.maximum(sin2_half, 0.0)), sin2_half)
    return Reach(n, unit_sqrt(sin2_half), unit_sqrt(cos2_half), outside, centered)


def bend(g: ArmConstants, sin: Array, cos: Array, tol: Tolerances) -> Bend:
    """Return the directions for a bend of given sine (not negative) and cosine; where one vanishes, its limit."""
    along, aside = g.upper + g.fore * cos, g.fore * sin
    floor2 = (tol.singular * g.upper) ** 2
    off2 = aside * aside + g.skew * g.skew
    flat = off2 <= floor2
    bounded_off = jnp.sqrt(jnp.maximum(off2, floor2))
    off = jnp.where(flat, aside, bounded_off)
    across = jnp.where(flat, 1.0, aside / bounded_off)
    skewed = jnp.where(flat, 0.0, g.skew / bounded_off)
    length2 = along * along + off * off
    folded = length2 <= floor2
    inverse = 1.0 / jnp.sqrt(jnp.maximum(length2, floor2))
    cos_base, sin_base = jnp.where(folded, 0.0, along * inverse), jnp.where(folded, 1.0, off * inverse)
    return Bend(cos, sin, cos_base, sin_base, across, skewed)


def elbow_slack(g: ArmConstants, sin: Array) -> Array:
    """Return how far the elbow may be off by rounding of the target, at a bend of given sine (not negative) [m].

    The distance of the wrist gives the bend to eps / bend.
    """
    tol = tolerances(sin.dtype)
    return tol.singular * g.upper / jnp.maximum(sin, tol.singular**0.5)


def plane_matrix(b: Bend, side: Array) -> Array:
    """Return the matrix ``(3, 3, elbow bit, n)`` of :func:`into_plane`; its transpose is that of the way back."""
    across, skewed = side * b.across, jnp.broadcast_to(b.skewed, (2, *b.skewed.shape))
    zero = jnp.zeros_like(across)
    rows = (
        (jnp.broadcast_to(b.cos_base, across.shape), b.sin_base * across, b.sin_base * skewed),
        (jnp.broadcast_to(b.sin_base, across.shape), -b.cos_base * across, -b.cos_base * skewed),
        (zero, skewed, -across),
    )
    return jnp.stack([jnp.stack(row) for row in rows])


def into_plane(b: Bend, side: Array, v: Array) -> Array:
    """Resolve vectors ``(3, ...)`` of the elbow frame along the arm plane's [l̂, o, l̂ × o].

    ``side`` is +1 or -1 for the elbow bent to the positive or negative side, with a trailing axis for the batch.
    """
    across = side * b.across
    middle = across * v[1] + b.skewed * v[2]
    return jnp.stack(
        jnp.broadcast_arrays(
            b.cos_base * v[0] + b.sin_base * middle,
            b.sin_base * v[0] - b.cos_base * middle,
            b.skewed * v[1] - across * v[2],
        )
    )


def out_of_plane(b: Bend, side: Array, v: Array) -> Array:
    """Invert :func:`into_plane`: from components along [l̂, o, l̂ × o] to vectors of the elbow frame."""
    across = side * b.across
    middle = b.sin_base * v[0] - b.cos_base * v[1]
    return jnp.stack(
        jnp.broadcast_arrays(
            b.cos_base * v[0] + b.sin_base * v[1],
            across * middle + b.skewed * v[2],
            b.skewed * middle - across * v[2],
        )
    )
