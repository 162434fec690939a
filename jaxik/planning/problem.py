"""What a planner is given, checked and brought to one dtype."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxik.arm import Arm
from jaxik.energy import Energy
from jaxik.kinematics import forward_kinematics
from jaxik.path import Path
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
        time_s: The path's times on the host, ``(K,)``.
        turned: How far the tool turns along the path [rad].
        start: Posture the arm comes from, if given.
        approach_s: Time to get from there to the first waypoint [s].
        pinned: Whether the start posture is at the first target already.
    """

    arm: Arm
    path: Path
    energy: Energy
    time_s: np.ndarray
    turned: float
    start: Array | None
    approach_s: float
    pinned: bool

    def notes(self) -> tuple[str, ...]:
        """What a reader of the trajectory should know."""
        notes = (f"planned for least {self.energy}",)
        return notes if self.path.placement is None else (*notes, f"path {self.path.placement.describe()}")


def make_problem(arm: Arm, path: Path, energy: Energy, start: ArrayLike | None, approach_s: float) -> Problem:
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
    if not approach_s > 0:
        raise ValueError(f"approach_s needs to be above 0; got {approach_s!r}")
    pinned = False
    if start is not None:
        start = jnp.asarray(start, dtype)
        if start.shape != (arm.n_joints,) or not bool(jnp.isfinite(start).all()):
            raise ValueError(f"start needs one finite angle per joint, ({arm.n_joints},); got {np.asarray(start)}")
        pinned = _is_at(arm, path, start)
    return Problem(
        arm=arm,
        path=path,
        energy=energy,
        time_s=np.asarray(path.time_s, float),
        turned=_turned(path),
        start=start,
        approach_s=float(approach_s),
        pinned=pinned,
    )


def _is_at(arm: Arm, path: Path, q: Array) -> bool:
    """Whether a posture is at the first target."""
    tool = forward_kinematics(arm, q)
    if float(jnp.linalg.norm(tool.position - path.target.position[0])) > _AT_POSITION * float(arm.length):
        return False
    if isinstance(path.target, Pose):
        return float(jnp.linalg.norm(tool.rotation - path.target.rotation[0])) < 2**0.5 * _AT_ROTATION
    direction = path.target.direction[0]
    return float(jnp.linalg.norm(tool.rotation[:, 2] - direction / jnp.linalg.norm(direction))) < _AT_ROTATION


def _turned(path: Path) -> float:
    """Sum of the tool's turns along the path [rad]."""
    target = path.target
    axes = np.asarray(target.rotation if isinstance(target, Pose) else target.direction[..., None], float)
    axes = axes / np.linalg.norm(axes, axis=-2, keepdims=True)
    chord = np.linalg.norm(np.diff(axes, axis=0), axis=(-2, -1)) / (2**0.5 if isinstance(target, Pose) else 1.0)
    return float(2 * np.arcsin(np.clip(chord / 2, 0, 1)).sum())
