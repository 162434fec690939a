"""Waypoints at alignments: a posture there is a swivel and a split, and search and refinement know swivels alone.

1. A waypoint within a path that is feasible at alignments alone is left out of search and refinement. Its split is then
   the one nearest to the motion found without it, and held while the whole motion is refined. That motion costs no
   less than the one without the waypoint, so that the proof for the latter holds.
2. A path that begins or ends with an aligned posture leaves it in a motion that a lattice of swivels can be too coarse
   to see. It is tracked from there, each waypoint by the posture nearest to that of the last.
"""

from typing import Any, NamedTuple

import jax
import numpy as np

from jaxik.arm import ArmModel
from jaxik.numerics import compiled_sooner
from jaxik.obstacles import moves
from jaxik.planning.inputs import PlanInputs
from jaxik.planning.motion import from_guess, refine_best
from jaxik.planning.outcome import outcome
from jaxik.planning.padding import padded
from jaxik.planning.problem import Pin
from jaxik.planning.result import Plan
from jaxik.redundancy import SelfMotion, SwivelArcs, SwivelBranch, hold_split, only_aligned, solve_nearest

Guess = tuple[np.ndarray, np.ndarray]

_only_aligned, _hold_split = compiled_sooner(only_aligned), compiled_sooner(hold_split)


def aligned_waypoints(inputs: PlanInputs) -> np.ndarray:
    """Return the waypoints within a path that are feasible at alignments alone, ``(K,)``."""
    problem, none = inputs.problem, np.zeros(len(inputs.time), bool)
    if not isinstance(problem.motion, SelfMotion) or moves(inputs.arm) or not _any_narrow(problem.arcs):
        return none
    arcs = problem.arcs
    found = np.array(_only_aligned(problem.motion, arcs.start, arcs.end, arcs.valid))[: len(none)]
    found[[0, -1]] = False
    return found


def _any_narrow(arcs: SwivelArcs) -> bool:
    """Test whether any target has arcs of no width alone, so that most paths need no program for the rest."""
    width = np.where(np.asarray(arcs.valid), np.asarray(arcs.end) - np.asarray(arcs.start), 0.0)
    return bool((np.asarray(arcs.valid).any(axis=(1, 2)) & (width.max(axis=(1, 2)) < 1e-4)).any())


def passing(inputs: PlanInputs, without: Plan, left_out: np.ndarray, model: ArmModel | None) -> Plan:
    """Return the plan of a path from the plan of the path without some aligned waypoints ``(K,)``."""
    if without.trajectory is None:
        return without
    problem, keep = inputs.problem, ~left_out
    copies: Any = [np.array(x) for x in jax.tree.leaves(problem.arcs)]
    motion, arcs = problem.motion, SwivelArcs(*copies)
    swivel, branch = np.interp(inputs.time, inputs.time[keep], without.swivel), np.zeros(len(keep), int)
    branch[keep] = without.branch
    weights = problem.energy.motion_weights(problem.arm)
    for row in np.flatnonzero(left_out):
        q = np.array([np.interp(inputs.time[row], inputs.time[keep], angle) for angle in without.trajectory.q.T])
        target = jax.tree.map(lambda x, row=row: x[row], inputs.path.target)
        there = solve_nearest(inputs.arm, target, q.astype(problem.time.dtype), weights=weights)
        if not bool(there.ok):
            return without
        posture = SwivelBranch(there.swivel, there.branch)
        motion = _hold_split(motion, row, posture, there.q)
        swivel[row], branch[row] = np.unwrap([swivel[row], float(there.swivel)])[1], int(there.branch)
        arcs.valid[row] = False
        arcs.valid[row, branch[row], 0] = True
        arcs.start[row, branch[row], 0] = arcs.end[row, branch[row], 0] = float(there.swivel)
    held = inputs._replace(problem=problem._replace(motion=motion, arcs=arcs))
    guess = padded((swivel.astype(problem.time.dtype), branch), len(problem.time))
    return outcome(held, refine_best(held.problem, from_guess(held.problem, *guess)), np.zeros(1, int), model)


def tracked(inputs: PlanInputs) -> Guess | None:
    """Return swivels and branches ``(K,)`` of the motion tracked from an aligned posture at an end; None for none.

    Where both ends are given, the motions tracked from both are joined where they are nearest to each other.
    """
    problem = inputs.problem
    if not isinstance(problem.motion, SelfMotion) or moves(inputs.arm):
        return None
    if not any(_is_held(problem.motion, int(pin.row)) for pin in problem.pins):
        return None
    found = [_tracked_from(inputs, pin) for pin in problem.pins]
    found = [x for x in found if x is not None]
    if not found:
        return None
    swivel, branch, _ = found[0] if len(found) == 1 else _joined(*found)
    return swivel, branch


class _Tracked(NamedTuple):
    """Swivels ``(K,)`` [rad], branches and joint angles ``(K, joint)`` [rad] of a tracked motion."""

    swivel: np.ndarray
    branch: np.ndarray
    q: np.ndarray


def _tracked_from(inputs: PlanInputs, pin: Pin) -> _Tracked | None:
    """Return the motion from a pinned end, each waypoint by the posture nearest to that of the last; None for none."""
    last, first = len(inputs.time) - 1, int(pin.row)
    swivel, branch, q = np.zeros(last + 1), np.zeros(last + 1, int), np.zeros((last + 1, inputs.arm.n_joints))
    swivel[first], branch[first], q[first] = float(pin.swivel), int(pin.branch), np.asarray(pin.q)
    weights, step = inputs.problem.energy.motion_weights(inputs.problem.arm), 1 if first == 0 else -1
    for row in range(1, last + 1) if first == 0 else range(last - 1, -1, -1):
        target = jax.tree.map(lambda x, row=row: x[row], inputs.path.target)
        now = q[row - step].astype(inputs.problem.time.dtype)
        there = solve_nearest(inputs.arm, target, now, weights=weights)
        if not bool(there.ok):
            return None
        swivel[row], branch[row], q[row] = float(there.swivel), int(there.branch), np.asarray(there.q)
    return _Tracked(np.unwrap(swivel), branch, q)


def _joined(ahead: _Tracked, back: _Tracked) -> _Tracked:
    """Return the first motion at the first waypoint, the second at the last, one blending into the other.

    They blend where their branches are the same, about the waypoint where they are nearest to each other.
    """
    same = ahead.branch == back.branch
    apart = np.where(same, np.abs(ahead.q - back.q).max(axis=1), np.inf)
    at = int(np.argmin(apart))
    others = np.flatnonzero(~same)
    begin = max(others[others < at], default=-1) + 1
    end = min(others[others > at], default=len(same)) - 1
    share = np.clip((np.arange(len(same)) - begin) / max(end - begin, 1), 0.0, 1.0)
    off = back.swivel - ahead.swivel
    off = off - 2 * np.pi * np.round(off[at] / (2 * np.pi))
    branch = np.where(np.arange(len(same)) <= at, ahead.branch, back.branch)
    return _Tracked(ahead.swivel + share * off, branch, ahead.q)


def _is_held(motion: SelfMotion, row: int) -> bool:
    """Test whether the split of a waypoint's shoulder or wrist is held: its angles do not depend on the swivel."""
    return any(not np.asarray(joint.entries)[:2, 1:, :, row].any() for joint in motion.spherical_joints())
