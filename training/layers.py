"""The solver as a layer: an example inside a small network, and one inside ``lax.scan``.

Both are ordinary functions of arrays: ``jit``, ``vmap`` and ``grad`` reach the weights, the targets and the arm.
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
    """Joint angles that reach a target whatever the weights: the network only chooses the elbow.

    Attributes:
        choose: From what is seen of a target to the cosine and sine of the swivel.
        branch: Which of the eight solutions.
    """

    choose: eqx.nn.MLP
    branch: int = eqx.field(static=True)

    def __init__(self, arm: Arm, key: PRNGKeyArray, *, width: int = 32, branch: int = 0) -> None:
        self.choose = eqx.nn.MLP(12 if arm.n_joints == 7 else 6, 2, width, 2, jax.nn.tanh, key=key)
        self.branch = branch

    def swivel(self, arm: Arm, target: Target) -> Float[Array, ""]:
        """The elbow of one target [rad]."""
        turn = target.rotation.reshape(-1) if isinstance(target, Pose) else target.direction
        seen = jnp.concatenate([(target.position - arm.shoulder) / arm.length, turn])
        cos, sin = self.choose(seen)
        return jnp.arctan2(sin, cos)

    def __call__(self, arm: Arm, target: Target) -> Float[Array, "joint"]:
        """Joint angles for one target; ``jax.vmap`` for many [rad].

        **Differentiability**: weights, target and arm.
        """
        return solve_ik(arm, target, self.swivel(arm, target)).q[self.branch]


def follow(
    arm: Arm, target: Target, swivel: Float[Array, ""], rate: Float[Array, "waypoint"], branch: Int[Array, ""]
) -> tuple[Float[Array, ""], Float[Array, "waypoint joint"]]:
    """A motion along a path whose elbow turns at given rates: the solver inside ``lax.scan``.

    Args:
        arm: The arm.
        target: K targets.
        swivel: Where the elbow begins [rad].
        rate: How far it turns before each waypoint, ``(K,)`` [rad].
        branch: Which of the eight solutions.

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
    """The swivel that hangs the elbow lowest, by gradient descent inside ``lax.scan``: an optimizer through the solver.

    Args:
        arm: The arm.
        target: One target.
        swivel: Where to begin [rad].
        branch: Which of the eight solutions.
        steps: Of the descent.

    Returns:
        The swivel [rad].

    **Differentiability**: through the steps.
    """

    def height(s: Array) -> Array:
        return joint_positions(arm, solve_ik(arm, target, s).q[branch])[1, 2] / arm.length

    def step(s: Array, _: None) -> tuple[Array, None]:
        return s - 2.0 * jax.grad(height)(s), None

    return jax.lax.scan(step, swivel, None, length=steps)[0]
