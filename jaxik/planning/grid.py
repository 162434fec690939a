"""All postures on a grid of swivels, for host programs: many waypoints, one compilation.

``solve_ik`` compiles once per shape. Paths have any number of waypoints, so the rows are dealt out in chunks of one
size.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxik.arm import Arm
from jaxik.ik import solve_ik
from jaxik.targets import Target

_ROWS = 4096  # small enough that eight branches of it stay in cache, large enough that a call's overhead is small


class Grid(NamedTuple):
    """Postures of K targets at T swivels.

    Attributes:
        swivel: ``(K, T, 8)`` [rad], evenly spaced.
        q: ``(K, T, 8, joint)`` [rad].
        ok: Inside limits and keep-out, ``(K, T, 8)``.
    """

    swivel: np.ndarray
    q: np.ndarray
    ok: np.ndarray


def solve_grid(arm: Arm, target: Target, swivels: int) -> Grid:
    """Solves K targets at evenly spaced swivels from -pi on.

    Args:
        arm: The arm.
        target: K targets in the arm's dtype.
        swivels: How many swivels T.

    Returns:
        The grid, as host arrays.
    """
    swivel = np.linspace(-np.pi, np.pi, swivels, endpoint=False).astype(arm.axes.dtype)
    count = target.position.shape[0]
    q, ok = solve_rows(arm, target, np.repeat(np.arange(count), swivels), np.tile(swivel, count))
    spread = np.broadcast_to(swivel[:, None], (count, swivels, 8)).copy()
    return Grid(spread, q.reshape(count, swivels, 8, -1), ok.reshape(count, swivels, 8))


def solve_rows(arm: Arm, target: Target, index: np.ndarray, swivel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Solves row i: target ``index[i]`` at ``swivel[i]``.

    Args:
        arm: The arm.
        target: K targets in the arm's dtype.
        index: ``(N,)``, which target.
        swivel: ``(N,)`` [rad].

    Returns:
        Joint angles ``(N, 8, joint)`` [rad] and which are inside limits and keep-out ``(N, 8)``.
    """
    count = len(index)
    host = jax.tree.map(np.asarray, target)
    q, ok = [], []
    for start in range(0, count, _ROWS):
        take = np.minimum(np.arange(start, start + _ROWS), count - 1)
        rows = jax.tree.map(lambda x, take=take: jnp.asarray(x[index[take]]), host)
        solution = solve_ik(arm, rows, jnp.asarray(swivel[take], arm.axes.dtype))
        q.append(np.asarray(solution.q))
        ok.append(np.asarray(solution.ok))
    return np.concatenate(q)[:count], np.concatenate(ok)[:count]
