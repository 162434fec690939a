"""From a path to the least-energy motion along it.

1. Search: dynamic programming over swivel and branch on a few waypoints (:mod:`jaxik.planning.search`).
2. Fill in: swivels between them, moved into the feasible arcs of their branch; a branch changes where the step is
   smallest.
3. Polish: all waypoints at once on the true energy (:mod:`jaxik.planning.polish`); kept only if better and feasible.
4. Check: limits, keep-out and speeds at every waypoint. What fails is said with waypoints and times.

A search that finds no way, or one whose motion does not pass the check, is repeated on other grids.
"""

import time

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Float

from jaxik import energy as energies
from jaxik.arm import Arm, ArmModel
from jaxik.energy import Energy
from jaxik.path import Path
from jaxik.planning.fill import Motion, check, fill_in
from jaxik.planning.grid import Grid, solve_grid, with_narrow_arcs
from jaxik.planning.polish import polish
from jaxik.planning.problem import Problem, make_problem
from jaxik.planning.result import Plan, PlanStatus, listed
from jaxik.planning.search import Route, best_route
from jaxik.trajectory import Trajectory

_SWIVELS = 128  # 2.8 degrees: with steps of about 0.1 rad between the searched waypoints finer cells change no route
_STEP = 0.08  # tool motion between searched waypoints, in arm lengths and radians
_FEWEST, _MOST = 24, 128  # searched waypoints of a first search
_ITERATIONS = 1000  # evaluations; the path `hello` takes about 250
_TIE_BREAK = 1e-6  # share of plain joint motion added in the search, for energies that no single step shows


def plan(
    arm: Arm | ArmModel,
    path: Path,
    *,
    energy: Energy | None = None,
    start: Float[ArrayLike, "joint"] | None = None,
    approach_s: float = 1.0,
) -> Plan:
    """The least-energy motion of the elbow along a path.

    Searches globally over swivel and branch, then polishes. Runs on the host around compiled parts; the dtype is the
    arm's.

    Args:
        arm: The arm, or the model that also knows its names.
        path: The path in the arm's base frame (see :func:`jaxik.fit_path`).
        energy: What to make small; None for :func:`jaxik.energy.joint_motion`.
        start: Posture the arm comes from, ``(joint,)`` [rad]. If it is at the first target already, the motion begins
            with it; otherwise the straight joint motion from it to the first waypoint is part of what the search
            makes small.
        approach_s: Time for that motion [s].

    Returns:
        The plan; its status and problems say where and why there is no motion.

    Raises:
        ValueError: Not a path, or not one for this arm.

    **Differentiability**: none yet; the energies are, see :mod:`jaxik.energy`.
    """
    model = arm if isinstance(arm, ArmModel) else None
    bare = arm.arm if isinstance(arm, ArmModel) else arm
    energy = energies.joint_motion() if energy is None else energy
    clock = _Clock()
    problem = make_problem(bare, path, energy, start, approach_s)
    clock.mark("arcs")
    blocked = np.flatnonzero(np.isnan(problem.arcs[0]).all(axis=(1, 2)))
    if len(blocked):
        where = f"no feasible swivel in any branch at waypoint {listed(blocked, problem.time_s)} of {len(path)}"
        return _failed(problem, PlanStatus.UNREACHABLE, (where,), clock)
    failures = []
    for index, swivels in _searches(problem):
        outcome = _attempt(problem, index, swivels, model, clock)
        if outcome.ok:
            return outcome
        failures.append(outcome)
    # A motion that is only too fast tells more than a search that found none.
    return max(failures, key=lambda failure: failure.status == PlanStatus.TOO_FAST)


