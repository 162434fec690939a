"""From a path to the least-energy motion along it, and the proof that it is.

:func:`jaxik.planning.motion.least_energy_motion` searches and polishes; here its answer is checked against what was
asked, and what fails is said with waypoints, times and joints. A search that finds no way, or one whose motion does not
pass the check, is repeated on other waypoints. :func:`jaxik.planning.certificate.certify` then bounds what any other
motion costs.
"""

from dataclasses import replace
from functools import partial
from time import perf_counter

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Float, Int

from jaxik import energy as energies
from jaxik.arm import Arm, ArmModel
from jaxik.energy import Energy
from jaxik.paths import Path
from jaxik.planning.certificate import certify
from jaxik.planning.check import check, nearest_violation
from jaxik.planning.initial_guess import filled
from jaxik.planning.motion import Found, SwivelMotion, guessed, polished, searched
from jaxik.planning.problem import Problem, make_problem
from jaxik.planning.result import Plan, PlanStatus, listed
from jaxik.planning.task import Task, make_task
from jaxik.trajectories import Trajectory

_STEP = 0.16  # tool motion between searched waypoints, in arm lengths and radians: several cells of the lattice
_COUNTS = (12, 24, 32, 48, 64, 96, 128, 256)  # searched waypoints: few sizes, so that few programs are compiled
_FEWEST, _MOST = 24, 128  # of them in a first search


def plan(
    arm: Arm | ArmModel,
    path: Path,
    *,
    energy: Energy | None = None,
    start: Float[ArrayLike, "joint"] | None = None,
    end: Float[ArrayLike, "joint"] | None = None,
    approach_time: float = 1.0,
    gap: float | None = 0.01,
    guess: tuple[Float[ArrayLike, "waypoint"], Int[ArrayLike, "*waypoint"]] | None = None,
) -> Plan:
    """The least-energy motion of the elbow along a path.

    Searches globally over swivel and branch, polishes, and proves how much better any other motion could be. Runs on
    the host around compiled parts; the dtype is the arm's.

    Args:
        arm: The arm, or the model that also knows its names.
        path: The path in the arm's base frame (see :func:`jaxik.fit_path`).
        energy: What to make small; None for :func:`jaxik.energy.joint_motion`.
        start: Posture the arm comes from, ``(joint,)`` [rad]. If it is at the first target already, the motion begins
            with it; otherwise the straight joint motion from it to the first waypoint is part of what the search
            makes small.
        end: Posture the arm goes on to, likewise.
        approach_time: Time for that motion, and for the one to ``end`` [s].
        gap: How close to the energy the plan's ``lower_bound`` is to come, as a share; smaller takes longer. None
            proves nothing. Only energies of joint motion and holding torques have a bound.
        guess: Swivels ``(K,)`` [rad] and branch, one or ``(K,)``, of a motion to begin with instead of a search: a
            policy's (:mod:`training`), or the last plan's. The search follows where that leads to no motion; with a
            proof, what is better than the guess is found on the way.

    Returns:
        The plan; its status and problems say where and why there is no motion.

    Raises:
        ValueError: Not a path, or not one for this arm; an energy of torques for an arm without masses; a gap that is
            not between 0 and 1; a guess of another length than the path.

    **Differentiability**: :func:`jaxik.least_energy_motion` is the same motion as a function of arrays.
    """
    model = arm if isinstance(arm, ArmModel) else None
    bare = arm.arm if isinstance(arm, ArmModel) else arm
    energy = energies.joint_motion() if energy is None else energy
    clock = _Clock()
    energy.check(bare)
    if gap is not None and not 0 < gap < 1:
        raise ValueError(f"gap is a share of the energy between 0 and 1, or None for no proof; got {gap!r}")
    problem = make_problem(bare, path, energy, start, end, approach_time)
    task = make_task(
        bare,
        problem.path.target,
        problem.path.time,
        energy,
        problem.start,
        problem.end,
        approach_time,
        problem.pinned,
        problem.end_pinned,
    )
    failures = []
    attempts = [partial(searched, task, problem.path.target, search=count) for count in _searches(problem)]
    if guess is not None:
        attempts.insert(0, partial(guessed, task, problem.path.target, *_guess(problem, *guess)))
    for attempt in attempts:
        found = attempt()
        motion = jax.block_until_ready(polished(task, found))
        clock.mark("search and polish")
        outcome = _checked(problem, motion, model)
        clock.mark("check")
        if outcome.ok and gap is not None and energy.provable(bare):
            outcome = _proved(outcome, problem, task, found, model, gap)
            clock.mark("proof")
        outcome = replace(outcome, seconds=dict(clock.seconds))
        if outcome.ok or outcome.status == PlanStatus.UNREACHABLE:
            return outcome
        failures.append(outcome)
    # A motion that is only too fast tells more than a search that found none.
    return max(failures, key=lambda failure: (failure.status == PlanStatus.TOO_FAST, failure.prefix))


