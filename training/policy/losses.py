"""The losses of the policy: the energy of its answers, and the distance from plans to imitate."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxik.energy import Energy
from jaxik.numerics import principal
from jaxik.paths import Path
from jaxik.planning.fast import (
    CANDIDATES,
    EXCESS,
    Candidate,
    PathBatch,
    StartPostures,
    best_candidate,
    path_batch,
    steps,
)
from training.policy.features import path_features
from training.policy.policy import ElbowPolicy

FOLLOWABLE = 0.2  # mean excess of the coarse motion beyond which a path teaches nothing [rad]
_SPEED_MARGIN, _SPEED_PENALTY = 0.98, 100.0  # as in the planner's refinement


class Example(NamedTuple):
    """Some paths to learn from, with all that does not depend on the network's weights.

    Attributes:
        rows: Numbers of the paths, ``(B,)``.
        batch: The paths, rows ``(K, B)``.
        candidate: Their best candidates.
        features: Features of these, ``(features, K, B)``.
        cost: Cost of the coarse motion, ``(B,)``, see :func:`motion_cost`.
    """

    rows: Array
    batch: PathBatch
    candidate: Candidate
    features: Array
    cost: Array


def example(policy: ElbowPolicy, energy: Energy, rows: Array, paths: Path, start: StartPostures) -> Example:
    """Return the example of paths, leading axes ``(B, K)``; of the policy only arm and weights of motion count."""
    batch = path_batch(policy.arm, paths.target, paths.time, policy.weights, start)
    candidate = best_candidate(batch, CANDIDATES)
    cost = motion_cost(energy, batch, candidate, candidate.begin)
    return Example(rows, batch, candidate, path_features(batch, candidate), cost)


def motion_cost(energy: Energy, batch: PathBatch, candidate: Candidate, swivel: Array) -> Array:
    """Return the energy of motions with their approaches, raised where they leave limits or are too fast.

    Args:
        energy: Energy to minimize.
        batch: The paths.
        candidate: Their candidates, whose branches are taken.
        swivel: Swivels, ``(K, B)`` [rad].

    Returns:
        ``(B,)``, positive.

    **Differentiability**: in the swivel.
    """
    arm, motion = batch.arm, candidate.motion
    q = motion.angles(swivel)
    turned = jnp.concatenate([q[:, :1], q[:, :1] + jnp.cumsum(steps(q), axis=1)], axis=1)
    total = jax.vmap(energy, in_axes=(None, 2, 1))(arm, jnp.swapaxes(turned, 0, 1), batch.time)
    approach = jnp.sum(batch.weights[:, None] * batch.approach(q) ** 2, axis=0) * batch.start.rate
    speed = jnp.abs(steps(q)) / (jnp.diff(batch.time, axis=0) * arm.velocity_limit[:, None, None])
    fast = jnp.sum(jnp.maximum(speed - _SPEED_MARGIN, 0.0) ** 2, axis=(0, 1))
    excess = jnp.mean(motion.excess(q, swivel), axis=0)
    return (total + approach) * (1.0 + EXCESS * excess + _SPEED_PENALTY * fast)


def energy_loss(policy: ElbowPolicy, energy: Energy, of: Example) -> tuple[Array, Array]:
    """Return the logarithm of the cost relative to that of the coarse motion; no labels needed.

    A difference of logarithms is a relative gain: long and short paths count the same.

    Args:
        policy: The policy.
        energy: Energy to minimize.
        of: The paths.

    Returns:
        Sum over the paths that can be followed, and their number.

    **Differentiability**: in the network's weights.
    """
    after = motion_cost(energy, of.batch, of.candidate, policy.corrected(of.candidate, of.features))
    count = (of.candidate.excess < FOLLOWABLE).astype(of.cost.dtype)
    each = jnp.log(after) - jnp.log(of.cost)
    return jnp.sum(jnp.where(count > 0, each, 0.0)), jnp.sum(count)


def imitation_loss(
    policy: ElbowPolicy, candidate: Candidate, features: Array, swivel: Array, branch: Array
) -> tuple[Array, Array]:
    """Return the distance of the policy's elbow from a planner's, where both are in one branch and near each other.

    A path may have several good motions; learning from all of them would teach their mean, which is none.

    Args:
        policy: The policy.
        candidate: Best candidates of the paths.
        features: Their features, ``(features, K, B)``.
        swivel: The planner's swivels, ``(K, B)`` [rad].
        branch: The planner's branches, ``(K, B)``; -1 where there is no plan.

    Returns:
        Sum of mean squared differences of the swivel [rad²], and the number of paths that count.

    **Differentiability**: in the network's weights.
    """
    same = jnp.all(branch == candidate.branch, axis=0)
    close = jnp.max(jnp.abs(principal(swivel - candidate.begin)), axis=0) < 1.0
    count = (same & close).astype(swivel.dtype)
    each = jnp.mean(principal(swivel - policy.corrected(candidate, features)) ** 2, axis=0)
    return jnp.sum(jnp.where(count > 0, each, 0.0)), jnp.sum(count)
