"""From swivels and branches at a few waypoints to a checked motion at all of them."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxik.planning.continuity import unwrap
from jaxik.planning.grid import solve_rows
from jaxik.planning.problem import Problem
from jaxik.planning.result import PlanStatus, listed
from jaxik.planning.room import nearest_room

_SPEED_ROUNDING = 1e-6  # relative: a motion at its limit to rounding is at its limit, not beyond


class Motion(NamedTuple):
    """A motion at full resolution, and what is wrong with it.

    Attributes:
        swivel: ``(K,)`` [rad].
        branch: ``(K,)``.
        lower: Lowest feasible swivel around each, ``(K,)``.
        upper: Highest.
        q: ``(K, joint)`` [rad] without jumps of a full turn; None where a waypoint has no posture.
        energy: Its energy; infinite without q.
        objective: The energy and what it costs to come from the start posture.
        status: What the check says.
        problems: One sentence each.
    """

    swivel: np.ndarray
    branch: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    q: np.ndarray | None = None
    energy: float = float("inf")
    objective: float = float("inf")
    status: PlanStatus = PlanStatus.OK
    problems: tuple[str, ...] = ()


def fill_in(problem: Problem, index: np.ndarray, swivel: np.ndarray, branch: np.ndarray) -> Motion:
    """Swivels and branches at every waypoint from those at some.

    Between two searched waypoints the swivel goes straight the shorter way round; where their branches differ, the
    branch changes at the waypoint where the joints jump least.

    Args:
        problem: The problem.
        index: The searched waypoints, first and last included.
        swivel: Their swivels, ``(len(index),)`` [rad].
        branch: Their branches.

    Returns:
        The motion, not yet checked.
    """
    if problem.pinned is not None:
        swivel, branch = swivel.copy(), branch.copy()
        swivel[0], branch[0] = problem.pinned
    continuous = np.unwrap(swivel)
    psi = np.interp(problem.time_s, problem.time_s[index], continuous)
    branches = np.repeat(branch[:-1], np.diff(index))
    branches = np.append(branches, branch[-1])
    changes = np.flatnonzero(np.diff(branch))
    if len(changes):
        q, _ = solve_rows(problem.arm, problem.path.target, np.arange(len(psi)), psi)
        for c in changes:
            a, b = index[c], index[c + 1]
            before, after = q[a:b, branch[c]], q[a + 1 : b + 1, branch[c + 1]]
            jump = after - before
            jump -= 2 * np.pi * np.round(jump / (2 * np.pi)) * np.array(problem.turning)
            cut = a + 1 + int(np.argmin(np.abs(jump).max(axis=-1)))
            branches[a:cut], branches[cut:b] = branch[c], branch[c + 1]
    start, end = (x[np.arange(len(psi)), branches] for x in problem.arcs)
    margin = 64 * float(jnp.finfo(problem.arm.axes.dtype).eps) ** 0.75  # the arcs' ends carry this much rounding
    moved, lower, upper = nearest_room(start, end, psi, margin)
    if problem.pinned is not None:
        moved[0] = psi[0]
    return Motion(moved, branches, lower, upper)


def check(problem: Problem, motion: Motion) -> Motion:
    """Postures, energy, and every limit at every waypoint."""
    times = problem.time_s
    lost = np.flatnonzero(np.isnan(motion.swivel))
    if len(lost):
        text = f"branch {motion.branch[lost[0]]} has no feasible swivel at waypoint {listed(lost, times)}"
        return motion._replace(
            q=None, energy=float("inf"), objective=float("inf"), status=PlanStatus.CUT, problems=(text,)
        )
    rows = np.arange(len(times))
    q, ok = solve_rows(problem.arm, problem.path.target, rows, motion.swivel)
    q, ok = q[rows, motion.branch], ok[rows, motion.branch]
    q = np.asarray(unwrap(jnp.asarray(q), problem.turning))
    inside = (q >= np.asarray(problem.arm.lower) - 1e-6) & (q <= np.asarray(problem.arm.upper) + 1e-6)
    energy = float(problem.energy(problem.arm, jnp.asarray(q), problem.path.time_s))
    objective = energy + float(problem.approach(jnp.asarray(q[0])))
    motion = motion._replace(q=q, energy=energy, objective=objective, status=PlanStatus.OK, problems=())
    bad = np.flatnonzero(~(ok & inside.all(axis=-1)))
    if len(bad):
        text = f"outside limits or keep-out at waypoint {listed(bad, times)}"
        return motion._replace(status=PlanStatus.CUT, problems=(text,))
    used = np.abs(np.diff(q, axis=0)) / (np.diff(times)[:, None] * np.asarray(problem.arm.velocity_limit))
    if used.max() > 1 + _SPEED_ROUNDING:
        k, joint = np.unravel_index(np.argmax(used), used.shape)
        text = (
            f"joint {joint + 1} would need {used[k, joint]:.2f} times its speed limit between waypoints {k} "
            f"({times[k]:.3f} s) and {k + 1} ({times[k + 1]:.3f} s)"
        )
        return motion._replace(status=PlanStatus.TOO_FAST, problems=(text,))
    return motion
