"""Reasons for a failure: too little time, a joint's limit, or a waypoint; and the prefix that plans.

All trials have the shapes of the plan that failed, so that nothing is compiled for them: a prefix is padded to the same
size, and speeds and limits are data.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from jaxik.arm import Arm
from jaxik.planning.check import speed_ratios, too_fast
from jaxik.planning.clearance_along import clearance_at
from jaxik.planning.inputs import PlanInputs
from jaxik.planning.motion import evenly_spaced, refine_best, search_at
from jaxik.planning.outcome import NO_RETURN, outcome
from jaxik.planning.padding import padded
from jaxik.planning.problem import PlanningProblem
from jaxik.planning.result import Plan
from jaxik.planning.search_size import searched_size
from jaxik.planning.status import PlanStatus
from jaxik.planning.swivel_motion import SwivelMotion

_HALVINGS = 6  # of the factor between too fast and slow enough, on a logarithmic scale
_ROUNDING = 1e-3  # of a factor that is printed with as many digits
_JUMP = np.pi / 2  # rad between neighboring waypoints; a joint that moves further does not follow the path
_PREFIXES = 8  # tried one waypoint or more shorter; then each is half of the one before


def explained(inputs: PlanInputs, failure: Plan, sizes: tuple[int, ...]) -> Plan:
    """Return a failure with the time or the limit that stands in the way, and the longest prefix known to plan.

    Args:
        inputs: The inputs of the plan that failed.
        failure: The failure.
        sizes: Numbers of waypoints searched, in the order in which they were tried.

    Returns:
        The failure: TOO_FAST in the place of DISCONNECTED where more time would do.
    """
    trials = _Trials(inputs, sizes)
    status, problems = failure.status, failure.problems
    if status in (PlanStatus.DISCONNECTED, PlanStatus.TOO_FAST, PlanStatus.NOT_CLOSED):
        q = trials.at_any_speed(inputs)
        if q is not None and _jump(q) <= _JUMP:
            factor, used = trials.slow_enough(speed_ratios(inputs.arm, inputs.time, q))
            status, problems = PlanStatus.TOO_FAST, (too_fast(inputs.time, used),)
            if factor is not None:
                text = f"{factor:.4g} times slower it can be planned: Path(path.target, {factor:.4g} * path.time)"
                problems = (*problems, text)
        elif inputs.problem.closed is not None and trials.connected(inputs.opened()):
            where = problems[0] if status == PlanStatus.NOT_CLOSED else NO_RETURN
            status, problems = PlanStatus.NOT_CLOSED, (f"{where}, however slow", *trials.limits_in_the_way())
        else:
            where = problems[0] if q is None else _jump_text(inputs.time, q)
            status, problems = PlanStatus.DISCONNECTED, (f"{where}, however slow", *trials.limits_in_the_way())
    prefix = _Trials(inputs.opened(), sizes).prefix(failure.reachable_prefix)
    if prefix == len(inputs.time):
        problems = (*problems, 'an open motion along the path can be planned: leave out end="start"')
    elif prefix > 1:
        problems = (*problems, f"the first {prefix} waypoints can be planned by themselves: path[:{prefix}]")
    return replace(failure, status=status, problems=problems, reachable_prefix=prefix)


def _jump(q: np.ndarray) -> float:
    """Largest step of a joint [rad]."""
    return float(np.abs(np.diff(q, axis=0)).max())


def _jump_text(time: np.ndarray, q: np.ndarray) -> str:
    step = np.abs(np.diff(q, axis=0))
    k, joint = np.unravel_index(np.argmax(step), step.shape)
    return (
        f"joint {joint + 1} would have to jump by {np.degrees(step[k, joint]):.0f}° between waypoints {k} "
        f"({time[k]:.3f} s) and {k + 1} ({time[k + 1]:.3f} s)"
    )


class _Trials(NamedTuple):
    """Plans of changed inputs, without proofs."""

    inputs: PlanInputs
    sizes: tuple[int, ...]

    def at_any_speed(self, inputs: PlanInputs) -> np.ndarray | None:
        """Postures ``(K, joint)`` of the motion with the least jump that is at most too fast; None for none."""
        problem, found = inputs.problem.at_any_speed(), []
        for size in self.sizes:
            motion, searched = _motion(inputs, problem, size)
            if outcome(inputs, motion, searched).status in (PlanStatus.OK, PlanStatus.TOO_FAST):
                found.append(np.asarray(motion.q)[: len(inputs.time)])
        return min(found, key=_jump, default=None)

    def limits_in_the_way(self) -> tuple[str, ...]:
        """The joints whose limits, or the keep-out that, alone cut the path."""
        arm = self.inputs.arm
        joints = [
            joint for joint in range(arm.n_joints) if self.connected(self.inputs.for_arm(_without_limit(arm, joint)))
        ]
        texts = [f"joint {joint + 1}" for joint in joints]
        if len(arm.keep_out.offset):
            free = replace(arm, keep_out=replace(arm.keep_out, offset=arm.keep_out.offset + 1e3 * arm.length))
            texts += ["the elbow's keep-out"] if self.connected(self.inputs.for_arm(free)) else []
        found = (f"without the limits of {' or '.join(texts)} a motion would lead across",) if texts else ()
        return found if arm.surroundings is None else (*found, *self._obstacles_in_the_way())

    def _obstacles_in_the_way(self) -> tuple[str, ...]:
        """The deepest overlap of a motion that leads across regardless of obstacles and of the body itself."""
        arm, inputs = self.inputs.arm, self.inputs
        q = self.at_any_speed(inputs.for_arm(replace(arm, surroundings=None)))
        if q is None or _jump(q) > _JUMP:
            return ()
        apart = clearance_at(arm, q)
        k = int(np.argmin(np.asarray(apart.distance)))
        deep = -1e3 * float(apart.distance[k])
        return (
            f"a motion that disregards obstacles would lead across, with {apart.describe(k)} overlapping by "
            f"{deep:.1f} mm at waypoint {k} ({inputs.time[k]:.3f} s)",
        )

    def slow_enough(self, used: np.ndarray) -> tuple[float | None, np.ndarray]:
        """The least factor found by which the path has to be slowed down, and the motion's speeds without that.

        Args:
            used: Speeds of a motion relative to their limits, ``(K - 1, joint)``.
        """
        low, high, best = 1.0, (1 + _ROUNDING) * float(used.max()), None
        middle = high
        for _ in range(_HALVINGS):
            factor = float(f"{middle * (1 + _ROUNDING):.4g}")
            plan = self._plan(self.inputs.slowed(factor))
            if plan.trajectory is not None:
                best, high, used = factor, middle, speed_ratios(self.inputs.arm, self.inputs.time, plan.trajectory.q)
            elif best is None:
                break
            else:
                low = middle
            middle = (low * high) ** 0.5
        return best, used

    def prefix(self, longest: int) -> int:
        """Length of the longest prefix found that plans, at most ``longest``; 0 for none."""
        tried = 0
        while longest > 1:
            failure = self._plan(self.inputs.prefix(longest))
            if failure.ok:
                return longest
            tried += 1
            shorter = min(longest - 1, failure.reachable_prefix)
            longest = shorter if tried < _PREFIXES and shorter > 1 else longest // 2
        return 0

    def _plan(self, inputs: PlanInputs) -> Plan:
        """Plan, or return the failure that leads furthest."""
        plans = []
        for size in self.sizes:
            plan = outcome(inputs, *_motion(inputs, inputs.problem, size))
            if plan.ok:
                return plan
            plans.append(plan)
        return max(plans, key=lambda plan: plan.reachable_prefix)

    def connected(self, inputs: PlanInputs) -> bool:
        """Test whether a motion leads across, at any speed."""
        q = self.at_any_speed(inputs)
        return q is not None and _jump(q) <= _JUMP


def _motion(inputs: PlanInputs, problem: PlanningProblem, size: int) -> tuple[SwivelMotion, np.ndarray]:
    """The motion found from ``size`` waypoints of a path or of its prefix, and these."""
    count = len(inputs.time)
    index = evenly_spaced(count - 1, min(size, count))
    return refine_best(problem, search_at(problem, padded(index, searched_size(size)))), index


def _without_limit(arm: Arm, joint: int) -> Arm:
    """The arm without the limits of a joint."""
    wide = 200 * np.pi
    return replace(arm, lower=arm.lower.at[joint].set(-wide), upper=arm.upper.at[joint].set(wide))
