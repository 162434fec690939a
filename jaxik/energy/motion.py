"""Energies of the joint angles alone: distance and smoothness of the joint motion."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxik.arm import Arm
from jaxik.energy.energy import Energy
from jaxik.energy.term import DerivativeBounds, Term, durations


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class JointMotion(Term):
    """Σ_k Σ_j w_j (q_{k+1,j} - q_{k,j})² / dt_k: the paper's "least movement".

    Attributes:
        weights: Weight w of each joint's squared motion, ``(joint,)``; None for ones.
    """

    weights: Float[Array, "joint"] | None

    name = "joint motion"
    unit = "rad²/s"
    formula = "Σ w (q[k+1] - q[k])² / dt"
    separable = True
    at_rest = False
    paddable = True

    def total(self, arm: Arm, q: Array, time: Array) -> Array:
        """See :class:`jaxik.energy.Term`."""
        step = jnp.diff(q, axis=0)
        return jnp.sum(self.motion_weights(arm) * step**2 / durations(time)[:, None])

    def motion_weights(self, arm: Arm) -> Array:
        """See :class:`jaxik.energy.Term`."""
        return _or_ones(self.weights, arm)

    def derivative_bounds(self, arm: Arm) -> DerivativeBounds:
        """See :class:`jaxik.energy.Term`; zeros, since staying at a posture costs nothing."""
        joints = arm.n_joints
        return DerivativeBounds(jnp.zeros((joints, joints)), jnp.zeros((joints, joints, joints)))


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Smoothness(Term):
    """Σ_k Σ_j w_j a_{k,j}² dt_k with a = (q_{k+1} - 2 q_k + q_{k-1}) / dt²: penalizes jerky motion.

    Attributes:
        weights: Weight w of each joint's squared acceleration, ``(joint,)``; None for ones.
    """

    weights: Float[Array, "joint"] | None

    name = "smoothness"
    unit = "rad²/s³"
    formula = "Σ w (q[k+1] - 2 q[k] + q[k-1])² / dt³"
    at_rest = False
    paddable = True

    def total(self, arm: Arm, q: Array, time: Array) -> Array:
        """See :class:`jaxik.energy.Term`; steps of unequal length enter by their mean velocities."""
        dt = durations(time)
        change = jnp.diff(jnp.diff(q, axis=0) / dt[:, None], axis=0)
        span = (dt[1:] + dt[:-1]) / 2
        return jnp.sum(_or_ones(self.weights, arm) * change**2 / span[:, None])


def joint_motion(weights: Float[ArrayLike, "joint"] | None = None) -> Energy:
    """Σ w (q[k+1] - q[k])² / dt [rad²/s]: the paper's "least movement".

    Args:
        weights: Weight w of each joint's squared motion, ``(joint,)``, not negative; None for ones.

    Returns:
        The energy; differentiable.

    Raises:
        ValueError: A weight is negative (checked outside ``jit`` only).
    """
    return Energy((JointMotion(_checked(weights)),), (1.0,))


def smoothness(weights: Float[ArrayLike, "joint"] | None = None) -> Energy:
    """Σ w (q[k+1] - 2 q[k] + q[k-1])² / dt³ [rad²/s³]: penalizes jerky motion.

    Args:
        weights: Weight w of each joint's squared acceleration, ``(joint,)``, not negative; None for ones.

    Returns:
        The energy; differentiable.

    Raises:
        ValueError: A weight is negative (checked outside ``jit`` only).
    """
    return Energy((Smoothness(_checked(weights)),), (1.0,))


def _checked(weights: ArrayLike | None) -> Array | None:
    """The weights as an array; negative ones are an error where their values are known."""
    if weights is None:
        return None
    if not isinstance(weights, Tracer) and (np.asarray(weights) < 0).any():
        raise ValueError(f"weights must not be negative, got {np.asarray(weights).tolist()}")
    return jnp.asarray(weights)


def _or_ones(weights: Array | None, arm: Arm) -> Array:
    """Weights in the arm's dtype; ones by default."""
    return jnp.ones_like(arm.lower) if weights is None else jnp.asarray(weights, arm.lower.dtype)
