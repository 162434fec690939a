"""Energies of the joint torques: the cost of holding and moving the arm for its motors."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxik.arm import Arm
from jaxik.energy.energy import Energy
from jaxik.energy.term import DerivativeBounds, Term, counted, differences, node_weights
from jaxik.kinematics import gravity_torque, inverse_dynamics, largest_gravity_torque


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Holding(Term):
    """Σ_k |τ_gravity(q_k)|² dt_k: a hobby servo heats while holding, even at rest."""

    name = "holding torque"
    unit = "N²m²s"
    formula = "Σ |τ_gravity(q[k])|² dt"
    separable = True
    needs_masses = True
    paddable = True

    def total(self, arm: Arm, q: Array, time: Array) -> Array:
        """See :class:`jaxik.energy.Term`."""
        return jnp.sum(node_weights(time) * self.rest_rate(arm, q))

    def rest_rate(self, arm: Arm, q: Array) -> Array:
        """See :class:`jaxik.energy.Term`."""
        return jnp.sum(gravity_torque(arm, q) ** 2, axis=-1)

    def derivative_bounds(self, arm: Arm) -> DerivativeBounds:
        """See :class:`jaxik.energy.Term`; the product rule applied to bounds on the torques and their derivatives."""
        largest = largest_gravity_torque(arm)
        joints = np.arange(arm.n_joints)
        pair = np.maximum.outer(joints, joints)
        two, three = largest[pair], largest[np.maximum.outer(pair, joints)]
        four = largest[np.maximum.outer(np.maximum.outer(pair, joints), joints)]
        second = jnp.einsum("ti,tk->ik", two, two) + jnp.einsum("t,tik->ik", largest, three)
        mixed = jnp.einsum("tik,tl->ikl", three, two)
        third = mixed + jnp.swapaxes(mixed, 1, 2) + jnp.moveaxis(mixed, 2, 0) + jnp.einsum("t,tikl->ikl", largest, four)
        return DerivativeBounds(2 * second, 2 * third)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Servo(Term):
    """Σ Σ_j (R_j/k_j² τ² + max(τ q̇, 0)) dt: heat in the windings, and mechanical work without regeneration.

    Torques are evaluated at the waypoints. For the work, each waypoint's torque acts for half a step at the velocity
    of the step before it and for half a step at the velocity of the step after it. The mean of the two velocities would
    be zero in a zigzag, which would then do no work; minimizing such an energy ended 16 % below the simulator's.
    """

    name = "servo energy"
    unit = "J"
    formula = "Σ (R/k_t² τ² + max(τ qd, 0)) dt"
    needs_masses = True
    paddable = True

    def total(self, arm: Arm, q: Array, time: Array) -> Array:
        """See :class:`jaxik.energy.Term`."""
        torque = inverse_dynamics(arm, q, *differences(q, time))
        heat = jnp.sum(node_weights(time) * _heat(arm, torque))
        step = jnp.where(counted(time)[1:, None], jnp.diff(q, axis=0), 0.0)
        return heat + jnp.sum(jnp.maximum(torque[:-1] * step, 0) + jnp.maximum(torque[1:] * step, 0)) / 2

    def rest_rate(self, arm: Arm, q: Array) -> Array:
        """Return the heat of holding [W], see :meth:`Term.rest_rate`.

        With the work of ``rest_torque``, it is the whole energy of a slow motion.
        """
        return _heat(arm, gravity_torque(arm, q))

    def rest_torque(self, arm: Arm, q: Array) -> Array:
        """Return the holding torques [N m], see :meth:`Term.rest_torque`.

        A search that ignored their work found a motion of 117 J where 42 J suffice.
        """
        return gravity_torque(arm, q)


def holding() -> Energy:
    """Σ |τ_gravity(q[k])|² dt [N²m²s]: a hobby servo heats while holding.

    τ_gravity is :func:`jaxik.gravity_torque`, dt is :func:`node_weights`. Without masses the energy is zero for every
    motion; :meth:`Energy.check` rejects such an arm.

    Returns:
        The energy; differentiable.
    """
    return Energy((Holding(),), (1.0,))


def servo() -> Energy:
    """Σ (R/k_t² τ² + max(τ qd, 0)) dt [J], summed over the joints: the energy that the motors draw from the battery.

    R and k_t are the arm's ``motors``. τ at a waypoint is :func:`jaxik.inverse_dynamics` at the velocity and
    acceleration of :func:`differences`. It heats the windings for :func:`node_weights`, and it does work during half of
    the step before and half of the step after the waypoint, each at that step's own velocity. Work done by the load on
    a motor is lost, as in servos without regeneration. Rotor inertia, gears and friction are neglected. The search
    approximates the energy by the heat and work of the holding torques (``rest_rate``, ``rest_torque``). Without masses
    the energy is zero for every motion; :meth:`Energy.check` rejects such an arm.

    Returns:
        The energy; differentiable except where the power of a joint changes sign.
    """
    return Energy((Servo(),), (1.0,))


def _heat(arm: Arm, torque: Array) -> Array:
    """Power lost in the windings, ``(*batch,)`` [W]."""
    per_torque = jnp.asarray(arm.motors.resistance / arm.motors.torque_constant**2, torque.dtype)
    return jnp.sum(per_torque * torque**2, axis=-1)
