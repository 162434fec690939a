"""A weighted sum of energy terms."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxik.arm import Arm
from jaxik.energy.motion import JointMotion
from jaxik.energy.term import Term


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

        **Differentiability**: smooth in q, time_s, the weights and the arm; see the terms for exceptions.
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
        return self._sum([term.rest_rate(arm, q) for term in self.terms], q[..., 0])

    def rest_torque(self, arm: Arm, q: Float[Array, "*batch joint"]) -> Float[Array, "*batch joint"]:
        """Torques at rest whose work a step pays, see :meth:`Term.rest_torque`."""
        return self._sum([term.rest_torque(arm, q) for term in self.terms], q)

    @property
    def separable(self) -> bool:
        """Whether ``motion_weight`` and ``rest_rate`` describe the energy exactly, as they do for every such term."""
        return all(term.separable for term in self.terms)

    @property
    def only_steps(self) -> bool:
        """Whether Σ_j motion_weight_j Δq_j² / dt is all of the energy: being at a posture costs nothing."""
        return all(isinstance(term, JointMotion) for term in self.terms)

    def check(self, arm: Arm) -> None:
        """For use outside ``jit``.

        Raises:
            ValueError: A term is made of torques and the arm has no masses, so that every motion would cost nothing.
        """
        massive = [term.name for term in self.terms if term.weighs_masses]
        if massive and not bool(jnp.any(arm.links.mass > 0)):
            raise ValueError(
                f"{' and '.join(massive)} needs masses, and every link of this arm weighs nothing; give it some "
                f"(links=jaxik.LinkInertia(...)) or plan for jaxik.energy.joint_motion()"
            )

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
