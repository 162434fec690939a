"""Path deviation (chord error): the tool between waypoints, while the joints move linearly from posture to posture."""

import jax.numpy as jnp
import numpy as np

from jaxik.arm import Arm
from jaxik.kinematics import forward_kinematics

_PIECES = 8  # of a step, at whose ends the distance is taken
_ROWS = 4096  # postures per call: one program for every path


def path_deviation(arm: Arm, q: np.ndarray) -> np.ndarray:
    """Return the largest distance of the tool point from the straight line between two neighboring waypoints.

    Args:
        arm: The arm.
        q: Postures, ``(K, joint)`` [rad].

    Returns:
        ``(K - 1,)`` [m].
    """
    share = np.arange(_PIECES + 1)[:, None, None] / _PIECES
    rows = (q[:-1] + share * np.diff(q, axis=0)).reshape(-1, q.shape[-1])
    padded = np.pad(rows, ((0, -len(rows) % _ROWS), (0, 0)), mode="edge").astype(arm.axes.dtype)
    parts = [forward_kinematics(arm, jnp.asarray(part)).position for part in np.split(padded, len(padded) // _ROWS)]
    tool = np.concatenate([np.asarray(x, float) for x in parts])[: len(rows)].reshape(_PIECES + 1, -1, 3)
    chord = tool[-1] - tool[0]
    least = np.finfo(float).tiny
    along = ((tool - tool[0]) * chord).sum(-1) / np.maximum((chord * chord).sum(-1), least)
    nearest = tool[0] + np.clip(along, 0, 1)[..., None] * chord
    return np.linalg.norm(tool - nearest, axis=-1).max(axis=0, initial=0.0)
