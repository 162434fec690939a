"""casadi with IPOPT: the whole path as one nonlinear program in joint space."""

import casadi
import numpy as np

from benchmarks.peers.peer import TOLERANCE, Peer
from benchmarks.shared_arm import SharedArm


class NonlinearProgram(Peer):
    """Least joint motion subject to poses, limits and speeds; exact derivatives."""

    name, package = "casadi + IPOPT", "casadi"
    returns = "a local minimum of the motion's energy"

    def __init__(self, shared: SharedArm) -> None:
        super().__init__(shared)
        q, target = casadi.SX.sym("q", 7), casadi.SX.sym("target", 4, 4)
        rotation, position = casadi.SX.eye(3), casadi.SX.zeros(3)
        steps = np.diff(np.vstack([np.zeros(3), shared.points, shared.tool[:3, 3]]), axis=0)
        for i, axis in enumerate(shared.axes):
            position += rotation @ steps[i]
            cross = casadi.skew(axis)
            rotation = rotation @ (
                casadi.SX.eye(3) + casadi.sin(q[i]) * cross + (1 - casadi.cos(q[i])) * (cross @ cross)
            )
        position += rotation @ steps[-1]
        off = rotation.T @ target[:3, :3]
        turn = casadi.vertcat(off[2, 1] - off[1, 2], off[0, 2] - off[2, 0], off[1, 0] - off[0, 1]) / 2
        self.error = casadi.Function("error", [q, target], [casadi.vertcat(position - target[:3, 3], turn)])
        newton = casadi.Function("j", [q, target], [casadi.jacobian(self.error(q, target), q)])
        self.jacobian = newton

    def follow(self, poses: np.ndarray, time: np.ndarray, start: np.ndarray) -> np.ndarray:
        count, dt = len(poses), np.diff(time)
        targets = casadi.DM(np.hstack(list(poses)))
        q = casadi.MX.sym("q", 7, count)
        steps = q[:, 1:] - q[:, :-1]
        energy = casadi.sum2(casadi.sum1(steps**2) / casadi.DM(dt).T)
        on_target = casadi.vec(self.error.map(count)(q, targets))
        moved = casadi.vec(steps)
        far = np.outer(dt, self.shared.speed).ravel()
        solver = casadi.nlpsol(
            "path",
            "ipopt",
            {"x": casadi.vec(q), "f": energy, "g": casadi.vertcat(on_target, moved)},
            {"ipopt": {"print_level": 0, "tol": TOLERANCE, "max_iter": 500}, "print_time": False},
        )
        lower, upper = np.tile(self.shared.lower, count), np.tile(self.shared.upper, count)
        lower[:7] = upper[:7] = start
        zero = np.zeros(6 * count)
        found = solver(
            x0=self._tracked(poses, start).ravel(),
            lbx=lower,
            ubx=upper,
            lbg=np.concatenate([zero, -far]),
            ubg=np.concatenate([zero, far]),
        )
        if not solver.stats()["success"]:
            raise RuntimeError(f"IPOPT: {solver.stats()['return_status']}")
        return np.asarray(found["x"]).reshape(count, 7)

    def _tracked(self, poses: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Return Newton steps of least norm along the path, as the guess."""
        q = [start]
        for pose in poses:
            now = q[-1]
            for _ in range(10):
                off = np.asarray(self.error(now, pose)).ravel()
                if np.abs(off).max() < TOLERANCE:
                    break
                now = now - np.linalg.pinv(np.asarray(self.jacobian(now, pose))) @ off
            q.append(np.clip(now, self.shared.lower, self.shared.upper))
        return np.array(q[1:])


PATHS = (NonlinearProgram,)
