"""The interface of an energy term, with the quadrature and the finite differences that the terms share."""

import abc
from typing import NamedTuple

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxik.arm import Arm


class DerivativeBounds(NamedTuple):
    """Upper bounds on the magnitudes of the derivatives of :meth:`Term.rest_rate` over all postures.

    Attributes:
        second: Bounds on the second derivatives, ``(joint, joint)``, in the unit of ``rest_rate`` per rad².
        third: Bounds on the third derivatives, ``(joint, joint, joint)``, in the unit of ``rest_rate`` per rad³.
    """

    second: Array
    third: Array


class Differences(NamedTuple):
    """Joint velocities and accelerations at the waypoints of a motion.

    Attributes:
        velocity: Joint velocities, ``(waypoint, joint)`` [rad/s].
        acceleration: Joint accelerations, ``(waypoint, joint)`` [rad/s²].
    """

    velocity: Float[Array, "waypoint joint"]
    acceleration: Float[Array, "waypoint joint"]


class Term(abc.ABC):
    """Base class of energy terms: the energy of a whole motion, and the costs per waypoint and step for a search.

    Attributes:
        name: Name in reports.
        unit: Unit of the total.
        formula: Formula of the total, in one line.
        separable: True if the total is exactly Σ rest_rate(q_k) node_weights_k over the waypoints plus
            Σ_j motion_weight_j Δq_j² / dt over the steps. A search that couples neighboring waypoints then sees the
            true energy; otherwise these two and ``rest_torque`` approximate it.
        at_rest: False if ``rest_rate`` is known to be zero at every posture.
        needs_masses: True if the term is computed from torques and therefore needs an arm with masses.
    """

    name: str
    unit: str
    formula: str
    separable: bool = False
    at_rest: bool = True
    needs_masses: bool = False

    @abc.abstractmethod
    def total(self, arm: Arm, q: Array, time: Array) -> Array:
        """Return the energy of a motion.

        Args:
            arm: The arm.
            q: Joint angles without jumps of a full turn, ``(waypoint, joint)`` [rad].
            time: Increasing times, ``(waypoint,)`` [s].

        Returns:
            The energy in the term's unit, ``()``.
        """

    def motion_weights(self, arm: Arm) -> Array:
        """Return the weights w of a step's cost Σ w_j Δq_j² / dt; zeros if single steps have no cost.

        Args:
            arm: The arm.

        Returns:
            The weights, ``(joint,)``.
        """
        return jnp.zeros_like(arm.lower)

    def rest_rate(self, arm: Arm, q: Array) -> Array:
        """Return the cost per second of staying at a posture.

        Args:
            arm: The arm.
            q: Joint angles, ``(*batch, joint)`` [rad].

        Returns:
            The cost in the term's unit per second, ``(*batch,)``.
        """
        return jnp.zeros_like(q[..., 0])

    def derivative_bounds(self, arm: Arm) -> DerivativeBounds | None:
        """Return upper bounds on the second and third derivatives of ``rest_rate``, used by the certificate.

        Args:
            arm: The arm.

        Returns:
            The bounds, or None if none are known. A term with bounds must have a non-negative ``rest_rate``.
        """
        return None

    def rest_torque(self, arm: Arm, q: Array) -> Array:
        """Return the static torques whose work counts toward a step; zeros for energies without work.

        A step from a to b costs Σ_j (max(τ_a Δq, 0) + max(τ_b Δq, 0)) / 2, independent of its duration.

        Args:
            arm: The arm.
            q: Joint angles, ``(*batch, joint)`` [rad].

        Returns:
            The torques, ``(*batch, joint)`` [N m].
        """
        return jnp.zeros_like(q)


def node_weights(time: Float[ArrayLike, "waypoint"]) -> Float[Array, "waypoint"]:
    """Return each waypoint's share of the time: half of the step before it and half of the step after it.

    Integrals over a motion are sums over waypoints with these weights (the trapezoidal rule, second order in dt).

    Args:
        time: Increasing times, ``(waypoint,)`` [s].

    Returns:
        Weights that add up to the duration, ``(waypoint,)`` [s].

    **Differentiability**: linear.
    """
    time = jnp.asarray(time)
    half = jnp.diff(time) / 2
    return jnp.pad(half, (0, 1)) + jnp.pad(half, (1, 0))


def differences(q: Float[ArrayLike, "waypoint joint"], time: Float[ArrayLike, "waypoint"]) -> Differences:
    """Return joint velocities and accelerations at the waypoints of a motion.

    They are the derivatives of the parabola through a waypoint and its two neighbors, for steps of any length; the
    first and the last waypoint use the parabola of their neighbor. Exact for motions that are quadratic in time; the
    velocities are second order in dt otherwise. Two waypoints give a constant velocity, a single one gives rest.

    Args:
        q: Joint angles without jumps of a full turn, ``(waypoint, joint)`` [rad].
        time: Increasing times, ``(waypoint,)`` [s].

    Returns:
        The velocities [rad/s] and accelerations [rad/s²], each ``(waypoint, joint)``.

    **Differentiability**: linear in q, smooth in time.
    """
    q, step = jnp.asarray(q), jnp.diff(jnp.asarray(time))[:, None]
    if len(q) < 2:
        return Differences(jnp.zeros_like(q), jnp.zeros_like(q))
    speed = jnp.diff(q, axis=0) / step
    if len(q) == 2:
        return Differences(jnp.concatenate([speed, speed]), jnp.zeros_like(q))
    inner = 2 * jnp.diff(speed, axis=0) / (step[1:] + step[:-1])
    qdd = jnp.concatenate([inner[:1], inner, inner[-1:]])
    # The mean velocity of a step is the velocity at its middle, half a step away from either end.
    qd = jnp.concatenate([speed - qdd[:-1] * step / 2, speed[-1:] + qdd[-1:] * step[-1:] / 2])
    return Differences(qd, qdd)
