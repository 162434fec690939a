"""A weighted sum of energy terms."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxik.arm import Arm
from jaxik.energy.term import DerivativeBounds, Term


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Energy:
    """A weighted sum of energy terms.

    Attributes:
        terms: The terms.
        weights: Factor of each term.
    """

    terms: tuple[Term, ...]
    weights: tuple[ArrayLike, ...]

    def __call__(
        self, arm: Arm, q: Float[ArrayLike, "waypoint joint"], time: Float[ArrayLike, "waypoint"]
    ) -> Float[Array, ""]:
        """Return the energy of a motion.

        Args:
            arm: The arm.
            q: Joint angles without jumps of a full turn, ``(waypoint, joint)`` [rad].
            time: Increasing times, ``(waypoint,)`` [s].

        Returns:
            The weighted sum, ``()``.

        **Differentiability**: smooth in q, time, the weights and the arm; see the terms for exceptions.
        """
        if isinstance(time, np.ndarray):
            time = time - time[:1]  # before rounding: energies have the steps only, and stamps since 1970 lose them
        q, time = jnp.asarray(q), jnp.asarray(time)
        return self._sum([term.total(arm, q, time) for term in self.terms], q)

    def parts(self, arm: Arm, q: Array, time: Array) -> dict[str, Array]:
        """Return the unweighted energy of each term.

        Args:
            arm: The arm.
            q: Joint angles without jumps of a full turn, ``(waypoint, joint)`` [rad].
            time: Increasing times, ``(waypoint,)`` [s].

        Returns:
            Energies ``()`` by name and unit, for example ``"joint motion [rad²/s]"``.
        """
        return {f"{term.name} [{term.unit}]": term.total(arm, q, time) for term in self.terms}

    def motion_weights(self, arm: Arm) -> Float[Array, "joint"]:
        """Return the weights w of a step's cost Σ w_j Δq_j² / dt, ``(joint,)``, see :meth:`Term.motion_weights`."""
        return self._sum([term.motion_weights(arm) for term in self.terms], arm.lower)

    def rest_rate(self, arm: Arm, q: Float[Array, "*batch joint"]) -> Float[Array, "*batch"]:
        """Return the cost per second of staying at postures, ``(*batch,)``, see :meth:`Term.rest_rate`."""
        return self._sum([term.rest_rate(arm, q) for term in self.terms], q[..., 0])

    def rest_torque(self, arm: Arm, q: Float[Array, "*batch joint"]) -> Float[Array, "*batch joint"]:
        """Return the static torques whose work counts toward a step, see :meth:`Term.rest_torque`."""
        return self._sum([term.rest_torque(arm, q) for term in self.terms], q)

    @property
    def separable(self) -> bool:
        """True if ``motion_weights`` and ``rest_rate`` describe the energy exactly, see :class:`Term`."""
        return all(term.separable for term in self.terms)

    @property
    def at_rest(self) -> bool:
        """True if staying at a posture may have a cost, see :class:`Term`."""
        return any(term.at_rest for term in self.terms)

    @property
    def paddable(self) -> bool:
        """True if waypoints behind the last one cost nothing, see :class:`Term`."""
        return all(term.paddable for term in self.terms)

    @property
    def unit(self) -> str:
        """Unit of the sum if all terms share one, else ``"weighted sum"``."""
        units = list(dict.fromkeys(term.unit for term in self.terms))
        return units[0] if len(units) == 1 else "weighted sum"

    def derivative_bounds(self, arm: Arm) -> DerivativeBounds | None:
        """Return upper bounds on the second and third derivatives of ``rest_rate``, see :meth:`Term.derivative_bounds`.

        Args:
            arm: The arm.

        Returns:
            The bounds, or None if a term has none.
        """
        each = [term.derivative_bounds(arm) for term in self.terms]
        known = [bounds for bounds in each if bounds is not None]
        if len(known) < len(each):
            return None
        joints = (arm.n_joints,)
        return DerivativeBounds(
            self._sum([bounds.second for bounds in known], jnp.zeros(2 * joints)),
            self._sum([bounds.third for bounds in known], jnp.zeros(3 * joints)),
        )

    def provable(self, arm: Arm) -> bool:
        """Return True if :func:`jaxik.plan` can certify plans of this energy (outside ``jit`` only).

        It can if the energy is separable, the derivatives of its ``rest_rate`` have known bounds and no weight is
        negative.

        Args:
            arm: The arm.

        Returns:
            True if plans can be certified.
        """
        negative = any(np.any(np.asarray(w) < 0) for w in self.weights)
        return self.separable and not negative and self.derivative_bounds(arm) is not None

    def check(self, arm: Arm) -> None:
        """Raise an error if the energy is meaningless for an arm (outside ``jit`` only).

        Args:
            arm: The arm.

        Raises:
            ValueError: A term is computed from torques and the arm has no masses, so that every motion would cost
                nothing.
        """
        names = [term.name for term in self.terms if term.needs_masses]
        if names and not bool(jnp.any(arm.links.mass > 0)):
            raise ValueError(
                f"{' and '.join(names)} needs masses, and every link of this arm has mass 0; set them "
                f"(links=jaxik.LinkInertia(...)) or plan with jaxik.energy.joint_motion()"
            )

    def _sum(self, values: list[Array], like: Array) -> Array:
        """Weighted sum in the dtype of ``like``."""
        total = jnp.zeros((), like.dtype)
        for weight, value in zip(self.weights, values, strict=True):
            total = total + jnp.asarray(weight, like.dtype) * value
        return total

    def __add__(self, other: "Energy") -> "Energy":
        """Return the sum of two energies."""
        if not isinstance(other, Energy):
            return NotImplemented
        return Energy(self.terms + other.terms, self.weights + other.weights)

    def __mul__(self, factor: ArrayLike) -> "Energy":
        """Return the energy scaled by a factor."""
        return Energy(self.terms, tuple(factor * w for w in self.weights))

    __rmul__ = __mul__

    def __str__(self) -> str:
        """Return the sum as text, for example ``joint motion + 0.1 smoothness``."""
        return " + ".join(_factor(w) + term.name for w, term in zip(self.weights, self.terms, strict=True))


def _factor(weight: ArrayLike) -> str:
    """Factor of a term as text; nothing for 1, w where the value is not known."""
    if isinstance(weight, Tracer):
        return "w "
    value = float(np.asarray(weight))
    return "" if value == 1.0 else f"{value:g} "
