"""EAIK: analytical solver in C++ for six joints; here with the third joint locked, as its manual does for seven."""

from typing import Any

import numpy as np
from eaik.IK_HP import HPRobot

from benchmarks.measure import cores
from benchmarks.peers.peer import Peer, padded
from benchmarks.shared_arm import SharedArm

LOCKED = 2  # index of the joint that stays at zero


class Locked(Peer):
    """Its multithreaded batch."""

    name, package = "EAIK, joint 3 locked", "EAIK"
    returns = "up to 8 solutions with joint 3 at zero, limits ignored"
    keeps_limits = False

    def __init__(self, shared: SharedArm) -> None:
        super().__init__(shared)
        offsets = np.diff(np.vstack([np.zeros(3), shared.points, shared.tool[:3, 3]]), axis=0)
        self.robot = HPRobot(shared.axes, offsets, [(LOCKED, 0.0)])
        if not self.robot.hasKnownDecomposition():
            raise RuntimeError("no decomposition for this arm")

    def solve(self, poses: np.ndarray, seeds: np.ndarray) -> Any:
        if len(poses) == 1:
            return [self.robot.IK(poses[0])]
        return self.robot.IK_batched(poses, num_worker_threads=cores())

    def answers(self, result: Any) -> tuple[np.ndarray, np.ndarray]:
        rows = [np.asarray(x.Q).reshape(-1, 7)[~np.asarray(x.is_LS, bool)] for x in result]
        return padded([np.angle(np.exp(1j * q)) for q in rows], 7)


IK = (Locked,)
