"""From a motion of arrays to a plan: checked against targets, limits and speeds, failures with waypoints and times."""

from dataclasses import replace

import jax
import numpy as np
from jax import Array

from jaxik.arm import Arm, ArmModel
from jaxik.energy import Energy
from jaxik.numerics import compiled_sooner
from jaxik.planning.check import check, nearest_violation
from jaxik.planning.feasible_targets import FeasibleTargets
from jaxik.planning.inputs import PlanInputs
from jaxik.planning.problem import PlanningProblem
from jaxik.planning.result import Plan, listed
from jaxik.planning.status import PlanStatus
from jaxik.planning.swivel_motion import SwivelMotion
from jaxik.trajectories import Trajectory

NO_RETURN = "no elbow motion returns to the posture in which it begins"


def outcome(inputs: PlanInputs, motion: SwivelMotion, searched: np.ndarray, model: ArmModel | None = None) -> Plan:
    """Return the plan of a motion, or the reason why it makes none.

    Args:
        inputs: The inputs of the plan.
        motion: The motion found.
        searched: Waypoints that the search saw, ``(n,)``.
        model: Names of the joints.

    Returns:
        The plan; a failure's ``reachable_prefix`` ends before the first waypoint that is known to be in the way.
    """
    times, arm, energy = inputs.time, inputs.arm, inputs.energy
    problem, own = inputs.problem, slice(len(times))  # what lies behind the last waypoint is padding
    blocked = np.flatnonzero(~np.asarray(motion.feasible)[own])
    if len(blocked):
        first = int(blocked[0])
        there = arm if arm.surroundings is None else replace(arm, surroundings=arm.surroundings.rows(first))
        why = nearest_violation(there, jax.tree.map(lambda x: x[first], inputs.path.target))
        where = f"no feasible swivel in any branch at waypoint {listed(blocked, times)} of {len(times)}: {why}"
        return failed(inputs, PlanStatus.UNREACHABLE, (where,), int(blocked[0]))
    reached = np.asarray(motion.reached)[: len(searched)]
    if not reached.all():
        cut = int(np.argmin(reached))
        a, b = searched[max(cut - 1, 0)], searched[cut]
        where = f"no elbow motion leads from waypoint {a} ({times[a]:.3f} s) to {b} ({times[b]:.3f} s)"
        return failed(inputs, PlanStatus.DISCONNECTED, (where,), int(a) + 1)
    swivel, branch, q = np.asarray(motion.swivel, float)[own], np.asarray(motion.branch, int)[own], np.asarray(motion.q)
    lost = _without_arc(problem, branch)
    if len(lost):
        text = f"branch {branch[lost[0]]} has no feasible swivel at waypoint {listed(lost, times)}"
        return failed(inputs, PlanStatus.DISCONNECTED, (text,), int(lost[0]))
    if int(motion.status) == PlanStatus.DISCONNECTED:
        return failed(inputs, PlanStatus.DISCONNECTED, ("no elbow motion leads along the path",), 0)
    if int(motion.status) == PlanStatus.NOT_CLOSED:
        return failed(inputs, PlanStatus.NOT_CLOSED, (_not_closed(q),), len(times))
    q = q[own]
    status, problems, keeps = check(arm, inputs.path, q, times)
    if status == PlanStatus.OK and (wrong := np.flatnonzero(misfits(inputs, motion.q))).size:
        text = f"joint {wrong[0] + 1} would have to begin or end full turns away from the posture given"
        return failed(inputs, PlanStatus.CHECK_FAILED, (text,), 0)
    if status != PlanStatus.OK:
        return failed(inputs, status, problems, keeps)
    names = model.joint_names if model else tuple(f"joint_{i + 1}" for i in range(arm.n_joints))
    parts = _parts(arm, energy, motion.q, problem.time)
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


def _without_arc(problem: PlanningProblem, branch: np.ndarray) -> np.ndarray:
    """Waypoints whose branch ``(K,)`` has no feasible arc, if arcs are known."""
    if isinstance(problem.arcs, FeasibleTargets):
        return np.zeros(0, int)
    valid = np.asarray(problem.arcs.valid)[np.arange(len(branch)), branch]
    without: np.ndarray = np.logical_not(valid.any(axis=-1))
    for row, end in ((0, problem.start), (-1, problem.end)):
        without[row] &= end is None or end.pin is None
    return np.flatnonzero(without)


@compiled_sooner
def _parts(arm: Arm, energy: Energy, q: Array, time: Array) -> dict[str, Array]:
    return energy.parts(arm, q, time)


def _not_closed(q: np.ndarray) -> str:
    """Why a motion ``(K, joint)`` does not return, as text."""
    turns = np.round((q[-1] - q[0]) / (2 * np.pi))
    joint = int(np.argmax(np.abs(turns)))
    if not turns[joint]:
        return NO_RETURN
    return f"joint {joint + 1} would turn by {360 * turns[joint]:.0f}° in every round"


def misfits(inputs: PlanInputs, q: Array) -> np.ndarray:
    """Return the turning joints that a motion ``(K, joint)`` leads out of their ranges, ``(joint,)``."""
    turning = np.asarray(inputs.arm.turning)
    return turning & np.asarray(_misfits(inputs.problem, q)) if turning.any() else turning


_misfits = compiled_sooner(PlanningProblem.misfits)


def failed(inputs: PlanInputs, status: PlanStatus, problems: tuple[str, ...], prefix: int) -> Plan:
    """Return a plan without a motion."""
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
