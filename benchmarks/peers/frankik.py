"""frankik: closed form in C++ for Franka arms, whose links are offset; measured on its own arm."""

from typing import Any

import numpy as np
from frankik import FrankaKinematics, RobotType, _core

from benchmarks.peers.peer import Peer, padded


class Full(Peer):
    """All branches with the last joint as it is in the seed."""

    name, package = "frankik", "frankik"
    own_arm = "Franka Research 3"
    returns = "up to 4 solutions within limits at a given joint 7"
    chunk = 1000
    batched = False

    def solve(self, poses: np.ndarray, seeds: np.ndarray) -> Any:
        return [_core.ik_full(pose, seed, seed[6], True) for pose, seed in zip(poses, seeds, strict=True)]

    def answers(self, result: Any) -> tuple[np.ndarray, np.ndarray]:
        return padded([q[np.isfinite(q).all(axis=-1)] for q in result], 7)

    def poses(self, kind: str, count: int) -> tuple[np.ndarray, np.ndarray] | None:
        if kind != "random":
            return None
        q = np.random.default_rng(0).uniform(*self.limits(), (count, 7))
        return self.forward(q), q

    def forward(self, q: np.ndarray) -> np.ndarray:
        # Its forward function ends at the tip of the hand, its inverse at the flange.
        hand = np.array(FrankaKinematics(RobotType.FR3).FrankaHandTCPOffset)
        hand[:2, :2] = np.sign(hand[:2, :2]) / 2**0.5  # given with three digits
        return np.array([_core.fk(angles) for angles in q]) @ np.linalg.inv(hand)

    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        return np.asarray(_core.q_min_fr3), np.asarray(_core.q_max_fr3)


IK = (Full,)
