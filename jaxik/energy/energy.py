"""A weighted sum of energy terms."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
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
        self, arm: Arm, q: Float[ArrayLike, "waypoint joint"], time: Float[ArrayLike, "waypoint"]
    ) -> Float[Array, ""]:
        """Energy of a motion.

        Args:
            arm: The arm.
            q: Joint angles without jumps of a full turn, ``(waypoint, joint)`` [rad].
            time: Increasing times, ``(waypoint,)`` [s].

        Returns:
            The weighted sum, a scalar.

        **Differentiability**: smooth in q, time, the weights and the arm; see the terms for exceptions.
        """
        q, time = jnp.asarray(q), jnp.asarray(time)
        return self._sum([term.total(arm, q, time) for term in self.terms], q)

    def parts(self, arm: Arm, q: Array, time: Array) -> dict[str, Array]:
        """Each term's unweighted value by name and unit."""
        return {f"{term.name} [{term.unit}]": term.total(arm, q, time) for term in self.terms}

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

    def rest_bends(self, arm: Arm) -> tuple[Array, Array] | None:
        """Bounds of the derivatives of ``rest_rate``, see :meth:`Term.rest_bends`; None where a term has none."""
        each = [term.rest_bends(arm) for term in self.terms]
        known = [bends for bends in each if bends is not None]
        if len(known) < len(each):
            return None
        joints = (arm.n_joints,)
        return (
            self._sum([second for second, _ in known], jnp.zeros(2 * joints)),
            self._sum([third for _, third in known], jnp.zeros(3 * joints)),
        )

    @property
    def at_rest(self) -> bool:
        """Whether being at a posture costs something, apart from moving."""
        return not all(isinstance(term, JointMotion) for term in self.terms)

    def provable(self, arm: Arm) -> bool:
        """For use outside ``jit``: whether a plan can be proved, see :func:`jaxik.plan`.

        Only where it is separable, the bends of its ``rest_rate`` are known, and no term is a gain.
        """
        gains = any(np.any(np.asarray(w) < 0) for w in self.weights)
        return self.separable and not gains and self.rest_bends(arm) is not None

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
