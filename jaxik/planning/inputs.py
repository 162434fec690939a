"""The inputs of a plan, checked on the host and brought to one dtype."""

from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxik.arm import Arm
from jaxik.energy import Energy
from jaxik.kinematics import forward_kinematics
from jaxik.numerics import compiled_sooner
from jaxik.obstacles import moves
from jaxik.paths import Path
from jaxik.planning.ahead import compile_ahead
from jaxik.planning.closure import AT_POSITION, AT_ROTATION, ends_of, is_closed, opening, same_ends
from jaxik.planning.padding import padded, padded_problem, padded_size
from jaxik.planning.problem import PlanningProblem, problem_of
from jaxik.targets import Pose

# A posture is within a limit to this [rad], or to so many eps: what printing and single precision leave of a posture.
_AT_LIMIT, _LIMIT_EPS = 1e-6, 4096


class PlanInputs(NamedTuple):
    """A path to plan with what the host needs of it.

    Attributes:
        arm: The arm.
        path: The path, in the arm's dtype, as host arrays.
        energy: Energy to minimize, as the caller wrote it.
        problem: Path and energy as arrays, padded to one of a few sizes.
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
        problem = _problem(arm, self.path, self.energy, len(self.problem.time), **self.ends)
        return self._replace(arm=arm, problem=problem)

    def prefix(self, count: int) -> "PlanInputs":
        """Return the inputs of the first ``count`` waypoints, in arrays of the same size, whose end is free."""
        problem, rows = self.problem, np.minimum(np.arange(len(self.problem.time)), count - 1)
        arcs, time = jax.tree.map(np.asarray, (problem.arcs, problem.time))
        host = problem._replace(motion=problem.motion.map_rows(np.asarray), arcs=arcs, time=time)
        problem = host.at(rows)._replace(end=problem.end and problem.end._replace(pin=None))
        return self._replace(path=self.path[:count], problem=problem, time=self.time[:count])

    def without(self, rows: np.ndarray) -> "PlanInputs":
        """Return the inputs without some waypoints ``(K,)`` within the path, in arrays of the same size."""
        keep, problem = np.flatnonzero(~rows), self.problem
        arcs, time = jax.tree.map(np.asarray, (problem.arcs, problem.time))
        host = problem._replace(motion=problem.motion.map_rows(np.asarray), arcs=arcs, time=time)
        target = jax.tree.map(lambda x: x[keep], self.path.target)
        path = replace(self.path, target=target, time=self.path.time[keep])
        return self._replace(path=path, problem=host.at(padded(keep, len(time))), time=self.time[keep])

    def slowed(self, factor: float) -> "PlanInputs":
        """Return the inputs with all times multiplied."""
        path = replace(self.path, time=factor * self.path.time)
        problem = self.problem._replace(time=np.asarray(factor * self.problem.time, self.problem.time.dtype))
        return self._replace(path=path, problem=problem, time=factor * self.time)

    def opened(self) -> "PlanInputs":
        """Return the inputs of the same path, whose motion need not return."""
        return self._replace(problem=self.problem._replace(closed=None), ends={**self.ends, "closed": False})

    def notes(self) -> tuple[str, ...]:
        """Notes for the reader of the trajectory."""
        notes = (f"planned for least {self.energy}",)
        notes += ("closed: the last posture is the first",) if self.ends["closed"] else ()
        return notes if self.path.placement is None else (*notes, f"path {self.path.placement.describe()}")


def checked_inputs(
    arm: Arm,
    path: Path,
    energy: Energy,
    start: ArrayLike | None = None,
    end: ArrayLike | str | None = None,
    approach_time: float = 1.0,
) -> PlanInputs:
    """Check the inputs of a plan. The last target of a closed path becomes the first, to the last digit.

    Raises:
        ValueError: With what was got and expected.
    """
    given = path.checked()
    path = jax.tree.map(np.asarray, given.astype(arm.axes.dtype))
    if arm.n_joints == 6 and isinstance(path.target, Pose):
        raise ValueError(
            "this arm has 6 posed joints and takes pointing targets; jaxik.fit_path(arm, path) makes them of poses"
        )
    if not approach_time > 0:
        raise ValueError(f"approach_time needs to be above 0 s; got {approach_time!r}")
    asked = ends_of(start, end)
    start, end = _posture(arm, "start", asked.start), _posture(arm, "end", asked.end)
    pinned = start is not None and _is_at(arm, path, 0, start)
    end_pinned = end is not None and _is_at(arm, path, -1, end)
    closed = asked.closed(pinned, end_pinned)
    if closed:
        _check_closed(arm, path)
        path = replace(path, target=same_ends(path.target))
    if moves(arm) and arm.surroundings.world.batch != (len(path),):
        raise ValueError(
            f"a moving world needs one row per waypoint, ({len(path)},); got {arm.surroundings.world.batch}"
        )
    ends = {
        "start": start,
        "end": end,
        "approach_time": approach_time,
        "pinned": pinned,
        "end_pinned": end_pinned,
        "closed": closed,
    }
    # Waypoints behind the last one cost nothing, for all energies that say so.
    size = padded_size(len(path)) if energy.paddable else len(path)
    if start is None and end is None and not closed and not moves(arm):
        compile_ahead(arm, path, energy, size)
    problem = _problem(arm, path, energy, size, **ends)
    return PlanInputs(arm, path, energy, problem, np.asarray(given.time, float), ends)


def _problem(arm: Arm, path: Path, energy: Energy, size: int, **ends: Any) -> PlanningProblem:
    """The problem in arrays of some size."""
    problem = padded_problem(arm, path, size, energy)
    if ends["start"] is None and ends["end"] is None and not ends["closed"]:
        return problem
    return _problem_of(problem.motion, problem.arcs, None, problem.time, energy, **ends)


_problem_of = compiled_sooner(problem_of, static_argnames=("pinned", "end_pinned", "closed"))


def _check_closed(arm: Arm, path: Path) -> None:
    """Raise an error where the last target is not the first."""
    if len(path) < 3:
        raise ValueError(f"a closed path needs at least 3 waypoints; got {len(path)}")
    if not is_closed(arm, path.target):
        away, angle = (float(x) for x in opening(path.target))
        raise ValueError(
            f'end="start" needs a path whose last target is its first: these are {round(1e3 * away, 3):g} mm and '
            f"{round(np.degrees(angle), 3):g}° apart, at most {1e3 * AT_POSITION * float(arm.length):.2g} mm and "
            f"{np.degrees(AT_ROTATION):.2g}° are taken for the same; add the first target as the last waypoint"
        )


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
    if float(jnp.linalg.norm(tool.position - target.position[row])) > AT_POSITION * float(arm.length):
        return False
    if isinstance(target, Pose):
        return float(jnp.linalg.norm(tool.rotation - target.rotation[row])) < 2**0.5 * AT_ROTATION
    direction = target.direction[row]
    return float(jnp.linalg.norm(tool.rotation[:, 2] - direction / jnp.linalg.norm(direction))) < AT_ROTATION
