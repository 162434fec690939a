"""The inputs of a plan, checked on the host and brought to one dtype."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxik.arm import Arm
from jaxik.energy import Energy
from jaxik.kinematics import forward_kinematics
from jaxik.paths import Path
from jaxik.planning.problem import PlanningProblem, make_problem
from jaxik.targets import Pose

# A start posture counts as being at the first target within these: what a playing robot's encoders would show anyway.
_AT_POSITION = 1e-4  # of the arm's length
_AT_ROTATION = 1e-3  # rad
# A posture is within a limit to this [rad], or to so many eps: what printing and single precision leave of a posture.
_AT_LIMIT, _LIMIT_EPS = 1e-6, 4096


class PlanInputs(NamedTuple):
    """A path to plan with what the host needs of it.

    Attributes:
        arm: The arm.
        path: The path, in the arm's dtype.
        energy: Energy to minimize, as the caller wrote it.
        problem: Path and energy as arrays.
        time: Times of the path on the host, ``(K,)`` [s].
        ends: The options of :func:`jaxik.planning.problem.make_problem` about start and end.
    """

    arm: Arm
    path: Path
    energy: Energy
    problem: PlanningProblem
    time: np.ndarray
    ends: dict[str, Any]

    def for_arm(self, arm: Arm) -> "PlanInputs":
        """Return the inputs for an arm with other limits."""
        return self._replace(arm=arm, problem=_problem(arm, self.path, self.energy, **self.ends))

    def notes(self) -> tuple[str, ...]:
        """Notes for the reader of the trajectory."""
        notes = (f"planned for least {self.energy}",)
        return notes if self.path.placement is None else (*notes, f"path {self.path.placement.describe()}")


def checked_inputs(
    arm: Arm,
    path: Path,
    energy: Energy,
    start: ArrayLike | None = None,
    end: ArrayLike | None = None,
    approach_time: float = 1.0,
) -> PlanInputs:
    """Check the inputs of a plan.

    Raises:
        ValueError: With what was got and expected.
    """
    given = path.checked()
    path = given.astype(arm.axes.dtype)
    if arm.n_joints == 6 and isinstance(path.target, Pose):
        raise ValueError(
            "this arm has 6 posed joints and takes pointing targets; jaxik.fit_path(arm, path) makes them of poses"
        )
    if not approach_time > 0:
        raise ValueError(f"approach_time needs to be above 0 s; got {approach_time!r}")
    start, end = _posture(arm, "start", start), _posture(arm, "end", end)
    ends = {
        "start": start,
        "end": end,
        "approach_time": approach_time,
        "pinned": start is not None and _is_at(arm, path, 0, start),
        "end_pinned": end is not None and _is_at(arm, path, -1, end),
    }
    problem = _problem(arm, path, energy, **ends)
    return PlanInputs(arm, path, energy, problem, np.asarray(given.time, float), ends)


@partial(jax.jit, static_argnames=("pinned", "end_pinned"))
def _problem(
    arm: Arm,
    path: Path,
    energy: Energy,
    start: Array | None,
    end: Array | None,
    approach_time: ArrayLike,
    *,
    pinned: bool,
    end_pinned: bool,
) -> PlanningProblem:
    ends = {"start": start, "end": end, "approach_time": approach_time, "pinned": pinned, "end_pinned": end_pinned}
    return make_problem(arm, path.target, path.time, energy, **ends)


def _posture(arm: Arm, name: str, q: ArrayLike | None) -> Array | None:
    """A posture that is one of the arm's; on a limit where rounding takes it beyond."""
    if q is None:
        return None
    q = jnp.asarray(q, arm.axes.dtype)
    if q.shape != (arm.n_joints,) or not bool(jnp.isfinite(q).all()):
        raise ValueError(f"{name} needs one finite angle per joint, ({arm.n_joints},); got {np.asarray(q)}")
    given, lower, upper = (np.asarray(x, float) for x in (q, arm.lower, arm.upper))
    beyond = np.maximum(lower - given, given - upper)
    rounding = max(_AT_LIMIT, _LIMIT_EPS * float(jnp.finfo(q.dtype).eps))
    if (beyond <= rounding).all() and not _in_degrees(given):
        return jnp.clip(q, arm.lower, arm.upper)
    worst = int(np.argmax(np.where((beyond > rounding).any(), beyond, np.abs(given))))
    turned = np.radians(given)
    hint = "; it looks like degrees: give np.radians of it" if _in_degrees(given) else ""
    if not hint and (np.abs(given) > np.pi).any() and ((lower <= turned) & (turned <= upper)).all():
        hint = "; if these are degrees, give np.radians of it"
    raise ValueError(
        f"{name} has joint {worst + 1} at {given[worst]:.6g} rad, and its range is {lower[worst]:.6g} to "
        f"{upper[worst]:.6g} rad{hint}"
    )


def _in_degrees(q: np.ndarray) -> bool:
    """Test for whole multiples of 5 beyond two turns, which nobody writes in radians: 45, 90, -30."""
    return bool((q % 5 == 0).all() and (np.abs(q) > 4 * np.pi).any())


def _is_at(arm: Arm, path: Path, row: int, q: Array) -> bool:
    """Test whether a posture is at a target of the path."""
    tool, target = forward_kinematics(arm, q), path.target
    if float(jnp.linalg.norm(tool.position - target.position[row])) > _AT_POSITION * float(arm.length):
        return False
    if isinstance(target, Pose):
        return float(jnp.linalg.norm(tool.rotation - target.rotation[row])) < 2**0.5 * _AT_ROTATION
    direction = target.direction[row]
    return float(jnp.linalg.norm(tool.rotation[:, 2] - direction / jnp.linalg.norm(direction))) < _AT_ROTATION
