"""roboticstoolbox: Levenberg-Marquardt in C++ with random restarts."""

from typing import Any

import numpy as np
from roboticstoolbox import ET, ETS

from benchmarks.peers.peer import TOLERANCE, Peer, padded
from benchmarks.shared_arm import SharedArm


class IkLm(Peer):
    """``ik_LM`` of its elementary transforms."""

    name, package = "roboticstoolbox ik_LM", "roboticstoolbox-python"
    returns = "one solution within limits"
    chunk = 500
    batched = False

    def __init__(self, shared: SharedArm) -> None:
        super().__init__(shared)
        steps = np.diff(np.vstack([np.zeros(3), shared.points, shared.tool[:3, 3]]), axis=0)
        parts = []
        for step, axis, low, high in zip(steps, shared.axes, shared.lower, shared.upper, strict=False):
            which = int(np.argmax(np.abs(axis)))
            turn = (ET.Rx, ET.Ry, ET.Rz)[which](flip=bool(axis[which] < 0), qlim=[low, high])
            parts += [*_shift(step), turn]
        self.ets = ETS([*parts, *_shift(steps[-1])])

    def solve(self, poses: np.ndarray, seeds: np.ndarray) -> Any:
        # Its measure is half the square of the error.
        return [self.ets.ik_LM(pose, q0=seed, tol=0.5 * TOLERANCE**2) for pose, seed in zip(poses, seeds, strict=True)]

    def answers(self, result: Any) -> tuple[np.ndarray, np.ndarray]:
        return padded([np.atleast_2d(x.q) if x.success else np.empty((0, 7)) for x in result], 7)


def _shift(step: np.ndarray) -> list[ET]:
    return [make(float(x)) for make, x in zip((ET.tx, ET.ty, ET.tz), step, strict=True) if x]


IK = (IkLm,)
