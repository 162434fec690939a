"""What every energy term offers, and the quadrature and differences that the terms share."""

import abc

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxik.arm import Arm


class Term(abc.ABC):
    """One energy: a function of the whole motion, and what a search may use of it waypoint by waypoint.

    Attributes:
        name: What to call it.
        unit: Unit of the total.
        formula: The total in one line.
        separable: Whether the total is exactly Σ rest_rate(q_k) node_weights_k over the waypoints plus
            Σ_j motion_weight_j Δq_j² / dt over the steps. Where it is, a search that couples neighbouring waypoints
            sees the true energy; elsewhere these two and ``rest_torque`` stand in for it.
        weighs_masses: Whether it is made of torques, which an arm without masses does not need.
    """

    name: str
    unit: str
    formula: str
    separable: bool = False
    weighs_masses: bool = False

    @abc.abstractmethod
    def total(self, arm: Arm, q: Array, time: Array) -> Array:
        """Energy of a motion ``(waypoint, joint)`` at times ``(waypoint,)``: a scalar."""

    def motion_weight(self, arm: Arm) -> Array:
        """W with a step costing Σ w_j Δq_j² / dt, ``(joint,)``; zero where no single step shows the energy."""
        return jnp.zeros_like(arm.lower)

    def rest_rate(self, arm: Arm, q: Array) -> Array:
        """Cost per second of being at postures ``(*batch, joint)``: ``(*batch,)``."""
        return jnp.zeros_like(q[..., 0])

    def rest_bends(self, arm: Arm) -> tuple[Array, Array] | None:
        """What |∂²| and |∂³| of ``rest_rate`` in the joint angles are nowhere above, for proofs.

        ``(joint, joint)`` and ``(joint, joint, joint)``; None where that is not known. Where it is, ``rest_rate`` may
        not be negative.
        """
        return None

    def rest_torque(self, arm: Arm, q: Array) -> Array:
        """Torques at rest whose work a step pays, ``(*batch, joint)``; zero for energies without work.

        A step from a to b costs Σ_j (max(τ_a Δq, 0) + max(τ_b Δq, 0)) / 2, however long it takes.
        """
        return jnp.zeros_like(q)


def node_weights(time: Float[ArrayLike, "waypoint"]) -> Float[Array, "waypoint"]:
    """Each waypoint's share of the time: half of the step before it and half of the step behind it.

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


def differences(
    q: Float[ArrayLike, "waypoint joint"], time: Float[ArrayLike, "waypoint"]
) -> tuple[Float[Array, "waypoint joint"], Float[Array, "waypoint joint"]]:
    """Joint velocities and accelerations at the waypoints of a motion.

    Those of the parabola through a waypoint and its two neighbours, whatever the steps; the first and the last waypoint
    are on the parabola of their neighbour. Exact for motions that are quadratic in time, second order in dt for the
    velocities otherwise. Two waypoints are a steady motion, one is rest.

    Args:
        q: Joint angles without jumps of a full turn, ``(waypoint, joint)`` [rad].
        time: Increasing times, ``(waypoint,)`` [s].

    Returns:
        qd [rad/s] and qdd [rad/s²], each ``(waypoint, joint)``.

    **Differentiability**: linear in q, smooth in time.
    """
    q, step = jnp.asarray(q), jnp.diff(jnp.asarray(time))[:, None]
    if len(q) < 2:
        return jnp.zeros_like(q), jnp.zeros_like(q)
    speed = jnp.diff(q, axis=0) / step
    if len(q) == 2:
        return jnp.concatenate([speed, speed]), jnp.zeros_like(q)
    inner = 2 * jnp.diff(speed, axis=0) / (step[1:] + step[:-1])
    qdd = jnp.concatenate([inner[:1], inner, inner[-1:]])
    # A step's mean speed is that of its middle: half a step away from either end.
    qd = jnp.concatenate([speed - qdd[:-1] * step / 2, speed[-1:] + qdd[-1:] * step[-1:] / 2])
    return qd, qdd
