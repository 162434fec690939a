"""What the policy learns from: the energy of what it proposes, and plans to imitate."""

import jax
import jax.numpy as jnp
from jax import Array

from jaxik.energy import Energy
from jaxik.path import Path
from training.elbow_charts import BranchCharts, near, steps
from training.policy import ElbowPolicy
from training.valleys import EXCESS, Start

FOLLOWABLE = 0.2  # mean excess of the coarse motion beyond which a path teaches nothing [rad]
_SPEED_MARGIN, _SPEED_PRICE = 0.98, 100.0  # as in the planner's polish


def motion_cost(
    policy: ElbowPolicy, energy: Energy, charts: BranchCharts, swivel: Array, times: Array, start: Start
) -> Array:
    """Energy of motions and of coming to them, priced up where they leave limits or are too fast: ``(B,)``.

    Args:
        policy: For its arm and weights.
        energy: What is to be small.
        charts: Of the branches taken.
        swivel: ``(K, B)`` [rad].
        times: ``(K, B)`` [s].
        start: Where the arms come from.

    Returns:
        ``(B,)``, positive.

    **Differentiability**: in the swivel.
    """
    arm = policy.arm
    q = charts.joints(swivel)
    turned = jnp.concatenate([q[:, :1], q[:, :1] + jnp.cumsum(steps(q), axis=1)], axis=1)
    total = jax.vmap(energy, in_axes=(None, 2, 1))(arm, jnp.swapaxes(turned, 0, 1), times)
    coming = jnp.sum(policy.weight[:, None] * near(q[:, 0] - start.q) ** 2, axis=0) * start.rate
    speed = jnp.abs(steps(q)) / (jnp.diff(times, axis=0) * arm.velocity_limit[:, None, None])
    fast = jnp.sum(jnp.maximum(speed - _SPEED_MARGIN, 0.0) ** 2, axis=(0, 1))
    excess = jnp.mean(charts.excess(arm, q, swivel), axis=0)
    return (total + coming) * (1.0 + EXCESS * excess + _SPEED_PRICE * fast)


def energy_loss(policy: ElbowPolicy, energy: Energy, paths: Path, start: Start) -> tuple[Array, Array]:
    """Logarithm of the cost against that of the coarse motion, no labels needed.

    A difference of logarithms is a relative gain: long and short paths count the same.

    Args:
        policy: The policy.
        energy: What is to be small.
        paths: With leading axes ``(B, K)``.
        start: Where the arms come from.

    Returns:
        Sum over the paths that can be followed, and how many those are.

    **Differentiability**: in the networks' weights.
    """
    proposal = policy.propose(paths.target, paths.time_s, start)
    times = paths.time_s.T
    before, after = (
        motion_cost(policy, energy, proposal.charts, s, times, start) for s in (proposal.begin, proposal.swivel)
    )
    count = (proposal.excess < FOLLOWABLE).astype(times.dtype)
    each = jnp.log(after) - jnp.log(jax.lax.stop_gradient(before))
    return jnp.sum(jnp.where(count > 0, each, 0.0)), jnp.sum(count)


def imitation_loss(policy: ElbowPolicy, paths: Path, start: Start, swivel: Array, branch: Array) -> tuple[Array, Array]:
    """How far the policy's elbow is from a planner's, where both are in one branch and near each other.

    A path may have several good motions; being drawn from one to another would teach their mean, which is none.

    Args:
        policy: The policy.
        paths: With leading axes ``(B, K)``.
        start: Where the arms come from.
        swivel: The planner's, ``(K, B)`` [rad].
        branch: The planner's, ``(K, B)``.

    Returns:
        Sum of mean squared differences of the swivel [rad²], and how many paths count.

    **Differentiability**: in the networks' weights.
    """
    proposal = policy.propose(paths.target, paths.time_s, start)
    same = jnp.all(branch == proposal.branch, axis=0)
    close = jnp.max(jnp.abs(near(swivel - proposal.begin)), axis=0) < 1.0
    count = (same & close).astype(swivel.dtype)
    each = jnp.mean(near(swivel - proposal.swivel) ** 2, axis=0)
    return jnp.sum(jnp.where(count > 0, each, 0.0)), jnp.sum(count)
