"""From a path to the least-energy motion along it, and the proof that it is.

The search and the refinement are :func:`jaxik.least_energy_motion`'s; here their answer is checked against targets,
limits and speeds, and failures are reported with waypoints, times and joints. A search that finds no motion, or one
whose motion does not pass the check, is repeated on other waypoints. :func:`jaxik.planning.certificate.certify` then
bounds the energy of any other motion.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from time import perf_counter

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Float, Int

from jaxik import energy as energies
from jaxik.arm import Arm, ArmModel, as_arm
from jaxik.energy import Energy
from jaxik.paths import Path
from jaxik.planning.certificate import certify
from jaxik.planning.check import check, nearest_violation
from jaxik.planning.initial_guess import interpolate_on_host
from jaxik.planning.inputs import PlanInputs, checked_inputs
from jaxik.planning.motion import SearchResult, SwivelMotion, from_guess, refine_best, search_motion
from jaxik.planning.result import Plan, listed
from jaxik.planning.search_size import searched_waypoints
from jaxik.planning.status import PlanStatus
from jaxik.trajectories import Trajectory

# Densities of searched waypoints, tried in turn: the usual one; a finer one for narrow passages; a coarser one, where
# the lattice's own coarseness made steps too fast.
_DENSITIES = (1.0, 2.0, 0.5)


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
    """Plan the least-energy motion of the elbow along a path.

    Searches globally over swivel and branch, refines, and proves how much better any other motion could be. Runs on the
    host around compiled parts; the dtype is the arm's.

    Args:
        arm: The arm, or the model that also knows its names.
        path: The path in the arm's base frame (see :func:`jaxik.fit_path`).
        energy: Energy to minimize; None for :func:`jaxik.energy.joint_motion`.
        start: Posture the arm comes from, ``(joint,)`` [rad]. If it is at the first target already, the motion begins
            with it; otherwise the straight joint motion from it to the first waypoint is part of the minimization.
        end: Posture the arm goes on to, likewise.
        approach_time: Time for that motion, and for the one to ``end`` [s].
        gap: Largest distance of the plan's ``lower_bound`` from its energy, as a fraction; smaller takes longer. None
            proves nothing. Only energies of joint motion and holding torques have a bound.
        guess: Swivels ``(K,)`` [rad] and branch, one or ``(K,)``, of a motion to begin with instead of a search, such
            as that of :func:`jaxik.plan_batch` or of the last plan. The search follows where it leads to no motion;
            with a proof, motions better than the guess are found on the way.

    Returns:
        The plan; its status and problems say where and why there is no motion.

    Raises:
        ValueError: Not a path, or not one for this arm; an energy of torques for an arm without masses; a gap that is
            not between 0 and 1; a guess of another length than the path.

    **Differentiability**: :func:`jaxik.least_energy_motion` is the same motion as a function of arrays.
    """
    model, arm = arm if isinstance(arm, ArmModel) else None, as_arm(arm)
    energy = energies.joint_motion() if energy is None else energy
    clock = _Clock()
    energy.check(arm)
    if gap is not None and not 0 < gap < 1:
        raise ValueError(f"gap is a fraction of the energy between 0 and 1, or None for no proof; got {gap!r}")
    inputs = checked_inputs(arm, path, energy, start, end, approach_time)
    failures = []
    for attempt in _attempts(inputs, guess):
        found = attempt()
        motion = jax.block_until_ready(refine_best(inputs.problem, found))
        clock.mark("search and refinement")
        outcome = _checked(inputs, motion, model)
        clock.mark("check")
        if outcome.ok and gap is not None and energy.provable(arm):
            outcome = _proved(outcome, inputs, model, gap)
            clock.mark("proof")
        outcome = replace(outcome, seconds=dict(clock.seconds))
        if outcome.ok or outcome.status == PlanStatus.UNREACHABLE:
            return outcome
        failures.append(outcome)
    # A motion that is only too fast tells more than a search that found none.
    return max(failures, key=lambda failure: (failure.status == PlanStatus.TOO_FAST, failure.reachable_prefix))


def _attempts(inputs: PlanInputs, guess: tuple[ArrayLike, ArrayLike] | None) -> Iterator[Callable[[], SearchResult]]:
    """The initial guesses to refine in turn: the caller's, then searches of other densities."""
    problem = inputs.problem
    if guess is not None:
        yield partial(from_guess, problem, *_checked_guess(problem.time, *guess))
    tried = set()
    for density in _DENSITIES:
        size = searched_waypoints(problem.arm, inputs.path.target, density=density)
        if size not in tried:
            tried.add(size)
            yield partial(search_motion, problem, search=size)


