"""Energies of the joint angles alone: how far and how smoothly the joints move."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxik.arm import Arm
from jaxik.energy.term import Term


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class JointMotion(Term):
    """Σ_k Σ_j (w_j (q_{k+1,j} - q_{k,j}))² / dt_k: the paper's "least movement".

    Attributes:
        weight: What each joint's motion counts, w, ``(joint,)``; None for 1.
    """

    weight: Float[Array, "joint"] | None

    name = "joint motion"
    unit = "rad²/s"
    formula = "Σ |W (q[k+1] - q[k])|² / dt"
    separable = True

    def total(self, arm: Arm, q: Array, time: Array) -> Array:
        """See :class:`jaxik.energy.Term`."""
        step = jnp.diff(q, axis=0)
        return jnp.sum(self.motion_weight(arm) * step**2 / jnp.diff(time)[:, None])

    def motion_weight(self, arm: Arm) -> Array:
        """See :class:`jaxik.energy.Term`."""
        return _weight(self.weight, arm) ** 2

    def rest_bends(self, arm: Arm) -> tuple[Array, Array]:
        """See :class:`jaxik.energy.Term`; being at a posture costs nothing."""
        joints = arm.n_joints
        return jnp.zeros((joints, joints)), jnp.zeros((joints, joints, joints))


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Smoothness(Term):
    """Σ_k Σ_j (w_j a_{k,j})² dt_k with a the second differences over dt²: no jerky elbow.

    Attributes:
        weight: What each joint's acceleration counts, w, ``(joint,)``; None for 1.
    """

    weight: Float[Array, "joint"] | None

    name = "smoothness"
    unit = "rad²/s³"
    formula = "Σ |W (q[k+1] - 2 q[k] + q[k-1])|² / dt³"

    def total(self, arm: Arm, q: Array, time: Array) -> Array:
        """See :class:`jaxik.energy.Term`; steps of unequal length enter by the speeds before and after, half each."""
        dt = jnp.diff(time)
        speed = jnp.diff(q, axis=0) / dt[:, None]
        span = (dt[1:] + dt[:-1]) / 2
        return jnp.sum((_weight(self.weight, arm) * jnp.diff(speed, axis=0)) ** 2 / span[:, None])


def _weight(weight: Array | None, arm: Arm) -> Array:
    """Given weights in the arm's dtype, or ones."""
    return jnp.ones_like(arm.lower) if weight is None else jnp.asarray(weight, arm.lower.dtype)
