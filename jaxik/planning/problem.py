"""The planning problem: all that search, refinement, checks and proof are given."""

from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxik import energy as energies
from jaxik.arm import Arm, RefinedArm
from jaxik.energy import Energy
from jaxik.errors import ArmClassError
from jaxik.planning.closure import Closed
from jaxik.planning.feasible_targets import FeasibleTargets, feasible_targets
from jaxik.planning.ranges import apart, into_ranges, outside
from jaxik.redundancy import (
    ParameterMotion,
    SelfMotion,
    SwivelArcs,
    SwivelBranch,
    feasible_arcs,
    has_swivel,
    hold_split,
    parameter_motion,
    self_motion,
    swivel_arcs,
    swivel_of,
)
from jaxik.targets import Target

AnyMotion = SelfMotion | ParameterMotion
AnyArcs = SwivelArcs | FeasibleTargets

_UNLIMITED = 1e6  # times a speed limit


class EndPosture(NamedTuple):
    """The posture that the arm comes from before a path, or goes on to after it.

    Attributes:
        q: Joint angles, ``(joint,)`` [rad].
        time: Time for the motion between it and the path, ``()`` [s].
        pin: Swivel [rad] and branch that the path's motion has to begin or end with, ``()`` each; None for none.
    """

    q: Array
    time: Array
    pin: SwivelBranch | None = None


class Pin(NamedTuple):
    """An end of the path that is held.

    Attributes:
        row: First or last waypoint, ``()``.
        q: Joint angles there, ``(joint,)`` [rad].
        swivel: Swivel there, ``()`` [rad].
        branch: Branch there, ``()``.
    """

    row: int | Array
    q: Array
    swivel: Array
    branch: Array


class PlanningProblem(NamedTuple):
    """A path of K waypoints to plan, as arrays of one float dtype.

    A shorter path may be padded: waypoints that repeat its last target and time cost nothing and stay where the last
    one is (see :func:`jaxik.energy.counted`). The path then gets the motion that it gets by itself.

    Attributes:
        motion: Self-motion of the targets, rows ``(K,)``.
        arcs: Feasible swivels of the targets, ``(K, 8, arcs)``; of arms planned in joint space which targets have any.
        time: Times of the waypoints, ``(K,)`` [s]; the last may be repeated.
        energy: Energy to minimize.
        start: Posture before the path, if any.
        end: Posture after the path, if any.
        target: Targets ``(K,)``, where what they are missed by is asked for.
        closed: Given if the last posture has to be the first. Rows of ``motion`` and ``arcs`` are then the same there.
    """

    motion: AnyMotion
    arcs: Any  # one of AnyArcs, by the arm's class
    time: Array
    energy: Energy
    start: EndPosture | None = None
    end: EndPosture | None = None
    target: Target | None = None
    closed: Closed | None = None

    @property
    def arm(self) -> Arm:
        """The arm."""
        return self.motion.arm

    @property
    def counted(self) -> Array:
        """True for the waypoints of the path, False for those that pad it, ``(K,)``."""
        return energies.counted(self.time)

    @property
    def durations(self) -> Array:
        """Duration of each step, infinite behind the last waypoint, ``(K - 1,)`` [s]."""
        return energies.durations(self.time)

    @property
    def last(self) -> Array:
        """The last waypoint, ``()``."""
        return jnp.sum(self.counted) - 1

    def from_last(self, following: int = 0) -> Array:
        """True from the last waypoint on, or from one that follows it, ``(K,)``."""
        return jnp.arange(len(self.time)) >= self.last + following

    def padded(self, rows: Array) -> Array:
        """Return rows ``(K, ...)`` with that of the last waypoint in all behind it."""
        return rows[jnp.minimum(jnp.arange(len(rows)), self.last)]

    @property
    def end_postures(self) -> tuple[tuple[int | Array, EndPosture], ...]:
        """Rows and postures of the ends that have one."""
        before = () if self.start is None else ((0, self.start),)
        return before if self.end is None else (*before, (self.last, self.end))

    @property
    def pins(self) -> tuple["Pin", ...]:
        """The ends that the motion has to begin or end with."""
        return tuple(Pin(row, end.q, *end.pin) for row, end in self.end_postures if end.pin is not None)

    def at_any_speed(self) -> "PlanningProblem":
        """Return the problem without speed limits."""
        arm = replace(self.arm, velocity_limit=_UNLIMITED * self.arm.velocity_limit)
        return self._replace(motion=self.motion._replace(arm=arm))

    def in_ranges(self, q: Array) -> Array:
        """Return a motion ``(K, joint)`` in the turns that its joints' ranges and the postures at its ends ask for."""
        near = [end.q - q[row] + q[0] for row, end in self.end_postures]
        q = into_ranges(self.arm, q, near[0] if near else None)
        if self.closed is None:
            return q
        return jnp.where(self.from_last()[:, None], q[0] + _turns(q[-1] - q[0]), q)  # without rounding

    def misfits(self, q: Array) -> Array:
        """Return which joints leave their ranges, or are turns away from where they have to be, ``(joint,)``.

        A joint has to be at what is pinned, and on a closed path where it began: cables twist.
        """
        away = [jnp.abs(q[pin.row] - pin.q) > jnp.pi for pin in self.pins]
        away += [] if self.closed is None else [jnp.abs(q[-1] - q[0]) > jnp.pi]
        return jnp.any(jnp.stack([outside(self.arm, q), *away]), axis=0)

    def at(self, index: np.ndarray | Array) -> "PlanningProblem":
        """Return the problem at some waypoints, first and last included."""
        arcs, target = jax.tree.map(lambda x: x[index], (self.arcs, self.target))
        return self._replace(motion=self.motion.at(index), arcs=arcs, time=self.time[index], target=target)