def _proved(plan: Plan, problem: Problem, task: Task, found: Found, model: ArmModel | None, gap: float) -> Plan:
    """The plan with what is proved of it, or a better one that the proof came upon."""
    best = plan

    def better(index: np.ndarray, swivel: np.ndarray, branch: np.ndarray) -> tuple[float, np.ndarray] | None:
        nonlocal best
        along = filled(task.arm, found.chart, task.time, index, swivel, branch, task.turning)
        start = found.starting(along["swivel"][None], along["branch"][None])
        other = _checked(problem, polished(task, start), model)
        if other.trajectory is None or other.energy + other.approach >= best.energy + best.approach:
            return None
        best = replace(other, searched=plan.searched)
        return best.energy + best.approach, np.asarray(other.trajectory.q, float)

    q = np.asarray(plan.trajectory.q, float) if plan.trajectory else np.zeros((0, problem.arm.n_joints))
    bound = certify(problem, found.chart, found.arcs, q, plan.energy + plan.approach, gap, better)
    whole = best.energy + best.approach
    return replace(best, lower_bound=bound - best.approach, gap=(whole - bound) / whole if whole > 0 else 0.0)


def _guess(problem: Problem, swivel: ArrayLike, branch: ArrayLike) -> tuple[jax.Array, jax.Array]:
    """A guess in the problem's dtype, a branch for every waypoint."""
    swivel, branch = jnp.asarray(swivel, problem.path.time.dtype), jnp.asarray(branch)
    expected = problem.path.time.shape
    if swivel.shape != expected or branch.shape not in ((), expected) or not jnp.issubdtype(branch.dtype, jnp.integer):
        raise ValueError(
            f"guess needs swivels {expected} and integer branches () or {expected}; "
            f"got {swivel.shape} and {branch.dtype}{branch.shape}"
        )
    return swivel, jnp.broadcast_to(branch, expected)


def _searches(problem: Problem) -> list[int]:
    """How many waypoints each attempt's search looks at.

    A second one looks closer, for narrow passages; a third less close, where the lattice's own coarseness made steps
    too fast.
    """
    position = np.asarray(problem.path.target.position, float)
    way = np.linalg.norm(np.diff(position, axis=0), axis=-1).sum() / float(problem.arm.length)
    wanted = np.clip((way + problem.turned) / _STEP, _FEWEST, _MOST)
    counts = (min((c for c in _COUNTS if c >= share * wanted), default=_COUNTS[-1]) for share in (1.0, 2.0, 0.5))
    return list(dict.fromkeys(min(len(problem.path), c) for c in counts))


def _checked(problem: Problem, motion: SwivelMotion, model: ArmModel | None) -> Plan:
    """The plan that a motion makes, or why it makes none."""
    arm, times = problem.arm, problem.time
    blocked = np.flatnonzero(~np.asarray(motion.feasible))
    if len(blocked):
        why = nearest_violation(arm, jax.tree.map(lambda x: x[blocked[0]], problem.path.target))
        where = f"no feasible swivel in any branch at waypoint {listed(blocked, times)} of {len(times)}: {why}"
        return _failed(problem, PlanStatus.UNREACHABLE, (where,), int(blocked[0]))
    reached = np.asarray(motion.open)
    if not reached.all():
        searched = np.unique(np.linspace(0, len(times) - 1, len(reached)).round().astype(int))
        cut = int(np.argmin(reached))
        a, b = searched[max(cut - 1, 0)], searched[cut]
        where = f"no elbow motion leads from waypoint {a} ({times[a]:.3f} s) to {b} ({times[b]:.3f} s)"
        return _failed(problem, PlanStatus.CUT, (where,), int(a) + 1)
    swivel, branch = np.asarray(motion.swivel, float), np.asarray(motion.branch, int)
    lost = np.flatnonzero(~np.isfinite(swivel))
    if len(lost):
        text = f"branch {branch[lost[0]]} has no feasible swivel at waypoint {listed(lost, times)}"
        return _failed(problem, PlanStatus.CUT, (text,), int(lost[0]))
    q = np.asarray(motion.q)
    status, problems = check(arm, problem.path, q)
    if status != PlanStatus.OK:
        return _failed(problem, status, problems, 0)
    names = model.joint_names if model else tuple(f"joint_{i + 1}" for i in range(arm.n_joints))
    parts = problem.energy.parts(arm, motion.q, problem.path.time)
    return Plan(
        trajectory=Trajectory(times, q, names, model.name if model else "", swivel, branch, notes=problem.notes()),
        swivel=swivel,
        branch=branch,
        energy=float(motion.energy),
        lower_bound=None,
        gap=None,
        status=PlanStatus.OK,
        parts={name: float(value) for name, value in parts.items()},
        energy_name=str(problem.energy),
        energy_unit=problem.energy.unit,
        searched=float(motion.searched),
        prefix=len(times),
        arm=arm,
        objective=problem.energy,
        approach=float(motion.approach),
    )


def _failed(problem: Problem, status: PlanStatus, problems: tuple[str, ...], prefix: int) -> Plan:
    """A plan without a motion."""
    if prefix > 1:
        problems = (*problems, f"the first {prefix} waypoints can be planned by themselves: path[:{prefix}]")
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
        prefix=prefix,
    )


class _Clock:
    """Wall time of the stages."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = perf_counter()

    def mark(self, stage: str) -> None:
        """Ends a stage."""
        now = perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self._last
        self._last = now
