"""Energies of the joint torques: what holding and moving the arm costs its motors."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jaxik.arm import Arm
from jaxik.dynamics import gravity_torque, inverse_dynamics
from jaxik.energy.term import Term, differences, node_weights


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Holding(Term):
    """Σ_k |τ_gravity(q_k)|² dt_k: a hobby servo heats by holding, however slowly it moves."""

    name = "holding torque"
    unit = "N²m²s"
    formula = "Σ |τ_gravity(q[k])|² dt"
    separable = True
    weighs_masses = True

    def total(self, arm: Arm, q: Array, time_s: Array) -> Array:
        """See :class:`jaxik.energy.Term`."""
        return jnp.sum(node_weights(time_s) * self.rest_rate(arm, q))

    def rest_rate(self, arm: Arm, q: Array) -> Array:
        """See :class:`jaxik.energy.Term`."""
        return jnp.sum(gravity_torque(arm, q) ** 2, axis=-1)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Servo(Term):
    """Σ_k Σ_j (R_j/k_j² τ² + max(τ q̇, 0)) dt_k: heat in the windings, and work that no motor takes back."""

    name = "servo energy"
    unit = "J"
    formula = "Σ (R/k_t² τ² + max(τ qd, 0)) dt"
    weighs_masses = True

    def total(self, arm: Arm, q: Array, time_s: Array) -> Array:
        """See :class:`jaxik.energy.Term`."""
        qd, qdd = differences(q, time_s)
        return jnp.sum(node_weights(time_s) * _power(arm, inverse_dynamics(arm, q, qd, qdd), qd))

    def rest_rate(self, arm: Arm, q: Array) -> Array:
        """The heat of holding the postures: in slow motion most of the energy, and a search's stand-in for all of it.

        Neither the torques of acceleration nor the work against gravity are in it; the polish sees both.
        """
        torque = gravity_torque(arm, q)
        return _power(arm, torque, jnp.zeros_like(torque))


def _power(arm: Arm, torque: Array, qd: Array) -> Array:
    """Electrical power of the motors, ``(*batch,)`` [W]."""
    heat = jnp.asarray(arm.motors.resistance / arm.motors.torque_constant**2, torque.dtype)
    return jnp.sum(heat * torque**2 + jnp.maximum(torque * qd, 0), axis=-1)
