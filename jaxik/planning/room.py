"""How far each waypoint's swivel may move: the feasible arc around it, in its branch."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxik.arcs import swivel_arcs
from jaxik.arm import Arm
from jaxik.targets import Target

_ROWS = 256  # targets per call: paths of any length share one compilation


def feasible_arcs(arm: Arm, target: Target) -> tuple[np.ndarray, np.ndarray]:
    """Feasible arcs of every branch of K targets.

    Args:
        arm: The arm.
        target: K targets in the arm's dtype.

    Returns:
        Starts and ends, ``(K, 8, A)`` [rad]; nan where there is no arc.
    """
    count = target.position.shape[0]
    host = jax.tree.map(np.asarray, target)
    starts, ends = [], []
    for first in range(0, count, _ROWS):
        take = np.minimum(np.arange(first, first + _ROWS), count - 1)
        arcs = swivel_arcs(arm, jax.tree.map(lambda x, take=take: jnp.asarray(x[take]), host))
        valid = np.asarray(arcs.valid)
        starts.append(np.where(valid, np.asarray(arcs.start), np.nan))
        ends.append(np.where(valid, np.asarray(arcs.end), np.nan))
    return np.concatenate(starts)[:count], np.concatenate(ends)[:count]


def nearest_room(
    start: np.ndarray, end: np.ndarray, swivel: np.ndarray, margin: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Moves swivels into the nearest feasible arc and returns that arc.

    Args:
        start: Arc starts, ``(K, A)`` [rad]; nan where there is no arc.
        end: Arc ends, not before their starts.
        swivel: Wanted, ``(K,)`` [rad], any number of turns.
        margin: Kept from the ends of the arcs, whose last digits are rounding [rad].

    Returns:
        Swivel, lowest and highest, each ``(K,)`` in the same turn as the wanted one; infinite ends for a whole
        circle, nan where a waypoint has no arc.
    """
    width = end - start
    inset = np.minimum(margin, width / 2)
    turn = 2 * np.pi
    # The turn in which the arc's middle is nearest to the wanted swivel.
    shift = turn * np.round((swivel[:, None] - (start + end) / 2) / turn)
    low, high = start + inset + shift, end - inset + shift
    whole = width >= turn * (1 - 1e-9)
    low, high = np.where(whole, -np.inf, low), np.where(whole, np.inf, high)
    moved = np.clip(swivel[:, None], low, high)
    distance = np.where(np.isnan(start), np.inf, np.abs(moved - swivel[:, None]))
    pick = np.argmin(distance, axis=1)
    row = np.arange(len(swivel))
    none = np.isinf(distance[row, pick])
    return tuple(np.where(none, np.nan, x[row, pick]) for x in (moved, low, high))  # type: ignore[return-value]
