"""mink: a quadratic program per step, on MuJoCo."""

import mink
import mujoco
import numpy as np

from benchmarks.peers.peer import TOLERANCE, Iterative
from benchmarks.shared_arm import TIP, SharedArm

STEPS = 60


class Mink(Iterative):
    """Steps with its limits until the task is met."""

    name, package = "mink", "mink"
    chunk = 10

    def __init__(self, shared: SharedArm) -> None:
        super().__init__(shared)
        spec = mujoco.MjSpec.from_string(shared.urdf)
        spec.body("link_7").add_site(name=TIP, pos=shared.tool[:3, 3] - shared.points[6])
        self.mujoco = spec.compile()
        self.limit = mink.ConfigurationLimit(self.mujoco)

    def descend(self, pose: np.ndarray, q: np.ndarray) -> np.ndarray | None:
        task = mink.FrameTask(TIP, "site", position_cost=1.0, orientation_cost=1.0)
        task.set_target(mink.SE3.from_matrix(pose))
        configuration = mink.Configuration(self.mujoco, q)
        for _ in range(STEPS):
            if np.linalg.norm(task.compute_error(configuration)) < TOLERANCE:
                return configuration.q.copy()
            velocity = mink.solve_ik(configuration, [task], 1.0, solver="daqp", damping=1e-9, limits=[self.limit])
            configuration.integrate_inplace(velocity, 1.0)
        return None


IK = PATHS = (Mink,)
