"""Number of an arm's postures that bring its tool near to a target: a first guess of what the arm does well.

Postures are drawn within the limits, most of them near the middle. Counting costs no inverse kinematics, so that any
number of targets is ranked on the host in a moment, and knows of limits as well as of reach.
"""

import numpy as np

from jaxik.arm import Arm
from jaxik.targets import Pose, Target, matrix_from_rotation_vector

_POSTURES = 4096
_FAR, _TURNED = 0.25, 0.7  # arm lengths and rad at which a posture counts for e⁻¹


def postures_near(arm: Arm, target: Target) -> np.ndarray:
    """Return the number of an arm's postures near to targets ``(*batch,)``, out of a fixed sample of them.

    Args:
        arm: The arm.
        target: Targets, as host arrays in the base frame.

    Returns:
        Weighted numbers, ``(*batch,)``; comparable with one another only.
    """
    point, frame = _sampled(arm)
    length = float(arm.length)
    batch = target.position.shape[:-1]
    position = np.asarray(target.position, np.float32).reshape(-1, 3)
    full = isinstance(target, Pose)
    turn = np.asarray(target.rotation if isinstance(target, Pose) else target.direction, np.float32)
    turn = turn.reshape(len(position), -1)
    axes = frame.reshape(-1, 9) if full else frame[:, :, 2]
    count = np.empty(len(position))
    for first in range(0, len(position), 64):
        p, r = position[first : first + 64], turn[first : first + 64]
        distance2 = (p**2).sum(1)[:, None] + (point**2).sum(1) - 2 * p @ point.T
        cosine = 0.5 * (r @ axes.T - 1.0) if full else r @ axes.T
        away = distance2 / (_FAR * length) ** 2 + 2.0 * (1.0 - cosine) / _TURNED**2
        count[first : first + 64] = np.exp(-away).sum(axis=1)
    return count.reshape(batch)


def _sampled(arm: Arm) -> tuple[np.ndarray, np.ndarray]:
    """Tool points ``(n, 3)`` and frames ``(n, 3, 3)`` of postures within the limits."""
    lower, upper = (np.clip(np.asarray(x, float), -np.pi, np.pi) for x in (arm.lower, arm.upper))
    draw = np.random.default_rng(0).random((2, _POSTURES, arm.n_joints)).mean(axis=0)
    q = lower + (upper - lower) * draw
    axes, stations = np.asarray(arm.axes, float), [np.asarray(x, float) for x in arm.stations]
    point = np.broadcast_to(stations[-1], (_POSTURES, 3))
    frame = np.broadcast_to(np.asarray(arm.tool_rotation, float), (_POSTURES, 3, 3))
    for joint in reversed(range(arm.n_joints)):
        turn = matrix_from_rotation_vector(q[:, joint, None] * axes[joint])
        through = stations[arm.station_of_joint[joint]]
        point = through + (turn @ (point - through)[..., None])[..., 0]
        frame = turn @ frame
    return point.astype(np.float32), frame.astype(np.float32)
