"""Postures on a grid of swivels, for host programs: any number of waypoints, one compilation."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxik.arm import Arm
from jaxik.ik import BRANCHES
from jaxik.redundancy import feasible_arcs, self_motion
from jaxik.targets import Target

_POSTURES = 4096  # per call and branch: few enough to stay in cache, so many that a call's overhead is small


class SwivelGrid(NamedTuple):
    """Postures of K targets at T swivels.

    Attributes:
        swivel: Swivels, evenly spaced from -pi on, ``(T,)`` [rad].
        q: Joint angles, ``(K, T, 8, joint)`` [rad].
        ok: True within limits and keep-out, ``(K, T, 8)``.
    """

    swivel: np.ndarray
    q: np.ndarray
    ok: np.ndarray


def swivel_grid(arm: Arm, target: Target, swivels: int) -> SwivelGrid:
    """Return the postures of K targets at evenly spaced swivels.

    Args:
        arm: The arm.
        target: K targets in the arm's dtype.
        swivels: Number of swivels T.

    Returns:
        The grid, as host arrays.
    """
    swivel = np.linspace(-np.pi, np.pi, swivels, endpoint=False).astype(arm.axes.dtype)
    host, count = jax.tree.map(np.asarray, target), target.position.shape[0]
    size = max(1, _POSTURES // swivels)
    parts = []
    for first in range(0, count, size):
        rows = np.minimum(np.arange(first, first + size), count - 1)
        parts.append(jax.tree.map(np.asarray, _postures(arm, jax.tree.map(lambda x, r=rows: x[r], host), swivel)))
    q, ok = (np.concatenate(x)[:count] for x in zip(*parts, strict=True))
    return SwivelGrid(swivel, q, ok)


@jax.jit
def _postures(arm: Arm, target: Target, swivel: Array) -> tuple[Array, Array]:
    motion = self_motion(arm, target)
    count = target.position.shape[0]
    at = jnp.broadcast_to(swivel[:, None], (len(swivel), count))
    q = motion.branch(np.arange(BRANCHES)[:, None, None]).angles(at)  # (joint, 8, T, K)
    ok = jax.vmap(feasible_arcs(motion).contains, out_axes=1)(at)
    return jnp.transpose(q, (3, 2, 1, 0)), ok