def _searches(problem: Problem) -> list[tuple[np.ndarray, int]]:
    """Waypoints and number of swivels of each attempt's search.

    A second one looks closer in time and swivel, for narrow passages; a third looks less close in time, where the
    grid's own coarseness made steps too fast.
    """
    position = np.asarray(problem.path.target.position, float)
    way = np.linalg.norm(np.diff(position, axis=0), axis=-1).sum() / float(problem.arm.length)
    count = int(np.clip(np.ceil((way + problem.turned) / _STEP), _FEWEST, _MOST))
    total = len(problem.path)
    plans = dict.fromkeys((min(total, c), t) for c, t in ((count, _SWIVELS), (2 * count, 256), (count // 2, 256)))
    return [(np.unique(np.linspace(0, total - 1, c).round().astype(int)), t) for c, t in plans]


def _attempt(problem: Problem, index: np.ndarray, swivels: int, model: ArmModel | None, clock: "_Clock") -> Plan:
    """One search on some waypoints, and what it leads to."""
    grid = with_narrow_arcs(
        solve_grid(problem.arm, jax.tree.map(lambda x: x[index], problem.path.target), swivels),
        problem.arm,
        problem.path.target,
        index,
        problem.arcs,
    )
    clock.mark("grid")
    route = _search(problem, grid, index)
    clock.mark("search")
    if not np.isfinite(route.cost):
        cut = int(np.argmin(np.asarray(route.open)))
        a, b = index[max(cut - 1, 0)], index[cut]
        where = (
            f"no elbow motion leads from waypoint {a} ({problem.time_s[a]:.3f} s) to {b} ({problem.time_s[b]:.3f} s)"
        )
        return _failed(problem, PlanStatus.CUT, (where,), clock)
    branch = np.asarray(route.state) % 8
    swivel = grid.swivel[np.arange(len(index)), np.asarray(route.state) // 8, branch]
    found = check(problem, fill_in(problem, index, swivel, branch))
    clock.mark("fill in")
    polished = _polish(problem, found) if found.q is not None else found
    clock.mark("polish")
    better = polished.status == PlanStatus.OK and (
        found.status != PlanStatus.OK or polished.objective < found.objective
    )
    return _plan(problem, polished if better else found, found.energy, model, clock)


def _search(problem: Problem, grid: Grid, index: np.ndarray) -> Route:
    """Dynamic programming on a grid of some waypoints; state = 8 * swivel index + branch."""
    arm, dtype = problem.arm, problem.arm.axes.dtype
    q = jnp.asarray(grid.q.reshape(len(index), -1, arm.n_joints))
    time_s = problem.time_s[index]
    weight = problem.energy.motion_weight(arm)
    weight = weight + _TIE_BREAK * (jnp.max(weight) + jnp.asarray(jnp.max(weight) == 0, dtype))
    span = jnp.asarray(np.gradient(time_s), dtype)  # each waypoint's share of the time
    node = span[:, None] * problem.energy.rest_rate(arm, q)
    node = jnp.where(jnp.asarray(grid.ok.reshape(len(index), -1)), node, jnp.inf)
    node = node.at[0].add(problem.approach(q[0]))
    dt = jnp.asarray(np.diff(time_s), dtype)
    return best_route(jnp.swapaxes(q, 1, 2), node, dt, weight, arm.velocity_limit, turning=problem.turning)


def _polish(problem: Problem, found: Motion) -> Motion:
    """The motion after the local polish."""
    dtype = problem.arm.axes.dtype
    pinned = np.zeros(len(problem.path), bool)
    pinned[0] = problem.pinned is not None
    result = polish(
        problem.arm,
        problem.path,
        problem.energy,
        jnp.asarray(found.swivel, dtype),
        jnp.asarray(found.branch),
        (jnp.asarray(found.lower, dtype), jnp.asarray(found.upper, dtype)),
        jnp.asarray(pinned),
        jnp.asarray(max(found.objective, 1e-12), dtype),
        problem.start,
        jnp.asarray(problem.approach_s, dtype),
        turning=problem.turning,
        iterations=_ITERATIONS,
    )
    return check(problem, found._replace(swivel=np.asarray(result.swivel)))


def _plan(problem: Problem, motion: Motion, searched: float, model: ArmModel | None, clock: "_Clock") -> Plan:
    """The plan of a motion that passed or failed the check."""
    if motion.status != PlanStatus.OK or motion.q is None:
        return _failed(problem, motion.status, motion.problems, clock)
    names = model.joint_names if model else tuple(f"joint_{i + 1}" for i in range(problem.arm.n_joints))
    parts = problem.energy.parts(problem.arm, jnp.asarray(motion.q), problem.path.time_s)
    swivel, branch = np.asarray(motion.swivel, float), np.asarray(motion.branch, int)
    trajectory = Trajectory(
        problem.time_s, motion.q, names, model.name if model else "", swivel, branch, notes=problem.notes()
    )
    return Plan(
        trajectory=trajectory,
        swivel=swivel,
        branch=branch,
        energy=motion.energy,
        lower_bound=None,
        gap=None,
        status=PlanStatus.OK,
        parts={name: float(value) for name, value in parts.items()},
        energy_name=str(problem.energy),
        energy_unit=problem.energy.unit,
        searched=searched,
        seconds=dict(clock.seconds),
        arm=problem.arm,
        objective=problem.energy,
    )


def _failed(problem: Problem, status: PlanStatus, problems: tuple[str, ...], clock: "_Clock") -> Plan:
    """A plan without a motion."""
    return Plan(
        trajectory=None,
        swivel=np.full(len(problem.path), np.nan),
        branch=np.zeros(len(problem.path), int),
        energy=float("inf"),
        lower_bound=None,
        gap=None,
        status=status,
        problems=problems,
        energy_name=str(problem.energy),
        energy_unit=problem.energy.unit,
        seconds=dict(clock.seconds),
    )


class _Clock:
    """Wall time of the stages."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def mark(self, stage: str) -> None:
        """Ends a stage."""
        now = time.perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self._last
        self._last = now
