"""The check of a motion against targets, limits, keep-out, obstacles and speeds, by forward kinematics alone."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxik.arm import Arm
from jaxik.ik import IKSolution, Status, solve_ik
from jaxik.kinematics import forward_kinematics, joint_positions
from jaxik.obstacles import clearance
from jaxik.paths import Path
from jaxik.planning.clearance_along import clearance_at
from jaxik.planning.padding import padded, padded_size
from jaxik.planning.result import listed
from jaxik.planning.status import PlanStatus
from jaxik.targets import Pose, Target

_ROUNDING = 1e-6  # relative: a motion at its limit to rounding is at its limit, not beyond
_SAMPLES = 180  # swivels sampled for the nearest violation


class Check(NamedTuple):
    """The result of a check.

    Attributes:
        status: OK, CHECK_FAILED or TOO_FAST.
        problems: Reasons, as text.
        keeps: Number of first waypoints up to the first fault.
    """

    status: PlanStatus
    problems: tuple[str, ...]
    keeps: int


def check(arm: Arm, path: Path, q: np.ndarray, time: np.ndarray | None = None) -> Check:
    """Check a motion ``(K, joint)``, independently of how it was found; ``time`` is that of the path in float64."""
    times = np.asarray(path.time, float) if time is None else time
    # Of padded arrays, so that a path of another length is no other program.
    rows = jnp.asarray(padded(q, padded_size(len(q))))
    target = jax.tree.map(np.asarray, path.target)
    reached = forward_kinematics(arm, rows), joint_positions(arm, rows)
    tool, points = jax.tree.map(lambda x: np.asarray(x)[: len(q)], reached)
    loose = float(jnp.finfo(arm.axes.dtype).eps) ** 0.5
    near = np.linalg.norm(tool.position - target.position, axis=-1) <= loose * float(arm.length)
    missed = ~(near & (_turn(tool, target) <= 10 * loose))  # so that nan is off the target too
    low, high = np.asarray(arm.lower) - q, q - np.asarray(arm.upper)
    outside = (np.maximum(low, high) > _ROUNDING).any(axis=-1)
    room = points[:, 1] @ np.asarray(arm.keep_out.normal).T
    outside |= (room > np.asarray(arm.keep_out.offset) + _ROUNDING * float(arm.length)).any(axis=-1)
    for bad, text in ((missed, "off the target"), (outside, "outside limits or keep-out")):
        if bad.any():
            where = np.flatnonzero(bad)
            return Check(PlanStatus.CHECK_FAILED, (f"{text} at waypoint {listed(where, times)}",), int(where[0]))
    if arm.surroundings is not None:
        apart = clearance_at(arm, q)
        where = np.flatnonzero(np.asarray(apart.distance) < -_ROUNDING * float(arm.length))
        if len(where):
            text = f"{apart.describe(int(where[0]))} meet at waypoint {listed(where, times)}"
            return Check(PlanStatus.CHECK_FAILED, (text,), int(where[0]))
    used = speed_ratios(arm, times, q)
    fast = (used > 1 + _ROUNDING).any(axis=-1)
    if fast.any():
        return Check(PlanStatus.TOO_FAST, (too_fast(times, used),), 1 + int(np.argmax(fast)))
    return Check(PlanStatus.OK, (), len(times))


def speed_ratios(arm: Arm, time: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return the joint speeds of a motion ``(K, joint)`` relative to their limits, ``(K - 1, joint)``."""
    return np.abs(np.diff(q, axis=0)) / (np.diff(time)[:, None] * np.asarray(arm.velocity_limit))


def too_fast(time: np.ndarray, used: np.ndarray) -> str:
    """Return the step that needs most time, of :func:`speed_ratios`, as text."""
    k, joint = np.unravel_index(np.argmax(used), used.shape)
    given = time[k + 1] - time[k]
    return (
        f"joint {joint + 1} would need {used[k, joint]:.2f} times its speed limit between waypoints {k} "
        f"({time[k]:.3f} s) and {k + 1} ({time[k + 1]:.3f} s): at least {used[k, joint] * given:.3g} s in the place of "
        f"{given:.3g} s"
    )


def nearest_violation(arm: Arm, target: Target) -> str:
    """Return the nearest violation of one target as text: the least over all swivels and branches."""
    swivel = jnp.linspace(-jnp.pi, jnp.pi, _SAMPLES, endpoint=False, dtype=arm.axes.dtype)
    spread = jax.tree.map(lambda x: jnp.broadcast_to(x, (_SAMPLES, *x.shape)), target)
    solution = solve_ik(arm, spread, swivel)
    off = float(jnp.min(solution.residual.position))
    if off > _ROUNDING * float(arm.length):
        return f"{1e3 * off:.1f} mm out of reach"
    q = np.asarray(solution.q)
    if arm.surroundings is not None and (np.asarray(solution.status) == Status.COLLISION).any():
        return _nearest_collision(arm, solution)
    beyond = np.maximum(np.asarray(arm.lower) - q, q - np.asarray(arm.upper))
    worst = beyond.max(axis=-1)
    row, branch = np.unravel_index(np.argmin(worst), worst.shape)
    if worst[row, branch] <= 0:
        return "the elbow would be in its keep-out"
    joint = int(np.argmax(beyond[row, branch]))
    return f"joint {joint + 1} would be {np.degrees(worst[row, branch]):.1f}° beyond its limit at best"


def _nearest_collision(arm: Arm, solution: IKSolution) -> str:
    """The least overlap of the postures within limits that collide, as text."""
    apart = clearance(arm, solution.q, arm.surroundings.world)
    distance = np.where(np.asarray(solution.status) == Status.COLLISION, np.asarray(apart.distance), -np.inf)
    best = np.unravel_index(np.argmax(distance), distance.shape)
    return f"{apart.describe(*map(int, best))} would overlap by {-1e3 * distance[best]:.1f} mm at best"


def _turn(tool: Pose, target: Target) -> np.ndarray:
    """Error of the tool's orientation, as the length of a difference of unit vectors."""
    if isinstance(target, Pose):
        return np.linalg.norm(tool.rotation - target.rotation, axis=(-2, -1))
    wanted = target.direction / np.linalg.norm(target.direction, axis=-1, keepdims=True)
    return np.linalg.norm(tool.rotation[..., 2] - wanted, axis=-1)
