"""The interface of an energy term, with the quadrature and the finite differences that the terms share."""

import abc
from typing import NamedTuple

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

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
        paddable: True if waypoints behind the last one, which repeat its time, add nothing to the total (see
            :func:`durations`). Plans of paths of many lengths then share a few compiled programs.
    """

    name: str
    unit: str
    formula: str
    separable: bool = False
    at_rest: bool = True
    needs_masses: bool = False
    paddable: bool = False

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


def counted(time: Float[ArrayLike, "waypoint"]) -> Bool[Array, "waypoint"]:
    """Return which waypoints belong to a motion: a motion ends at the first waypoint that has the last time.

    Waypoints behind it fill up arrays of a fixed size. They cost nothing, wherever the joints are.

    Args:
        time: Increasing times, of which the last may be repeated, ``(waypoint,)`` [s].

    Returns:
        False for the repetitions at the end, ``(waypoint,)``.
    """
    time = jnp.asarray(time)
    repeated = (time[1:] == time[:-1]) & (time[1:] == time[-1:])
    return jnp.concatenate([jnp.ones(1, bool), ~repeated])


def durations(time: Float[ArrayLike, "waypoint"]) -> Float[Array, "steps"]:
    """Return the duration of each step, infinite behind the last waypoint, so that costs per duration vanish there.

    Args:
        time: Increasing times, of which the last may be repeated (see :func:`counted`), ``(waypoint,)`` [s].

    Returns:
        ``(waypoint - 1,)`` [s].

    **Differentiability**: linear.
    """
    time = jnp.asarray(time)
    return jnp.where(counted(time)[1:], jnp.diff(time), jnp.inf)


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
    q, time = jnp.asarray(q), jnp.asarray(time)
    if len(q) < 2:
        return Differences(jnp.zeros_like(q), jnp.zeros_like(q))
    step, taken = durations(time)[:, None], counted(time)[1:, None]
    speed = jnp.diff(q, axis=0) / step
    inner = 2 * jnp.diff(speed, axis=0) / (step[1:] + step[:-1])
    none, no = jnp.zeros_like(q[:1]), jnp.zeros((1, 1), bool)
    last = jnp.concatenate([no, taken]) & ~jnp.concatenate([taken, no])
    qdd = jnp.concatenate([inner[:1] if len(q) > 2 else none, inner, none])
    qdd = jnp.where(last, jnp.concatenate([none, qdd[:-1]]), qdd)
    # The mean velocity of a step is the velocity at its middle, half a step away from either end.
    half = jnp.where(taken, step, 0.0) / 2
    after = jnp.pad(speed, ((0, 1), (0, 0))) - qdd * jnp.pad(half, ((0, 1), (0, 0)))
    before = jnp.pad(speed, ((1, 0), (0, 0))) + qdd * jnp.pad(half, ((1, 0), (0, 0)))
    return Differences(jnp.where(last, before, after), qdd)
