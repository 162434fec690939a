"""From a path to the least-energy motion along it, and the proof that it is.

The search and the refinement are :func:`jaxik.least_energy_motion`'s; here their answer is checked against targets,
limits and speeds, and failures are reported with waypoints, times and joints. A search that finds no motion, or one
whose motion does not pass the check, is repeated on other waypoints. :func:`jaxik.planning.certificate.certify` then
bounds the energy of any other motion.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from time import perf_counter
from typing import Literal, NamedTuple

import jax
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Float, Int

from jaxik import energy as energies
from jaxik.arm import Arm, ArmModel, as_arm
from jaxik.energy import Energy
from jaxik.obstacles import World, in_world
from jaxik.paths import Path
from jaxik.planning.aligned_waypoints import aligned_waypoints, passing, tracked
from jaxik.planning.certificate import certify
from jaxik.planning.failure import explained
from jaxik.planning.initial_guess import interpolate_on_host
from jaxik.planning.inputs import PlanInputs, checked_inputs
from jaxik.planning.motion import AnyFound, evenly_spaced, from_guess, refine_best, search_at
from jaxik.planning.outcome import misfits, outcome
from jaxik.planning.padding import padded
from jaxik.planning.ranges import window, windows
from jaxik.planning.result import Plan
from jaxik.planning.search_size import searched_counts, searched_size
from jaxik.planning.status import PlanStatus
from jaxik.redundancy import has_swivel

# Densities of searched waypoints, tried in turn: the usual one; a finer one for narrow passages; a coarser one, where
# the lattice's own coarseness made steps too fast.
_DENSITIES = (1.0, 2.0, 0.5)
_GAIN = 1e-6  # of the energy; windows move while that much is gained

_Guess = tuple[ArrayLike, ArrayLike]


def plan(
    arm: Arm | ArmModel,
    path: Path,
    *,
    energy: Energy | None = None,
    start: Float[ArrayLike, "joint"] | None = None,
    end: Float[ArrayLike, "joint"] | Literal["start"] | None = None,
    approach_time: float = 1.0,
    gap: float | None = 0.01,
    world: World | None = None,
    clearance: float = 0.0,
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
        end: Posture the arm goes on to, likewise; or "start" for a motion that can be repeated for ever. With ``start``
            that is the posture it goes back to. Otherwise the path has to be closed: its last target is its first, and
            the last joint angles will be exactly the first, which are free. Joints that could turn for ever come back
            too, without full turns: cables twist. The energy is that of one round, and its velocities may differ at
            both ends of it, as those of any plan.
        approach_time: Time for that motion, and for the one to ``end`` [s].
        gap: Largest distance of the plan's ``lower_bound`` from its energy, as a fraction; smaller takes longer. None
            proves nothing. Only energies of joint motion and holding torques have a bound.
        world: Obstacles, for an arm with a body (:func:`jaxik.with_body`): at every waypoint the body keeps clear of
            them, and of itself. Batch axes ``(K,)`` are one world per waypoint. :meth:`Plan.clearance` says how close
            the motion comes between waypoints; the approaches from ``start`` and to ``end`` are not examined.
        clearance: Least distance to keep at the waypoints [m], as a margin for the motion between them.
        guess: Swivels ``(K,)`` [rad] and branch, one or ``(K,)``, of a motion to begin with instead of a search, such
            as that of :func:`jaxik.plan_batch` or of the last plan. The search follows where it leads to no motion;
            with a proof, motions better than the guess are found on the way.

    Returns:
        The plan; its status and problems say where and why there is no motion.

    Raises:
        ValueError: Not a path, or not one for this arm; an energy of torques for an arm without masses; a gap that is
            not between 0 and 1; a guess of another length than the path; a world, or a clearance, for an arm without a
            body, or one of another length than the path.

    **Differentiability**: :func:`jaxik.least_energy_motion` is the same motion as a function of arrays.
    """
    model, arm = arm if isinstance(arm, ArmModel) else None, as_arm(arm, any_class=True)
    energy = energies.joint_motion() if energy is None else energy
    clock = _Clock()
    energy.check(arm)
    if gap is not None and not 0 < gap < 1:
        raise ValueError(f"gap is a fraction of the energy between 0 and 1, or None for no proof; got {gap!r}")
    arm = in_world(arm, world)
    inputs = checked_inputs(_with_margin(arm, clearance), path, energy, start, end, approach_time)
    sizes = _sizes(inputs)
    guesses = [] if guess is None else [_checked_guess(inputs, *guess)]
    search = _Search(sizes, model, clock)
    at_alignments = aligned_waypoints(inputs)
    rest = inputs.without(at_alignments) if at_alignments.any() else inputs
    found, planned = search.in_ranges(rest, [(s[~at_alignments], b[~at_alignments]) for s, b in guesses])
    if rest is not inputs:
        found = passing(inputs, found, at_alignments, model)
        if not found.ok:
            found, planned = search.in_ranges(inputs, guesses)
    if found.ok and gap is not None and energy.provable(arm) and has_swivel(arm):
        if rest is inputs:
            found = _proved(found, inputs, model, gap)
        elif not energy.at_rest:  # a cost at every waypoint cannot be bounded without some of them
            found = _proved_without(found, rest, at_alignments, gap)
        clock.mark("proof")
    elif not found.ok:
        found = explained(planned, found, sizes)
        clock.mark("explanation")
    return replace(found, arm=arm if found.ok else None, seconds=dict(clock.seconds))