def _turns(angle: Array) -> Array:
    """The full turns nearest to an angle [rad]."""
    return 2 * jnp.pi * jnp.round(angle / (2 * jnp.pi))


def in_joint_space(arm: Arm) -> bool:
    """Test for an arm whose motions are searched and refined in joint space (:mod:`jaxik.planning.postures`)."""
    return isinstance(arm, RefinedArm)


def make_problem(
    arm: Arm, target: Target, time: ArrayLike, energy: Energy | None = None, **ends: Any
) -> PlanningProblem:
    """Return the problem of K targets in their dtype; for the other arguments see :func:`problem_of`."""
    motion, arcs = motion_and_arcs(apart(arm.astype(target.position.dtype)), target)
    return problem_of(motion, arcs, target, time, energy, **ends)


def motion_and_arcs(arm: Arm, target: Target) -> tuple[AnyMotion, AnyArcs]:
    """Return the self-motion of targets ``(K,)`` of the arm's dtype, and its feasible arcs."""
    if in_joint_space(arm):
        if arm.surroundings is not None:
            raise ArmClassError(
                f"plans keep S-R-S arms and arms with an outer joint clear of obstacles, so far; got a "
                f"{arm.kinematic_class} arm: plan without its body, and look with jaxik.clearance"
            )
        motion = parameter_motion(arm, target)
        return motion, feasible_targets(motion)
    if not has_swivel(arm):
        return parameter_motion(replace(arm, surroundings=None), target), swivel_arcs(arm, target)
    motion = self_motion(arm, target)
    # The arcs hold what obstacles leave: the programs of search and refinement are the same with and without them.
    return motion._replace(free=None), feasible_arcs(motion)


def problem_of(
    motion: AnyMotion,
    arcs: AnyArcs,
    target: Target | None,
    time: ArrayLike,
    energy: Energy | None = None,
    *,
    start: ArrayLike | None = None,
    end: ArrayLike | None = None,
    approach_time: ArrayLike = 1.0,
    pinned: bool = False,
    end_pinned: bool = False,
    closed: bool = False,
) -> PlanningProblem:
    """Return the problem of K targets; for the options see :func:`jaxik.least_energy_motion`.

    In a closed one the first target takes the place of the last.
    """
    dtype = motion.arm.lower.dtype

    def posture(q: ArrayLike | None, pinned: bool) -> EndPosture | None:
        if q is None:
            return None
        q = jnp.asarray(q, dtype)
        return EndPosture(q, jnp.asarray(approach_time, dtype), swivel_of(motion.arm, q) if pinned else None)

    energy = energies.joint_motion() if energy is None else energy
    before, after = posture(start, pinned), posture(end, end_pinned)
    mark = Closed() if closed else None
    problem = PlanningProblem(motion, arcs, jnp.asarray(time, dtype), energy, before, after, target, mark)
    if closed:
        rows = jnp.where(problem.from_last(), 0, jnp.arange(len(problem.time)))
        motion, arcs = motion.at(rows), jax.tree.map(lambda x: x[rows], arcs)
    for pin in problem.pins:  # at an alignment, where the swivel alone leaves the posture open
        if isinstance(motion, SelfMotion):
            motion = hold_split(motion, pin.row, SwivelBranch(pin.swivel, pin.branch), pin.q)
    return problem._replace(motion=motion, arcs=arcs)
