"""Branch changes at aligned shoulders and wrists, where the joints move on without a jump.

Where the middle joint of a spherical joint is straight its two solutions meet. That is one swivel at one time: a motion
through it goes on in the other solution, one slightly beside it has to turn the outer joints by half a turn. A swivel
interpolated between two branches has to hit it.
"""

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxik.ik import branch_bits, branch_number
from jaxik.numerics import arctan2, fused_separately, principal
from jaxik.planning.fast.knots import interpolation, segments
from jaxik.planning.fast.path_batch import SwivelPath
from jaxik.redundancy import SelfMotion


@fused_separately
def best_aligned(entries: Array) -> Array:
    """Return the swivels ``(...)`` at which the middle cosine of entries ``(5 or 3, 3, ...)`` is largest."""
    return arctan2(entries[2, 2], entries[2, 1])


def interpolate(motion: SelfMotion, index: np.ndarray, at_knots: SwivelPath) -> SwivelPath:
    """Return swivels and branches at all K waypoints of B paths from those at some, first and last included.

    Where branches differ, the swivel is bent so that it passes through the alignment, and the branch changes there.

    Args:
        motion: Self-motion of all waypoints, rows ``(K, B)``.
        index: The waypoints given, n of them.
        at_knots: Swivels and branches there, ``(n, B)``.
    """
    left, right, _ = segments(index, motion.status.shape[0])
    leaving, entering = branch_bits(at_knots.branch[left]), branch_bits(at_knots.branch[right])
    smooth = interpolation(index, len(left)).astype(at_knots.swivel.dtype) @ at_knots.swivel
    swivel, bits = smooth, leaving._asdict()
    for name, entries in (("wrist", motion.wrist), ("shoulder", motion.shoulder)):
        of_elbow = jnp.where(leaving.elbow, entries[:3, :, 1], entries[:3, :, 0])
        changes = getattr(leaving, name) != getattr(entering, name)
        past, bend = _passing(of_elbow, smooth, index)
        swivel = jnp.where(changes, swivel + bend, swivel)
        bits[name] = bits[name] ^ (changes & past)
    return SwivelPath(swivel, branch_number(**bits).astype(at_knots.branch.dtype))


def _passing(entries: Array, swivel: Array, index: np.ndarray) -> tuple[Array, Array]:
    """Waypoints past the alignment of their segment, and the bend of the swivels that passes through it [rad].

    Args:
        entries: First three entries of the spherical joint, ``(3, 3, K, B)``.
        swivel: Swivels, ``(K, B)`` [rad].
        index: Waypoints at which the segments end.
    """
    left, right, _ = segments(index, len(swivel))
    aligned = best_aligned(entries)
    ahead = _ahead(entries, jnp.asarray(index)[left], jnp.asarray(index)[right])
    # The step that passes, and the fraction of it before the alignment.
    passes = (ahead[:-1] >= 0) & (ahead[1:] < 0)
    share = ahead[:-1] / jnp.where(passes, ahead[:-1] - ahead[1:], 1.0)
    missed = principal(aligned - swivel)
    missed = missed[:-1] + share * principal(missed[1:] - missed[:-1])
    at = jnp.arange(len(swivel), dtype=swivel.dtype)[:, None]
    when = at[:-1] + share
    # Per segment, and from there to its waypoints.
    pick = jnp.asarray(left[:-1] == np.arange(max(len(index) - 1, 1))[:, None], swivel.dtype)
    missed, when = ((pick @ jnp.where(passes, x, 0.0))[left] for x in (missed, when))
    begin, end = at[index[left]], at[index[right]]
    # A parabola through both ends of the segment and the alignment.
    height = jnp.maximum((when - begin) * (end - when), 0.25)
    return ahead < 0, missed * (at - begin) * (end - at) / height


@fused_separately
def _ahead(entries: Array, left: Array, right: Array) -> Array:
    """Sines of best aligned middle angles, positive before the alignment and negative after it, ``(K, B)``.

    The direction of the first joint reverses there. ``left`` and ``right`` are the ends of every waypoint's segment.
    """
    x, y, z = entries
    size = jnp.sqrt(z[1] * z[1] + z[2] * z[2]) + jnp.finfo(z.dtype).tiny
    cos, sin = z[1] / size, z[2] / size
    x, y = x[0] + x[1] * cos + x[2] * sin, y[0] + y[1] * cos + y[2] * sin
    length = jnp.sqrt(x * x + y * y) + jnp.finfo(z.dtype).tiny
    u, v = x / length, y / length
    turned = x * (u[left] - u[right]) + y * (v[left] - v[right])
    return jnp.where(turned >= 0.0, length, -length)