def _with_margin(arm: Arm, clearance: float) -> Arm:
    """The arm with a margin about its body and world."""
    if not clearance:
        return arm
    if arm.surroundings is None:
        raise ValueError("a clearance needs the arm's body: model = jaxik.with_body(model, body)")
    if not clearance > 0:
        raise ValueError(f"clearance is a distance of 0 m or more; got {clearance!r}")
    return replace(arm, surroundings=arm.surroundings.grown(clearance))


def _sizes(inputs: PlanInputs) -> tuple[int, ...]:
    """Numbers of waypoints to search, in turn."""
    return tuple(dict.fromkeys(searched_counts(inputs.arm, inputs.path.target, _DENSITIES)))


class _Search(NamedTuple):
    """Searches, refinements and checks until one makes a plan.

    Attributes:
        sizes: Numbers of waypoints to search, in turn.
        model: Names of the joints.
        clock: Wall time of the stages.
    """

    sizes: tuple[int, ...]
    model: ArmModel | None
    clock: "_Clock"

    def in_ranges(self, inputs: PlanInputs, guesses: Sequence[_Guess]) -> tuple[Plan, PlanInputs]:
        """Return a plan, or the failure that tells most, and the inputs it is one for.

        Joints whose range exceeds a turn are free to turn first, and get windows where the motion then leaves the range
        (see :mod:`jaxik.planning.ranges`).
        """
        found = unturned = self.first(inputs, guesses)
        joints = np.zeros(inputs.arm.n_joints, bool)
        through = next((np.asarray(pin.q, float) for pin in inputs.problem.pins), None)
        while found.misfits.any():
            joints |= found.misfits
            index = np.flatnonzero(joints)
            tried = [self.first(inputs.for_arm(arm), guesses) for arm in windows(inputs.arm, index, through)]
            found = max(tried, key=_Found.rank)
            free = self.again(found, inputs)  # a motion that has found its turns may use all of the range
            while through is None and free is found and found.plan.trajectory is not None:
                q = found.plan.trajectory.q[:, index]
                moved = inputs.for_arm(window(inputs.arm, index, (q.min(axis=0) + q.max(axis=0)) / 2))
                if (closer := self.again(found, moved)) is found:
                    break
                found = closer
            found = free if free.plan.cost < found.plan.cost else found
        # A closed path that leads to full turns, and in no window to a motion, fails for these turns.
        found = unturned if not found.plan.ok and unturned.plan.status == PlanStatus.NOT_CLOSED else found
        return found.plan, found.inputs

    def again(self, found: "_Found", inputs: PlanInputs) -> "_Found":
        """Return what a plan becomes in other limits where that is better, else the plan itself."""
        if not found.plan.ok:
            return found
        other = self.first(inputs, [(found.plan.swivel, found.plan.branch)], search=False)
        return other if other.plan.cost < found.plan.cost * (1 - _GAIN) else found

    def first(self, inputs: PlanInputs, guesses: Sequence[_Guess], search: bool = True) -> "_Found":
        """Return the first plan from guesses and searches, or the failure that tells most."""
        problem, failures = inputs.problem, []
        for searched, attempt in self._attempts(inputs, guesses, search):
            motion = jax.block_until_ready(refine_best(problem, attempt()))
            self.clock.mark("search and refinement")
            plan = outcome(inputs, motion, searched, self.model)
            connected = plan.status in (PlanStatus.CHECK_FAILED, PlanStatus.TOO_FAST, PlanStatus.NOT_CLOSED)
            found = _Found(
                plan, inputs, misfits(inputs, motion.q) if connected else np.zeros(problem.arm.n_joints, bool)
            )
            self.clock.mark("check")
            if plan.ok or plan.status == PlanStatus.UNREACHABLE or found.misfits.any():
                return found
            failures.append(found)
        if search and (guess := tracked(inputs)) is not None:
            motion = refine_best(problem, from_guess(problem, *padded(guess, len(problem.time))))
            plan = outcome(inputs, motion, np.zeros(1, int), self.model)
            if plan.ok:
                return _Found(plan, inputs, np.zeros(problem.arm.n_joints, bool))
        return max(failures, key=_Found.rank)

    def _attempts(
        self, inputs: PlanInputs, guesses: Sequence[_Guess], search: bool
    ) -> Iterator[tuple[np.ndarray, Callable[[], AnyFound]]]:
        """The initial guesses to refine, with the waypoints searched: given ones, then searches of all sizes."""
        for guess in guesses:
            at_all = padded(guess, len(inputs.problem.time))
            yield np.zeros(1, int), partial(from_guess, inputs.problem, *at_all)
        # On the lattice steps can be too fast that are not so in the end: refined, these motions may be slow enough.
        for any_speed in (False, True):
            for size in self.sizes if search else ():
                problem = inputs.problem.at_any_speed() if any_speed else inputs.problem
                index = evenly_spaced(len(inputs.time) - 1, size)
                yield index, partial(search_at, problem, padded(index, searched_size(size)))


