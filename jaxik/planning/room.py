"""How far each waypoint's swivel may move: the feasible arc around it, in its branch."""

import numpy as np

from jaxik.arm import Arm
from jaxik.planning.grid import solve_grid, solve_rows
from jaxik.targets import Target


def arcs_of_branch(arm: Arm, target: Target, branch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """TEMPORARY until swivel_arcs: sampled arcs."""
    T = 180
    grid = solve_grid(arm, target, T)
    K = len(branch)
    ok = grid.ok[np.arange(K), :, branch]
    A = 4
    start = np.full((K, A), np.nan)
    end = np.full((K, A), np.nan)
    idx, ends_in, ends_out, where = [], [], [], []
    for k in range(K):
        if ok[k].all():
            start[k, 0], end[k, 0] = -np.pi, np.pi
            continue
        rises = np.flatnonzero(ok[k] & ~np.roll(ok[k], 1))[:A]
        for a, i in enumerate(rises):
            n = 0
            while ok[k][(i + n + 1) % T]:
                n += 1
            s = grid.swivel[i]
            step = 2 * np.pi / T
            start[k, a], end[k, a] = s, s + n * step
            for side, inn, out in ((0, s, s - step), (1, s + n * step, s + (n + 1) * step)):
                idx.append(k)
                ends_in.append(inn)
                ends_out.append(out)
                where.append((side, k, a))
    if idx:
        idx = np.array(idx)
        a = np.array(ends_in)
        b = np.array(ends_out)
        for _ in range(20):
            m = (a + b) / 2
            good = solve_rows(arm, target, idx, m)[1][np.arange(len(idx)), branch[idx]]
            a = np.where(good, m, a)
            b = np.where(good, b, m)
        for (side, k, i), x in zip(where, a):
            (start if side == 0 else end)[k, i] = x
    return start, end


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
