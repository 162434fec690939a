"""pinocchio: no solver of its own; the damped Newton loop of its manual, in Python around its C++ functions."""

import numpy as np
import pinocchio

from benchmarks.peers.peer import TOLERANCE, Iterative
from benchmarks.shared_arm import TIP, SharedArm

STEPS, DAMPING = 60, 1e-10


class Loop(Iterative):
    """Damped Newton steps, clipped to the limits, with random restarts."""

    name, package = "pinocchio, loop of its manual", "pin"
    chunk = 60
    restarts = 10

    def __init__(self, shared: SharedArm) -> None:
        super().__init__(shared)
        self.model = pinocchio.buildModelFromXML(shared.urdf)
        self.data, self.frame = self.model.createData(), self.model.getFrameId(TIP)

    def descend(self, pose: np.ndarray, q: np.ndarray) -> np.ndarray | None:
        """Return the posture within limits that Newton steps from q end in, or None."""
        target = pinocchio.SE3(pose)
        for _ in range(STEPS):
            pinocchio.framesForwardKinematics(self.model, self.data, q)
            error = self.data.oMf[self.frame].actInv(target)
            twist = pinocchio.log6(error).vector
            if np.linalg.norm(twist) < TOLERANCE:
                return q
            jacobian = pinocchio.computeFrameJacobian(self.model, self.data, q, self.frame, pinocchio.LOCAL)
            jacobian = -pinocchio.Jlog6(error.inverse()) @ jacobian
            step = -jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + DAMPING * np.eye(6), twist)
            step *= min(1.0, 0.5 / max(np.abs(step).max(), 1e-12))
            q = np.clip(q + step, self.shared.lower, self.shared.upper)
        return None


IK = PATHS = (Loop,)