def _proved(plan: Plan, inputs: PlanInputs, model: ArmModel | None, gap: float) -> Plan:
    """The plan with its certificate, or a better plan that the proof came upon."""
    best = plan

    def improve(index: np.ndarray, swivel: np.ndarray, branch: np.ndarray) -> tuple[float, np.ndarray] | None:
        nonlocal best
        start = from_guess(inputs.problem, *interpolate_on_host(inputs.problem, index, swivel, branch))
        other = _checked(inputs, refine_best(inputs.problem, start), model)
        if other.trajectory is None or other.energy + other.approach_energy >= best.energy + best.approach_energy:
            return None
        best = replace(other, energy_before_refinement=plan.energy_before_refinement)
        return best.energy + best.approach_energy, np.asarray(other.trajectory.q, float)

    q = np.asarray(plan.trajectory.q, float) if plan.trajectory else np.zeros((0, inputs.problem.arm.n_joints))
    bound = certify(inputs.problem, q, plan.energy + plan.approach_energy, gap, improve)
    whole = best.energy + best.approach_energy
    return replace(best, lower_bound=bound - best.approach_energy, gap=(whole - bound) / whole if whole > 0 else 0.0)


def _checked_guess(time: jax.Array, swivel: ArrayLike, branch: ArrayLike) -> tuple[jax.Array, jax.Array]:
    """A guess in the problem's dtype, a branch for every waypoint."""
    swivel, branch = jnp.asarray(swivel, time.dtype), jnp.asarray(branch)
    expected = time.shape
    if swivel.shape != expected or branch.shape not in ((), expected) or not jnp.issubdtype(branch.dtype, jnp.integer):
        raise ValueError(
            f"guess needs swivels {expected} and integer branches () or {expected}; "
            f"got {swivel.shape} and {branch.dtype}{branch.shape}"
        )
    return swivel, branch


def _checked(inputs: PlanInputs, motion: SwivelMotion, model: ArmModel | None) -> Plan:
    """The plan of a motion, or the reason why it makes none."""
    problem, times = inputs.problem, inputs.time
    arm, energy = problem.arm, inputs.energy
    blocked = np.flatnonzero(~np.asarray(motion.feasible))
    if len(blocked):
        why = nearest_violation(arm, jax.tree.map(lambda x: x[blocked[0]], inputs.path.target))
        where = f"no feasible swivel in any branch at waypoint {listed(blocked, times)} of {len(times)}: {why}"
        return _failed(inputs, PlanStatus.UNREACHABLE, (where,), int(blocked[0]))
    reached = np.asarray(motion.reached)
    if not reached.all():
        searched = np.unique(np.linspace(0, len(times) - 1, len(reached)).round().astype(int))
        cut = int(np.argmin(reached))
        a, b = searched[max(cut - 1, 0)], searched[cut]
        where = f"no elbow motion leads from waypoint {a} ({times[a]:.3f} s) to {b} ({times[b]:.3f} s)"
        return _failed(inputs, PlanStatus.DISCONNECTED, (where,), int(a) + 1)
    swivel, branch = np.asarray(motion.swivel, float), np.asarray(motion.branch, int)
    lost = np.flatnonzero(~np.isfinite(swivel))
    if len(lost):
        text = f"branch {branch[lost[0]]} has no feasible swivel at waypoint {listed(lost, times)}"
        return _failed(inputs, PlanStatus.DISCONNECTED, (text,), int(lost[0]))
    q = np.asarray(motion.q)
    status, problems = check(arm, inputs.path, q)
    if status != PlanStatus.OK:
        return _failed(inputs, status, problems, 0)
    names = model.joint_names if model else tuple(f"joint_{i + 1}" for i in range(arm.n_joints))
    parts = energy.parts(arm, motion.q, problem.time)
    return Plan(
        trajectory=Trajectory(times, q, names, model.name if model else "", swivel, branch, notes=inputs.notes()),
        swivel=swivel,
        branch=branch,
        energy=float(motion.energy),
        lower_bound=None,
        gap=None,
        status=PlanStatus.OK,
        parts={name: float(value) for name, value in parts.items()},
        energy_name=str(energy),
        energy_unit=energy.unit,
        energy_before_refinement=float(motion.energy_before_refinement),
        reachable_prefix=len(times),
        arm=arm,
        energy_fn=energy,
        approach_energy=float(motion.approach_energy),
    )


def _failed(inputs: PlanInputs, status: PlanStatus, problems: tuple[str, ...], prefix: int) -> Plan:
    """A plan without a motion."""
    if prefix > 1:
        problems = (*problems, f"the first {prefix} waypoints can be planned by themselves: path[:{prefix}]")
    return Plan(
        trajectory=None,
        swivel=np.full(len(inputs.time), np.nan),
        branch=np.zeros(len(inputs.time), int),
        energy=float("inf"),
        lower_bound=None,
        gap=None,
        status=status,
        problems=problems,
        energy_name=str(inputs.energy),
        energy_unit=inputs.energy.unit,
        reachable_prefix=prefix,
    )


class _Clock:
    """Wall time of the stages."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = perf_counter()

    def mark(self, stage: str) -> None:
        """End a stage."""
        now = perf_counter()
        self.seconds[stage] = self.seconds.get(stage, 0.0) + now - self._last
        self._last = now
