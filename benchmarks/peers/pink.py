"""pink: a quadratic program per step, on pinocchio."""

import numpy as np
import pinocchio
from pink import Configuration, solve_ik
from pink.tasks import FrameTask

from benchmarks.peers.peer import TOLERANCE, Iterative
from benchmarks.shared_arm import TIP, SharedArm

STEPS = 60


class Pink(Iterative):
    """Steps with its limits until the task is met."""

    name, package = "pink", "pin-pink"
    chunk = 10

    def __init__(self, shared: SharedArm) -> None:
        super().__init__(shared)
        self.model = pinocchio.buildModelFromXML(shared.urdf)
        self.data = self.model.createData()

    def descend(self, pose: np.ndarray, q: np.ndarray) -> np.ndarray | None:
        """Return the posture that its steps from q end in, or None."""
        task = FrameTask(TIP, position_cost=1.0, orientation_cost=1.0)
        task.set_target(pinocchio.SE3(pose))
        configuration = Configuration(self.model, self.data, q)
        for _ in range(STEPS):
            if np.linalg.norm(task.compute_error(configuration)) < TOLERANCE:
                return configuration.q.copy()
            # One second per step: its velocity limits then hardly shorten the step.
            velocity = solve_ik(configuration, [task], 1.0, solver="daqp", damping=1e-9, safety_break=False)
            configuration.integrate_inplace(velocity, 1.0)
        return None


IK = PATHS = (Pink,)
