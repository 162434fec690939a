"""Aligned shoulders and wrists: where a motion changes its branch while the joints go straight on.

Where the middle joint of a triple is straight its two solutions meet. That is one swivel at one time: a motion through
it goes on in the other solution, one a little beside it has to turn the outer joints by half a turn. What is
interpolated between two branches has to hit it.
"""

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxik.numerics import arctan2, fused_separately
from jaxik.planning.fast.knots import interpolation, segments
from jaxik.planning.fast.path_batch import ElbowCharts, near


@fused_separately
def ridge(entries: Array) -> Array:
    """The swivels ``(...)`` at which a triple ``(5 or 3, 3, ...)`` is best aligned: its middle cosine is largest."""
    return arctan2(entries[2, 2], entries[2, 1])


def filled(charts: ElbowCharts, index: np.ndarray, swivel: Array, branch: Array) -> tuple[Array, Array]:
    """Swivels and branches at all K waypoints of B paths from those at some, first and last included.

    Where branches differ, the swivel is bent so that it passes through the alignment, and the branch changes there.

    Args:
        charts: Of all waypoints.
        index: Which waypoints are given, n of them.
        swivel: ``(n, B)`` [rad].
        branch: ``(n, B)``.

    Returns:
        Swivels and branches, ``(K, B)``.
    """
    left, right, _ = segments(index, charts.elbow.shape[1])
    leaving, changed = branch[left], branch[left] ^ branch[right]
    elbow = leaving >> 1 & 1
    smooth = interpolation(index, len(left)).astype(swivel.dtype) @ swivel
    course, answer = smooth, leaving
    for entries, bit in ((charts.wrist, 1), (charts.shoulder, 4)):
        of_elbow = jnp.where(elbow == 1, entries[:3, :, 1], entries[:3, :, 0])
        here = changed & bit != 0
        behind, bend = _passing(of_elbow, smooth, index)
        course = jnp.where(here, course + bend, course)
        answer = jnp.where(here & behind, answer ^ bit, answer)
    return course, answer


def _passing(entries: Array, swivel: Array, index: np.ndarray) -> tuple[Array, Array]:
    """Which waypoints are behind the alignment of their segment, and what bends swivels to pass through it [rad].

    Args:
        entries: Of the triple, ``(3, 3, K, B)``.
        swivel: ``(K, B)`` [rad].
        index: Which waypoints the segments end at.
    """
    left, right, _ = segments(index, len(swivel))
    top = ridge(entries)
    ahead = _ahead(entries, jnp.asarray(index)[left], jnp.asarray(index)[right])
    # The step that passes, and which share of it is before.
    passes = (ahead[:-1] >= 0) & (ahead[1:] < 0)
    share = ahead[:-1] / jnp.where(passes, ahead[:-1] - ahead[1:], 1.0)
    missed = near(top - swivel)
    missed = missed[:-1] + share * near(missed[1:] - missed[:-1])
    at = jnp.arange(len(swivel), dtype=swivel.dtype)[:, None]
    when = at[:-1] + share
    # Each segment's own, and from there to its waypoints.
    pick = jnp.asarray(left[:-1] == np.arange(max(len(index) - 1, 1))[:, None], swivel.dtype)
    missed, when = ((pick @ jnp.where(passes, x, 0.0))[left] for x in (missed, when))
    begin, end = at[index[left]], at[index[right]]
    # A parabola through both ends of the segment and the alignment.
    height = jnp.maximum((when - begin) * (end - when), 0.25)
    return ahead < 0, missed * (at - begin) * (end - at) / height


@fused_separately
def _ahead(entries: Array, left: Array, right: Array) -> Array:
    """Sines of best aligned middle angles, positive before the alignment and negative behind it, ``(K, B)``.

    The first joint's direction turns round there. ``left`` and ``right`` are the ends of every waypoint's segment.
    """
    x, y, z = entries
    size = jnp.sqrt(z[1] * z[1] + z[2] * z[2]) + jnp.finfo(z.dtype).tiny
    cos, sin = z[1] / size, z[2] / size
    x, y = x[0] + x[1] * cos + x[2] * sin, y[0] + y[1] * cos + y[2] * sin
    length = jnp.sqrt(x * x + y * y) + jnp.finfo(z.dtype).tiny
    u, v = x / length, y / length
    turned = x * (u[left] - u[right]) + y * (v[left] - v[right])
    return jnp.where(turned >= 0.0, length, -length)
