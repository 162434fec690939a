"""The waypoints at which the fast planner decides, and interpolation between them."""

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxik.arm import Arm
from jaxik.planning.search_size import tool_travel
from jaxik.targets import Target

KNOTS = 16  # of the paths that policies are trained on
SIZES = (16, 32, 64, 128)  # numbers of knots: few, since each is a program of its own
SPACING = 0.3  # largest tool motion between knots, in arm lengths and radians


def knots_for(arm: Arm, target: Target) -> int:
    """Return the number of knots that the longest of some paths, leading axes ``(*batch, K)``, asks for."""
    travel = float(jnp.max(tool_travel(arm, target), initial=0.0))
    enough = [size for size in SIZES if travel <= SPACING * size]
    return enough[0] if enough else SIZES[-1]


def knot_index(waypoints: int, knots: int) -> np.ndarray:
    """Return the waypoints that are knots: evenly spread, first and last included."""
    return np.unique(np.linspace(0, waypoints - 1, min(knots, waypoints)).round().astype(int))


def segments(index: np.ndarray, waypoints: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the knots left and right of every waypoint, and its fraction of the distance between them."""
    at = np.arange(waypoints)
    left = np.clip(np.searchsorted(index, at, side="right") - 1, 0, max(0, len(index) - 2))
    right = np.minimum(left + 1, len(index) - 1)
    share = (at - index[left]) / np.maximum(index[right] - index[left], 1)
    return left, right, share.astype(np.float32)


def interpolation(index: np.ndarray, waypoints: int) -> Array:
    """Return the Catmull-Rom matrix from values at knots to values at all waypoints, ``(waypoints, knots)``."""
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
