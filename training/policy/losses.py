"""What the policy learns from: the energy of its answers, and plans to imitate."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxik.energy import Energy
from jaxik.paths import Path
from jaxik.planning.fast.candidates import Outlook
from jaxik.planning.fast.coarse_costs import Start
from jaxik.planning.fast.coarse_search import EXCESS
from jaxik.planning.fast.path_batch import BranchCharts, elbow_charts, near, steps
from training.policy.policy import ElbowPolicy

FOLLOWABLE = 0.2  # mean excess of the coarse motion beyond which a path teaches nothing [rad]
_SPEED_MARGIN, _SPEED_PRICE = 0.98, 100.0  # as in the planner's polish


class Example(NamedTuple):
    """Some paths to learn from, with all that does not depend on the weights.

    Attributes:
        rows: Their numbers, ``(B,)``.
        paths: Leading axes ``(B, K)``.
        start: Where the arms come from.
        outlook: What the paths ask for.
        cost: Of the coarse motion, ``(B,)``, see :func:`motion_cost`.
    """

    rows: Array
    paths: Path
    start: Start
    outlook: Outlook
    cost: Array


def example(policy: ElbowPolicy, energy: Energy, rows: Array, paths: Path, start: Start) -> Example:
    """What paths with given numbers teach; of the policy only arm and weight of motion count."""
    outlook = policy.outlook(elbow_charts(policy.arm, paths.target), paths.time.T, start)
    cost = motion_cost(policy, energy, outlook.charts, outlook.begin, paths.time.T, start)
    return Example(rows, paths, start, outlook, cost)


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


def energy_loss(policy: ElbowPolicy, energy: Energy, of: Example) -> tuple[Array, Array]:
    """Logarithm of the cost against that of the coarse motion, no labels needed.

    A difference of logarithms is a relative gain: long and short paths count the same.

    Args:
        policy: The policy.
        energy: What is to be small.
        of: The paths.

    Returns:
        Sum over the paths that can be followed, and how many those are.

    **Differentiability**: in the networks' weights.
    """
    outlook, times = of.outlook, of.paths.time.T
    after = motion_cost(policy, energy, outlook.charts, policy.answer(outlook), times, of.start)
    count = (outlook.excess < FOLLOWABLE).astype(times.dtype)
    each = jnp.log(after) - jnp.log(of.cost)
    return jnp.sum(jnp.where(count > 0, each, 0.0)), jnp.sum(count)


def imitation_loss(policy: ElbowPolicy, outlook: Outlook, swivel: Array, branch: Array) -> tuple[Array, Array]:
    """How far the policy's elbow is from a planner's, where both are in one branch and near each other.

    A path may have several good motions; being drawn from one to another would teach their mean, which is none.

    Args:
        policy: The policy.
        outlook: Of the paths.
        swivel: The planner's, ``(K, B)`` [rad].
        branch: The planner's, ``(K, B)``; -1 where there is no plan.

    Returns:
        Sum of mean squared differences of the swivel [rad²], and how many paths count.

    **Differentiability**: in the networks' weights.
    """
    same = jnp.all(branch == outlook.branch, axis=0)
    close = jnp.max(jnp.abs(near(swivel - outlook.begin)), axis=0) < 1.0
    count = (same & close).astype(swivel.dtype)
    each = jnp.mean(near(swivel - policy.answer(outlook)) ** 2, axis=0)
    return jnp.sum(jnp.where(count > 0, each, 0.0)), jnp.sum(count)
