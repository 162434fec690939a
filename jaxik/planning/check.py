"""The check of a motion against targets, limits, keep-out and speeds, by forward kinematics alone."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxik.arm import Arm
from jaxik.ik import solve_ik
from jaxik.kinematics import forward_kinematics, joint_positions
from jaxik.paths import Path
from jaxik.planning.result import listed
from jaxik.planning.status import PlanStatus
from jaxik.targets import Pose, Target

_ROUNDING = 1e-6  # relative: a motion at its limit to rounding is at its limit, not beyond
_SAMPLES = 180  # swivels sampled for the nearest violation


def check(arm: Arm, path: Path, q: np.ndarray) -> tuple[PlanStatus, tuple[str, ...]]:
    """Return the status of a motion ``(K, joint)`` and the reasons as text, independently of how it was found."""
    times = np.asarray(path.time, float)
    tool = forward_kinematics(arm, jnp.asarray(q))
    loose = float(jnp.finfo(arm.axes.dtype).eps) ** 0.5
    near = np.linalg.norm(tool.position - path.target.position, axis=-1) <= loose * float(arm.length)
    missed = ~(near & (_turn(tool, path.target) <= 10 * loose))  # so that nan is off the target too
    low, high = np.asarray(arm.lower) - q, q - np.asarray(arm.upper)
    outside = (np.maximum(low, high) > _ROUNDING).any(axis=-1)
    elbow = np.asarray(joint_positions(arm, jnp.asarray(q)))[:, 1]
    room = elbow @ np.asarray(arm.keep_out.normal).T
    outside |= (room > np.asarray(arm.keep_out.offset) + _ROUNDING * float(arm.length)).any(axis=-1)
    for bad, text in ((missed, "off the target"), (outside, "outside limits or keep-out")):
        if bad.any():
            return PlanStatus.CHECK_FAILED, (f"{text} at waypoint {listed(np.flatnonzero(bad), times)}",)
    used = np.abs(np.diff(q, axis=0)) / (np.diff(times)[:, None] * np.asarray(arm.velocity_limit))
    if used.max() > 1 + _ROUNDING:
        k, joint = np.unravel_index(np.argmax(used), used.shape)
        text = (
            f"joint {joint + 1} would need {used[k, joint]:.2f} times its speed limit between waypoints {k} "
            f"({times[k]:.3f} s) and {k + 1} ({times[k + 1]:.3f} s)"
        )
        return PlanStatus.TOO_FAST, (text,)
    return PlanStatus.OK, ()


def nearest_violation(arm: Arm, target: Target) -> str:
    """Return the nearest violation of one target as text: the least over all swivels and branches."""
    swivel = jnp.linspace(-jnp.pi, jnp.pi, _SAMPLES, endpoint=False, dtype=arm.axes.dtype)
    spread = jax.tree.map(lambda x: jnp.broadcast_to(x, (_SAMPLES, *x.shape)), target)
    solution = solve_ik(arm, spread, swivel)
    off = float(jnp.min(solution.residual.position))
    if off > _ROUNDING * float(arm.length):
        return f"{1e3 * off:.1f} mm out of reach"
    q = np.asarray(solution.q)
    beyond = np.maximum(np.asarray(arm.lower) - q, q - np.asarray(arm.upper))
    worst = beyond.max(axis=-1)
    row, branch = np.unravel_index(np.argmin(worst), worst.shape)
    if worst[row, branch] <= 0:
        return "the elbow would be in its keep-out"
    joint = int(np.argmax(beyond[row, branch]))
    return f"joint {joint + 1} would be {np.degrees(worst[row, branch]):.1f}° beyond its limit at best"


def _turn(tool: Pose, target: Target) -> np.ndarray:
    """Error of the tool's orientation, as the length of a difference of unit vectors."""
    if isinstance(target, Pose):
        return np.asarray(jnp.linalg.norm(tool.rotation - target.rotation, axis=(-2, -1)))
    wanted = target.direction / jnp.linalg.norm(target.direction, axis=-1, keepdims=True)
    return np.asarray(jnp.linalg.norm(tool.rotation[..., 2] - wanted, axis=-1))
