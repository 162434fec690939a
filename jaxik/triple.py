"""Three orthogonal joint axes through one point: rotation to angles, both solutions.

With M = Cᵀ R C Ry(delta) the triple is ZYZ (see :mod:`jaxik.geometry`). The third angle is read off after the first has been
undone, not from the matrix itself, so that the pair stays consistent where M02 and M12 are all rounding; where they
vanish the first angle is 0 and the third takes the whole turn. Its derivative there is that of every motion that keeps
the first angle still.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxik.columns import Vec3
from jaxik.numerics import Tolerances, arctan2, wrap


class Triple(NamedTuple):
    """The solution with a non-negative middle ZYZ angle; :func:`both` gives the other one too."""

    angles: tuple[Array, ...]  # first, middle (delta not yet taken off), third where there is one
    sine2: Array  # of the middle angle


def solve_triple(m: tuple[Vec3, ...], tol: Tolerances) -> Triple:
    """Angles of the ZYZ rotation with columns ``m``, or of the direction ``m[-1]`` alone when only that is given."""
    x, y, z = m[-1]
    sine2 = x * x + y * y
    aligned = sine2 <= tol.singular**2
    x_safe, y_safe = jnp.where(aligned, 1.0, x), jnp.where(aligned, 0.0, y)
    inverse = 1.0 / jnp.sqrt(jnp.where(aligned, 1.0, sine2))
    cos, sin = x_safe * inverse, y_safe * inverse
    angles = (arctan2(y_safe, x_safe), arctan2(cos * x + sin * y, z))
    if len(m) == 3:
        angles += (arctan2(cos * m[0][1] - sin * m[0][0], cos * m[1][1] - sin * m[1][0]),)
    return Triple(angles, sine2)


def both(t: Triple, delta: Array) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """Joint angles of the two solutions: (q1, q2, q3) and (q1 + pi, -q2 - 2 delta, q3 + pi)."""
    first, middle, *third = t.angles
    direct = (first, wrap(middle - delta), *third)
    flipped = (_half_turn(first), wrap(-middle - delta), *map(_half_turn, third))
    return direct, flipped


def _half_turn(angle: Array) -> Array:
    return jnp.where(angle > 0.0, angle - jnp.pi, angle + jnp.pi)