class _Found(NamedTuple):
    """A plan or a failure.

    Attributes:
        plan: The plan.
        inputs: Inputs that were planned.
        misfits: Joints that its motion leads out of their ranges, which others may not, ``(joint,)``.
    """

    plan: Plan
    inputs: PlanInputs
    misfits: np.ndarray

    def rank(self) -> tuple[bool, float, bool, int]:
        """The larger the better. A motion that is only too fast tells more than a search that found none."""
        return self.plan.ok, -self.plan.cost, self.plan.status == PlanStatus.TOO_FAST, self.plan.reachable_prefix


def _proved(plan: Plan, inputs: PlanInputs, model: ArmModel | None, gap: float) -> Plan:
    """The plan with its certificate, or a better plan that the proof came upon."""
    best = plan

    def improve(index: np.ndarray, swivel: np.ndarray, branch: np.ndarray) -> tuple[float, np.ndarray] | None:
        nonlocal best
        start = from_guess(inputs.problem, *interpolate_on_host(inputs.problem, index, swivel, branch))
        other = outcome(inputs, refine_best(inputs.problem, start), np.zeros(1, int), model)
        if other.trajectory is None or other.cost >= best.cost:
            return None
        best = replace(other, energy_before_refinement=plan.energy_before_refinement)
        return best.cost, np.asarray(other.trajectory.q, float)

    q = np.asarray(plan.trajectory.q, float) if plan.trajectory else np.zeros((0, inputs.problem.arm.n_joints))
    bound = certify(inputs.problem, q, plan.cost, gap, improve)
    whole = best.cost
    return replace(best, lower_bound=bound - best.approach_energy, gap=(whole - bound) / whole if whole > 0 else 0.0)


def _proved_without(plan: Plan, rest: PlanInputs, left_out: np.ndarray, gap: float) -> Plan:
    """The plan with a certificate of the path without some waypoints, whose motions cost no more."""
    if plan.trajectory is None:
        return plan
    q = np.asarray(plan.trajectory.q, float)[~left_out]
    bound = certify(rest.problem, q, plan.cost, gap, lambda *_: None)
    return replace(plan, lower_bound=bound - plan.approach_energy, gap=1 - bound / plan.cost if plan.cost > 0 else 0.0)


def _checked_guess(inputs: PlanInputs, swivel: ArrayLike, branch: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """A guess in the problem's dtype, a branch for every waypoint."""
    swivel, branch = np.asarray(swivel, inputs.problem.time.dtype), np.asarray(branch)
    expected = inputs.time.shape
    if swivel.shape != expected or branch.shape not in ((), expected) or not np.issubdtype(branch.dtype, np.integer):
        raise ValueError(
            f"guess needs swivels {expected} and integer branches () or {expected}; "
            f"got {swivel.shape} and {branch.dtype}{branch.shape}"
        )
    return swivel, np.broadcast_to(branch, expected)


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
