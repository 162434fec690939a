"""Energies of a joint motion: what a plan is to make small.

An :class:`Energy` is a weighted sum of terms, each documented with formula and unit. They weigh and add like numbers::

    energy = jaxik.energy.joint_motion() + 0.1 * jaxik.energy.smoothness()

Units are those of the terms; whoever adds terms of different units chooses the exchange rate by the weights.
"""

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Float

from jaxik.energy.custom import Cost, Custom
from jaxik.energy.energy import Energy
from jaxik.energy.motion import JointMotion, Smoothness
from jaxik.energy.term import Term, differences, node_weights
from jaxik.energy.torque import Holding, Servo

__all__ = [
    "Custom",
    "Energy",
    "Holding",
    "JointMotion",
    "Servo",
    "Smoothness",
    "Term",
    "custom",
    "differences",
    "holding",
    "joint_motion",
    "node_weights",
    "servo",
    "smoothness",
]


def joint_motion(weight: Float[ArrayLike, "joint"] | None = None) -> Energy:
    """Σ |W (q[k+1] - q[k])|² / dt [rad²/s]: the paper's "least movement".

    Args:
        weight: Diagonal of W, ``(joint,)``; None for ones.

    Returns:
        The energy; differentiable.
    """
    return _alone(JointMotion(None if weight is None else jnp.asarray(weight)))


def smoothness(weight: Float[ArrayLike, "joint"] | None = None) -> Energy:
    """Σ |W (q[k+1] - 2 q[k] + q[k-1])|² / dt³ [rad²/s³]: no jerky elbow.

    Args:
        weight: Diagonal of W, ``(joint,)``; None for ones.

    Returns:
        The energy; differentiable.
    """
    return _alone(Smoothness(None if weight is None else jnp.asarray(weight)))


def holding() -> Energy:
    """Σ |τ_gravity(q[k])|² dt [N²m²s]: a hobby servo heats by holding.

    τ_gravity by :func:`jaxik.gravity_torque`, dt by :func:`node_weights`. An arm without masses holds for nothing;
    :meth:`Energy.check` refuses it.

    Returns:
        The energy; differentiable.
    """
    return _alone(Holding())


def servo() -> Energy:
    """Σ (R/k_t² τ² + max(τ qd, 0)) dt [J], summed over the joints: what the motors draw from the battery.

    R and k_t are the arm's ``motors``. τ at a waypoint is :func:`jaxik.inverse_dynamics` of the velocity and
    acceleration that :func:`differences` finds there; it heats for :func:`node_weights`, and works half of the step
    before and half of the step behind it, each at the step's own speed. Work that the load does on a motor is lost, as
    in servos without regeneration. Rotors, gears and friction are left out. A search takes heat and work of the torques
    of holding (``rest_rate``, ``rest_torque``) for the whole. An arm without masses draws nothing;
    :meth:`Energy.check` refuses it.

    Returns:
        The energy; differentiable, but for a kink where a joint's power changes its sign.
    """
    return _alone(Servo())


def custom(
    f: Cost,
    *,
    name: str = "custom",
    unit: str = "",
    motion_weight: Float[ArrayLike, "joint"] | None = None,
) -> Energy:
    """Σ f(q[k], qd[k], qdd[k], dt) of your own function.

    Args:
        f: Takes a waypoint's angles, velocities and accelerations (each ``(joint,)``, by :func:`differences`) and its
            share dt of the time (``()``, by :func:`node_weights`), and returns a number, in jax.numpy. Compiled plans
            are kept per function object: define it once, not in a loop.
        name: What reports call it.
        unit: Its unit.
        motion_weight: For the search, w of Σ w_j Δq_j² / dt that a step should count, ``(joint,)``; None for none.
            The search adds f at rest for one second, per second; the polish takes f alone.

    Returns:
        The energy; as differentiable as f.

    Example:
        >>> import jax.numpy as jnp
        >>> lazy_elbow = custom(lambda q, qd, qdd, dt: abs(q[3] * qd[3]) * dt, name="elbow flexion", unit="rad²")
        >>> str(0.5 * lazy_elbow)
        '0.5 elbow flexion'
    """
    motion = None if motion_weight is None else jnp.asarray(motion_weight)
    return _alone(Custom(motion, f, name, unit))


def _alone(term: Term) -> Energy:
    return Energy((term,), (1.0,))
