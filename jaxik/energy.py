"""Energies of a joint motion: what a plan is to make small.

An :class:`Energy` is a weighted sum of terms, each documented with formula and unit. They weigh and add like numbers::

    energy = jaxik.energy.joint_motion() + 0.1 * jaxik.energy.smoothness()

Units are those of the terms; whoever adds terms of different units chooses the exchange rate by the weights.
"""

from dataclasses import dataclass
from typing import ClassVar, Protocol

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxik.arm import Arm


class Term(Protocol):
    """One energy: a function of the whole motion, and what a search may use of it waypoint by waypoint."""

    name: ClassVar[str]
    unit: ClassVar[str]
    formula: ClassVar[str]

    def total(self, arm: Arm, q: Array, time_s: Array) -> Array:
        """Energy of a motion ``(waypoint, joint)`` at times ``(waypoint,)``: a scalar."""
        ...

    def motion_weight(self, arm: Arm) -> Array:
        """W with a step costing Σ w_j Δq_j² / dt, ``(joint,)``; zero for terms that no single step shows."""
        ...

    def rest_rate(self, arm: Arm, q: Array) -> Array:
        """Cost per second of being at postures ``(*batch, joint)``: ``(*batch,)``."""
        ...


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class JointMotion:
    """Σ_k Σ_j (w_j (q_{k+1,j} - q_{k,j}))² / dt_k: the paper's "least movement"."""

    weight: Float[Array, "joint"] | None

    name: ClassVar[str] = "joint motion"
    unit: ClassVar[str] = "rad²/s"
    formula: ClassVar[str] = "Σ |W (q[k+1] - q[k])|² / dt"

    def total(self, arm: Arm, q: Array, time_s: Array) -> Array:
        """See :class:`Term`."""
        step = jnp.diff(q, axis=0)
        return jnp.sum(self.motion_weight(arm) * step**2 / jnp.diff(time_s)[:, None])

    def motion_weight(self, arm: Arm) -> Array:
        """See :class:`Term`."""
        return _weight(self.weight, arm) ** 2

    def rest_rate(self, arm: Arm, q: Array) -> Array:
        """See :class:`Term`."""
        return jnp.zeros_like(q[..., 0])


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Smoothness:
    """Σ_k Σ_j (w_j a_{k,j})² dt_k with a the second differences over dt²: no jerky elbow."""

    weight: Float[Array, "joint"] | None

    name: ClassVar[str] = "smoothness"
    unit: ClassVar[str] = "rad²/s³"
    formula: ClassVar[str] = "Σ |W (q[k+1] - 2 q[k] + q[k-1])|² / dt³"

    def total(self, arm: Arm, q: Array, time_s: Array) -> Array:
        """See :class:`Term`; steps of unequal length enter by the speeds before and after, half a step each."""
        dt = jnp.diff(time_s)
        speed = jnp.diff(q, axis=0) / dt[:, None]
        span = (dt[1:] + dt[:-1]) / 2
        return jnp.sum((_weight(self.weight, arm) * jnp.diff(speed, axis=0)) ** 2 / span[:, None])

    def motion_weight(self, arm: Arm) -> Array:
        """Zero: one step alone has no acceleration."""
        return jnp.zeros_like(arm.lower)

    def rest_rate(self, arm: Arm, q: Array) -> Array:
        """See :class:`Term`."""
        return jnp.zeros_like(q[..., 0])


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Energy:
    """A weighted sum of terms.

    Attributes:
        terms: The terms.
        weights: One factor per term.
    """

    terms: tuple[Term, ...]
    weights: tuple[ArrayLike, ...]

    def __call__(
        self, arm: Arm, q: Float[ArrayLike, "waypoint joint"], time_s: Float[ArrayLike, "waypoint"]
    ) -> Float[Array, ""]:
        """Energy of a motion.

        Args:
            arm: The arm.
            q: Joint angles without jumps of a full turn, ``(waypoint, joint)`` [rad].
            time_s: Increasing times, ``(waypoint,)`` [s].

        Returns:
            The weighted sum, a scalar.

        **Differentiability**: smooth in q, time_s, the weights and the arm.
        """
        q, time_s = jnp.asarray(q), jnp.asarray(time_s)
        return self._sum([term.total(arm, q, time_s) for term in self.terms], q)

    def parts(self, arm: Arm, q: Array, time_s: Array) -> dict[str, Array]:
        """Each term's unweighted value by name and unit."""
        return {f"{term.name} [{term.unit}]": term.total(arm, q, time_s) for term in self.terms}

    def motion_weight(self, arm: Arm) -> Float[Array, "joint"]:
        """Weights of Δq² / dt that a step costs."""
        return self._sum([term.motion_weight(arm) for term in self.terms], arm.lower)

    def rest_rate(self, arm: Arm, q: Float[Array, "*batch joint"]) -> Float[Array, "*batch"]:
        """Cost per second of being at postures."""
        return self._sum([term.rest_rate(arm, q) for term in self.terms], q)

    def _sum(self, values: list[Array], like: Array) -> Array:
        """Weighted sum in the dtype of the motion."""
        total = jnp.zeros((), like.dtype)
        for weight, value in zip(self.weights, values, strict=True):
            total = total + jnp.asarray(weight, like.dtype) * value
        return total

    @property
    def unit(self) -> str:
        """The unit, where all terms share one."""
        units = list(dict.fromkeys(term.unit for term in self.terms))
        return units[0] if len(units) == 1 else "weighted sum"

    def __add__(self, other: "Energy") -> "Energy":
        """Both together."""
        if not isinstance(other, Energy):
            return NotImplemented
        return Energy(self.terms + other.terms, self.weights + other.weights)

    def __mul__(self, factor: ArrayLike) -> "Energy":
        """Weighed by a factor."""
        return Energy(self.terms, tuple(factor * w for w in self.weights))

    __rmul__ = __mul__

    def __str__(self) -> str:
        """As a person would write it."""
        return " + ".join(
            term.name if isinstance(w, float) and w == 1.0 else f"{w:g} {term.name}"  # type: ignore[str-format]
            for w, term in zip(self.weights, self.terms, strict=True)
        )


def joint_motion(weight: Float[ArrayLike, "joint"] | None = None) -> Energy:
    """Σ |W (q[k+1] - q[k])|² / dt [rad²/s]: the paper's "least movement".

    Args:
        weight: Diagonal of W, ``(joint,)``; None for ones.

    Returns:
        The energy; differentiable.
    """
    return Energy((JointMotion(None if weight is None else jnp.asarray(weight)),), (1.0,))


def smoothness(weight: Float[ArrayLike, "joint"] | None = None) -> Energy:
    """Σ |W (q[k+1] - 2 q[k] + q[k-1])|² / dt³ [rad²/s³]: no jerky elbow.

    Args:
        weight: Diagonal of W, ``(joint,)``; None for ones.

    Returns:
        The energy; differentiable.
    """
    return Energy((Smoothness(None if weight is None else jnp.asarray(weight)),), (1.0,))


def _weight(weight: Array | None, arm: Arm) -> Array:
    """Given weights in the arm's dtype, or ones."""
    return jnp.ones_like(arm.lower) if weight is None else jnp.asarray(weight, arm.lower.dtype)
