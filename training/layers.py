"""The solver as a layer of a network: ``jit``, ``vmap`` and ``grad`` reach the weights, the targets and the arm."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, PRNGKeyArray

from jaxik.arm import Arm
from jaxik.ik import solve_ik
from jaxik.targets import Pose, Target


class PostureNet(eqx.Module):
    """A network whose joint angles reach the target for any weights, since it predicts the swivel only.

    Attributes:
        net: Maps features of a target to the cosine and sine of the swivel.
        branch: Branch of the solution, 0 to 7.
    """

    net: eqx.nn.MLP
    branch: int = eqx.field(static=True)

    def __init__(self, arm: Arm, key: PRNGKeyArray, *, width: int = 32, branch: int = 0) -> None:
        self.net = eqx.nn.MLP(12 if arm.n_joints == 7 else 6, 2, width, 2, jax.nn.tanh, key=key)
        self.branch = branch

    def swivel(self, arm: Arm, target: Target) -> Float[Array, ""]:
        """Return the predicted swivel of one target.

        Args:
            arm: The arm.
            target: One target.

        Returns:
            The swivel, ``()`` [rad].
        """
        turn = target.rotation.reshape(-1) if isinstance(target, Pose) else target.direction
        features = jnp.concatenate([(target.position - arm.shoulder) / arm.length, turn])
        cos, sin = self.net(features)
        return jnp.arctan2(sin, cos)

    def __call__(self, arm: Arm, target: Target) -> Float[Array, "joint"]:
        """Return joint angles ``(joint,)`` [rad] for one target; use ``jax.vmap`` for many.

        **Differentiability**: weights, target and arm.
        """
        return solve_ik(arm, target, self.swivel(arm, target)).q[self.branch]
