"""pyroki: least squares in JAX, batched by vmap; its published fork ``almond-pyroki``.

In float32: its linear solver refuses JAX's 64-bit mode.
"""

from typing import Any

import jax
import jax.numpy as jnp
import jaxlie
import jaxls
import numpy as np
import pyroki
import yourdfpy
from loguru import logger

from benchmarks.peers.peer import Peer
from benchmarks.shared_arm import TIP, SharedArm

POSITION, ROTATION = 50.0, 10.0  # weights of its example
# Its default ends at 1e-5 of the cost, far from what is asked of all; this is what float32 can tell apart.
END = jaxls.TerminationConfig(cost_tolerance=1e-7, gradient_tolerance=1e-7, parameter_tolerance=1e-7)
logger.disable("jaxls")


class Pyroki(Peer):
    """Inverse kinematics of its example: pose as cost, limits as constraint."""

    name, package = "pyroki (float32)", "almond-pyroki"
    returns = "one posture; whether it is a solution is left to the caller"
    chunk = 500

    def __init__(self, shared: SharedArm) -> None:
        super().__init__(shared)
        urdf = yourdfpy.URDF.load(shared.urdf_file(), load_meshes=False)
        with jax.enable_x64(False):
            self.robot = pyroki.Robot.from_urdf(urdf)
            self.link = jnp.asarray(self.robot.links.names.index(TIP), jnp.int32)
            self._solve = jax.jit(jax.vmap(self._one))

    def _one(self, pose: jax.Array, seed: jax.Array) -> jax.Array:
        joint = self.robot.joint_var_cls(0)
        target = jaxlie.SE3.from_matrix(pose)
        costs = [
            pyroki.costs.pose_cost(self.robot, joint, target, self.link, POSITION, ROTATION),
            pyroki.costs.limit_constraint(self.robot, joint),
        ]
        found = (
            jaxls.LeastSquaresProblem(costs, [joint])
            .analyze()
            .solve(
                jaxls.VarValues.make([joint.with_value(seed)]),
                verbose=False,
                linear_solver="dense_cholesky",
                trust_region=jaxls.TrustRegionConfig(lambda_initial=1.0),
                termination=END,
            )
        )
        return found[joint]

    def solve(self, poses: np.ndarray, seeds: np.ndarray) -> Any:
        with jax.enable_x64(False):
            return jax.block_until_ready(self._solve(jnp.asarray(poses), jnp.asarray(seeds)))

    def answers(self, result: Any) -> tuple[np.ndarray, np.ndarray]:
        q = np.asarray(result, float)[:, None]
        return q, np.ones(q.shape[:2], bool)


class PyrokiPath(Pyroki):
    """Its trajectory optimization: least motion as cost, poses and limits as constraints."""

    name = "pyroki trajectory (float32)"
    returns = "a local minimum of the motion's cost"

    def follow(self, poses: np.ndarray, time: np.ndarray, start: np.ndarray) -> np.ndarray:
        q = [start]
        for pose in poses[1:]:
            q.append(np.asarray(self.solve(pose[None], q[-1][None]))[0])
        with jax.enable_x64(False):
            arrays = [jnp.asarray(x, jnp.float32) for x in (poses, time, np.array(q))]
            return np.asarray(_optimized(self.robot, self.link, *arrays), float)


@jax.jit
def _optimized(robot: Any, link: jax.Array, poses: jax.Array, time: jax.Array, q: jax.Array) -> jax.Array:
    count = len(poses)
    joints, later, earlier = (robot.joint_var_cls(jnp.arange(*x)) for x in ((count,), (1, count), (count - 1,)))
    many = jax.tree.map(lambda x: x[None], robot)
    step = 1 / jnp.sqrt(jnp.diff(time))

    @jaxls.Cost.factory
    def motion(values, a, b, weight):
        return (values[b] - values[a]) * weight

    @jaxls.Cost.factory(kind="constraint_eq_zero")
    def on_target(values, joint, target):
        pose = jaxlie.SE3(robot.forward_kinematics(values[joint])[..., link, :])
        return (target.inverse() @ pose).log()

    @jaxls.Cost.factory(kind="constraint_eq_zero")
    def at_start(values, joint):
        return values[joint] - q[0]

    costs = [
        motion(earlier, later, step),
        on_target(joints, jaxlie.SE3.from_matrix(poses)),
        at_start(robot.joint_var_cls(0)),
        pyroki.costs.limit_constraint(many, joints),
    ]
    found = jaxls.LeastSquaresProblem(costs, [joints]).analyze()
    return found.solve(jaxls.VarValues.make([joints.with_value(q)]), verbose=False, termination=END)[joints]


IK = (Pyroki,)
PATHS = (PyrokiPath,)
