"""What a planner is given, checked and brought to one dtype."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxik.arm import Arm
from jaxik.energy import Energy
from jaxik.kinematics import forward_kinematics
from jaxik.paths import Path
from jaxik.targets import Pose

# A start posture counts as being at the first target within these: what a playing robot's encoders would show anyway.
_AT_POSITION = 1e-4  # of the arm's length
_AT_ROTATION = 1e-3  # rad


class Problem(NamedTuple):
    """The planning problem.

    Attributes:
        arm: The arm.
        path: The path, in the arm's dtype.
        energy: What to make small.
        time: The path's times on the host, ``(K,)``.
        turned: How far the tool turns along the path [rad].
        start: Posture the arm comes from, if given.
        end: Posture it goes on to, if given.
        approach_time: Time to get from the start to the first waypoint, and from the last one to the end [s].
        pinned: Whether the start posture is at the first target already.
        end_pinned: Whether the end posture is at the last target already.
    """

    arm: Arm
    path: Path
    energy: Energy
    time: np.ndarray
    turned: float
    start: Array | None
    end: Array | None
    approach_time: float
    pinned: bool
    end_pinned: bool

    def notes(self) -> tuple[str, ...]:
        """What a reader of the trajectory should know."""
        notes = (f"planned for least {self.energy}",)
        return notes if self.path.placement is None else (*notes, f"path {self.path.placement.describe()}")


def make_problem(
    arm: Arm, path: Path, energy: Energy, start: ArrayLike | None, end: ArrayLike | None, approach_time: float
) -> Problem:
    """Checks the inputs of a plan.

    Raises:
        ValueError: With what was expected and got.
    """
    dtype = arm.axes.dtype
    path = path.checked().astype(dtype)
    if arm.n_joints == 6 and isinstance(path.target, Pose):
        raise ValueError(
            "this arm has 6 posed joints and takes pointing targets; jaxik.fit_path(path, arm) makes them of poses"
        )
    if not approach_time > 0:
        raise ValueError(f"approach_time needs to be above 0; got {approach_time!r}")
    start, end = _posture(arm, "start", start), _posture(arm, "end", end)
    return Problem(
        arm=arm,
        path=path,
        energy=energy,
        time=np.asarray(path.time, float),
        turned=_turned(path),
        start=start,
        end=end,
        approach_time=float(approach_time),
        pinned=start is not None and _is_at(arm, path, 0, start),
        end_pinned=end is not None and _is_at(arm, path, -1, end),
    )


def _posture(arm: Arm, name: str, q: ArrayLike | None) -> Array | None:
    if q is None:
        return None
    q = jnp.asarray(q, arm.axes.dtype)
    if q.shape != (arm.n_joints,) or not bool(jnp.isfinite(q).all()):
        raise ValueError(f"{name} needs one finite angle per joint, ({arm.n_joints},); got {np.asarray(q)}")
    return q


def _is_at(arm: Arm, path: Path, row: int, q: Array) -> bool:
    """Whether a posture is at a target of the path."""
    tool, target = forward_kinematics(arm, q), path.target
    if float(jnp.linalg.norm(tool.position - target.position[row])) > _AT_POSITION * float(arm.length):
        return False
    if isinstance(target, Pose):
        return float(jnp.linalg.norm(tool.rotation - target.rotation[row])) < 2**0.5 * _AT_ROTATION
    direction = target.direction[row]
    return float(jnp.linalg.norm(tool.rotation[:, 2] - direction / jnp.linalg.norm(direction))) < _AT_ROTATION


def _turned(path: Path) -> float:
    """Sum of the tool's turns along the path [rad]."""
    target = path.target
    axes = np.asarray(target.rotation if isinstance(target, Pose) else target.direction[..., None], float)
    axes = axes / np.linalg.norm(axes, axis=-2, keepdims=True)
    chord = np.linalg.norm(np.diff(axes, axis=0), axis=(-2, -1)) / (2**0.5 if isinstance(target, Pose) else 1.0)
    return float(2 * np.arcsin(np.clip(chord / 2, 0, 1)).sum())
