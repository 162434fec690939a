"""An energy defined by a function of the user's."""

from collections.abc import Callable
from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxik.arm import Arm
from jaxik.energy.energy import Energy
from jaxik.energy.term import Term, counted, differences, node_weights

CostFunction = Callable[[Array, Array, Array, Array], ArrayLike]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Custom(Term):
    """Σ_k f(q_k, qd_k, qdd_k, dt_k) of a function given by the user; made by :func:`jaxik.energy.custom`.

    Attributes:
        motion: Weights of the squared joint motion that approximates the energy in the search, ``(joint,)``, or None.
        f: The function.
        name: Name in reports.
        unit: Unit of the total.
    """

    motion: Float[Array, "joint"] | None
    f: CostFunction = field(metadata={"static": True})
    name: str = field(metadata={"static": True})
    unit: str = field(metadata={"static": True})

    formula = "Σ f(q[k], qd[k], qdd[k], dt)"
    paddable = True

    def total(self, arm: Arm, q: Array, time: Array) -> Array:
        """See :class:`jaxik.energy.Term`."""
        rows = q, *differences(q, time), node_weights(time)
        counts = counted(time)
        # Behind the last waypoint the function sees that one again: what it makes of no duration is unknown.
        at = jnp.minimum(jnp.arange(len(counts)), jnp.sum(counts) - 1)
        return jnp.sum(jnp.where(counts, self._cost(*(x[at] for x in rows)), 0.0))

    def motion_weights(self, arm: Arm) -> Array:
        """Return the weights given for the search, or zeros, see :meth:`Term.motion_weights`."""
        return jnp.zeros_like(arm.lower) if self.motion is None else jnp.asarray(self.motion, arm.lower.dtype)

    def rest_rate(self, arm: Arm, q: Array) -> Array:
        """Return the function at rest for one second, see :meth:`Term.rest_rate`."""
        zero = jnp.zeros_like(q)
        return self._cost(q, zero, zero, jnp.ones_like(q[..., 0]))

    def _cost(self, q: Array, qd: Array, qdd: Array, dt: Array) -> Array:
        """One value per posture of a batch."""
        value = jnp.vectorize(self.f, signature="(j),(j),(j),()->()")(q, qd, qdd, dt)
        return jnp.asarray(value, q.dtype)


def custom(
    f: CostFunction,
    *,
    name: str = "custom",
    unit: str = "",
    motion_weights: Float[ArrayLike, "joint"] | None = None,
) -> Energy:
    """Σ f(q[k], qd[k], qdd[k], dt) of a function of your own.

    Args:
        f: Function of a waypoint's joint angles, velocities and accelerations (each ``(joint,)``, see
            :func:`differences`) and its share dt of the time (``()``, see :func:`node_weights`), written in jax.numpy
            and returning a scalar. Plans are compiled once per function object: define it once, not in a loop.
        name: Name in reports.
        unit: Unit of the total.
        motion_weights: Weights w of a cost Σ w_j Δq_j² / dt per step that stands in for the energy of motion in the
            search, ``(joint,)``; None for zeros. The search adds f at rest, per second; the refinement uses f alone.

    Returns:
        The energy; as differentiable as f.

    Example:
        >>> import jax.numpy as jnp
        >>> lazy_elbow = custom(lambda q, qd, qdd, dt: abs(q[3] * qd[3]) * dt, name="elbow flexion", unit="rad²")
        >>> str(0.5 * lazy_elbow)
        '0.5 elbow flexion'
    """
    motion = None if motion_weights is None else jnp.asarray(motion_weights)
    return Energy((Custom(motion, f, name, unit),), (1.0,))
