"""The waypoints at which a policy decides, and what lies between them."""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from jaxik.targets import Pose, Target

KNOTS = 16  # of the paths that policies are trained on
SIZES = (16, 32, 64, 128)  # numbers of knots: few, since each is a program of its own
SPACING = 0.3  # largest tool motion between knots, in arm lengths and radians


def knots_for(length: Float[Array, ""], target: Target) -> int:
    """How many knots the longest of some paths asks for.

    Args:
        length: The arm's, ``()`` [m].
        target: Leading axes ``(*batch, K)``.
    """
    way = float(_longest(length.astype(target.position.dtype), target))
    enough = [size for size in SIZES if way <= SPACING * size]
    return enough[0] if enough else SIZES[-1]


@jax.jit
def _longest(length: Array, target: Target) -> Float[Array, ""]:
    """Tool motion along the longest path: position in lengths and the hand's turning in radians."""
    directions = target.rotation if isinstance(target, Pose) else target.direction[..., None]
    way = jnp.sqrt(jnp.sum(jnp.diff(target.position, axis=-2) ** 2, axis=-1)) / length
    # Three unit vectors that turn about an axis by a small angle move by the angle times the root of two in all.
    share = 0.5 if isinstance(target, Pose) else 1.0
    turn = jnp.sqrt(share * jnp.sum(jnp.diff(directions, axis=-3) ** 2, axis=(-2, -1)))
    return jnp.max(jnp.sum(way + turn, axis=-1))


def knot_index(waypoints: int, knots: int) -> np.ndarray:
    """Which waypoints are knots: evenly spread, first and last included."""
    return np.unique(np.linspace(0, waypoints - 1, min(knots, waypoints)).round().astype(int))


def segments(index: np.ndarray, waypoints: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The knots on the left and on the right of every waypoint, and which share of the way it is from there."""
    at = np.arange(waypoints)
    left = np.clip(np.searchsorted(index, at, side="right") - 1, 0, max(0, len(index) - 2))
    right = np.minimum(left + 1, len(index) - 1)
    share = (at - index[left]) / np.maximum(index[right] - index[left], 1)
    return left, right, share.astype(np.float32)


def interpolation(index: np.ndarray, waypoints: int) -> Array:
    """Matrix from values at knots to values at all waypoints, Catmull-Rom, ``(waypoints, knots)``."""
    if len(index) == waypoints:
        return jnp.eye(waypoints, dtype=jnp.float32)
    if len(index) == 1:
        return jnp.ones((waypoints, 1), jnp.float32)
    knots = np.eye(len(index))
    padded = np.concatenate([2 * knots[:1] - knots[1:2], knots, 2 * knots[-1:] - knots[-2:-1]])
    left, _, share = segments(index, waypoints)
    u = share.astype(float)[:, None]
    a, b, c, d = (padded[left + i] for i in range(4))
    matrix = b + u * (c - a) / 2 + u**2 * (2 * a - 5 * b + 4 * c - d) / 2 + u**3 * (3 * (b - c) + d - a) / 2
    return jnp.asarray(matrix, jnp.float32)
