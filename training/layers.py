"""The solver as a layer: inside a small network, and inside ``lax.scan``.

All are functions of arrays that ``jit``, ``vmap`` and ``grad`` differentiate in the weights, the targets and the arm.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, Int, PRNGKeyArray

from jaxik.arm import Arm
from jaxik.ik import solve_ik
from jaxik.kinematics import joint_positions
from jaxik.targets import Pose, Target

Carry = tuple[Array, Array, Array]


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


def follow(
    arm: Arm, target: Target, swivel: Float[Array, ""], rate: Float[Array, "waypoint"], branch: Int[Array, ""]
) -> tuple[Float[Array, ""], Float[Array, "waypoint joint"]]:
    """Return a motion along a path with given swivel increments, by the solver inside ``lax.scan``.

    Args:
        arm: The arm.
        target: K targets.
        swivel: Initial swivel [rad].
        rate: Increment of the swivel before each waypoint, ``(K,)`` [rad].
        branch: Branch of the solutions, 0 to 7.

    Returns:
        Squared joint motion [rad²] and the joint angles ``(K, joint)``.

    **Differentiability**: everything but the branch.
    """

    def waypoint(carry: Carry, step: tuple[Target, Array]) -> tuple[Carry, Array]:
        swivel, before, moved = carry
        target, turn = step
        swivel = swivel + turn
        q = solve_ik(arm, target, swivel).q[branch]
        return (swivel, q, moved + jnp.sum((q - before) ** 2)), q

    first = jax.tree.map(lambda x: x[0], target)
    begin = solve_ik(arm, first, swivel + rate[0]).q[branch]
    zero = jnp.zeros((), begin.dtype)
    (_, _, moved), q = jax.lax.scan(waypoint, (swivel, begin, zero), (target, rate))
    return moved, q


def lowest_elbow(arm: Arm, target: Target, swivel: Float[Array, ""], branch: int, steps: int = 50) -> Float[Array, ""]:
    """Return the swivel with the lowest elbow, by gradient descent through the solver inside ``lax.scan``.

    Args:
        arm: The arm.
        target: One target.
        swivel: Initial swivel [rad].
        branch: Branch of the solution, 0 to 7.
        steps: Number of gradient steps.

    Returns:
        The swivel [rad].

    **Differentiability**: through the steps.
    """

    def height(s: Array) -> Array:
        return joint_positions(arm, solve_ik(arm, target, s).q[branch])[1, 2] / arm.length

    def step(s: Array, _: None) -> tuple[Array, None]:
        return s - 2.0 * jax.grad(height)(s), None

    return jax.lax.scan(step, swivel, None, length=steps)[0]
