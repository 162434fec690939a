"""An energy of the user's own making."""

from collections.abc import Callable
from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxik.arm import Arm
from jaxik.energy.term import Term, differences, node_weights

Cost = Callable[[Array, Array, Array, Array], ArrayLike]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Custom(Term):
    """Σ_k f(q_k, qd_k, qdd_k, dt_k) of a function given by the user; made by :func:`jaxik.energy.custom`.

    Attributes:
        motion: Weights ``(joint,)`` of the squared joint motion that stands for it while searching, or None.
        f: The function.
        name: What reports call it.
        unit: Its unit.
    """

    motion: Float[Array, "joint"] | None
    f: Cost = field(metadata={"static": True})
    name: str = field(metadata={"static": True})
    unit: str = field(metadata={"static": True})

    formula = "Σ f(q[k], qd[k], qdd[k], dt)"

    def total(self, arm: Arm, q: Array, time: Array) -> Array:
        """See :class:`jaxik.energy.Term`."""
        qd, qdd = differences(q, time)
        return jnp.sum(self._cost(q, qd, qdd, node_weights(time)))

    def motion_weight(self, arm: Arm) -> Array:
        """What the user says a search should know of moving."""
        return jnp.zeros_like(arm.lower) if self.motion is None else jnp.asarray(self.motion, arm.lower.dtype)

    def rest_rate(self, arm: Arm, q: Array) -> Array:
        """The function at rest for one second: a search's stand-in."""
        still = jnp.zeros_like(q)
        return self._cost(q, still, still, jnp.ones_like(q[..., 0]))

    def _cost(self, q: Array, qd: Array, qdd: Array, dt: Array) -> Array:
        """One value per posture of a batch."""
        value = jnp.vectorize(self.f, signature="(j),(j),(j),()->()")(q, qd, qdd, dt)
        return jnp.asarray(value, q.dtype)
