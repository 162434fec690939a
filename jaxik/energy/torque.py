"""Energies of the joint torques: what holding and moving the arm costs its motors."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxik.arm import Arm
from jaxik.energy.term import Term, differences, node_weights
from jaxik.kinematics import gravity_torque, inverse_dynamics, largest_gravity_torque


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Holding(Term):
    """Σ_k |τ_gravity(q_k)|² dt_k: a hobby servo heats by holding, however slowly it moves."""

    name = "holding torque"
    unit = "N²m²s"
    formula = "Σ |τ_gravity(q[k])|² dt"
    separable = True
    weighs_masses = True

    def total(self, arm: Arm, q: Array, time: Array) -> Array:
        """See :class:`jaxik.energy.Term`."""
        return jnp.sum(node_weights(time) * self.rest_rate(arm, q))

    def rest_rate(self, arm: Arm, q: Array) -> Array:
        """See :class:`jaxik.energy.Term`."""
        return jnp.sum(gravity_torque(arm, q) ** 2, axis=-1)

    def rest_bends(self, arm: Arm) -> tuple[Array, Array]:
        """See :class:`jaxik.energy.Term`; by the product rule from bounds of the torques' own derivatives."""
        largest = largest_gravity_torque(arm)
        joints = np.arange(arm.n_joints)
        pair = np.maximum.outer(joints, joints)
        two, three = largest[pair], largest[np.maximum.outer(pair, joints)]
        four = largest[np.maximum.outer(np.maximum.outer(pair, joints), joints)]
        second = jnp.einsum("ti,tk->ik", two, two) + jnp.einsum("t,tik->ik", largest, three)
        mixed = jnp.einsum("tik,tl->ikl", three, two)
        third = mixed + jnp.swapaxes(mixed, 1, 2) + jnp.moveaxis(mixed, 2, 0) + jnp.einsum("t,tikl->ikl", largest, four)
        return 2 * second, 2 * third


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Servo(Term):
    """Σ Σ_j (R_j/k_j² τ² + max(τ q̇, 0)) dt: heat in the windings, and work that no motor takes back.

    Torques are those at the waypoints. Speeds, where they do work, are those of the steps, as the motion is played:
    each waypoint's torque works half a step at the speed before it and half a step at the speed behind it. With their
    mean a zigzag would have no speed and its work no price, and a polish finds that: 16 % under the simulator.
    """

    name = "servo energy"
    unit = "J"
    formula = "Σ (R/k_t² τ² + max(τ qd, 0)) dt"
    weighs_masses = True

    def total(self, arm: Arm, q: Array, time: Array) -> Array:
        """See :class:`jaxik.energy.Term`."""
        torque = inverse_dynamics(arm, q, *differences(q, time))
        heat = jnp.sum(node_weights(time) * _heat(arm, torque))
        way = jnp.diff(q, axis=0)
        return heat + jnp.sum(jnp.maximum(torque[:-1] * way, 0) + jnp.maximum(torque[1:] * way, 0)) / 2

    def rest_rate(self, arm: Arm, q: Array) -> Array:
        """The heat of holding; with the work of ``rest_torque`` it is all of the energy of a slow motion."""
        return _heat(arm, gravity_torque(arm, q))

    def rest_torque(self, arm: Arm, q: Array) -> Array:
        """The torques of holding: a search that leaves their work out ends far off (117 J for 42 J, once)."""
        return gravity_torque(arm, q)


def _heat(arm: Arm, torque: Array) -> Array:
    """Power lost in the windings, ``(*batch,)`` [W]."""
    per_torque = jnp.asarray(arm.motors.resistance / arm.motors.torque_constant**2, torque.dtype)
    return jnp.sum(per_torque * torque**2, axis=-1)
