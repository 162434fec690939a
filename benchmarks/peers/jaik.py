"""jaik: closed form in JAX, for arms of Universal Robots only; measured on its own six-joint arm."""

from typing import Any

import jax
import numpy as np
from jaik import make_robot

from benchmarks.peers.peer import Peer
from benchmarks.shared_arm import SharedArm


class Ur10e(Peer):
    """All branches, batched by vmap."""

    name, package = "jaik", "jaik"
    own_arm = "UR10e, six joints"
    returns = "all 8 branches and which are valid"

    def __init__(self, shared: SharedArm) -> None:
        super().__init__(shared)
        forward, full, _ = make_robot("ur10e")
        self._forward, self._full = jax.jit(jax.vmap(forward)), jax.jit(jax.vmap(full))

    def solve(self, poses: np.ndarray, seeds: np.ndarray) -> Any:
        return jax.block_until_ready(self._full(poses[:, :3, :3], poses[:, :3, 3]))

    def answers(self, result: Any) -> tuple[np.ndarray, np.ndarray]:
        q, valid = (np.asarray(x) for x in result)
        q = q if q.shape[1] == 8 else np.moveaxis(q, 1, -1)
        return q, valid.astype(bool) & np.isfinite(q).all(axis=-1)

    def poses(self, kind: str, count: int) -> tuple[np.ndarray, np.ndarray] | None:
        if kind != "random":
            return None
        q = np.random.default_rng(0).uniform(-np.pi, np.pi, (count, 6))
        return self.forward(q), q

    def forward(self, q: np.ndarray) -> np.ndarray:
        poses = np.tile(np.eye(4), (len(q), 1, 1))
        poses[:, :3, :3], poses[:, :3, 3] = self._forward(q)
        return poses

    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        return np.full(6, -2 * np.pi), np.full(6, 2 * np.pi)


IK = (Ur10e,)
