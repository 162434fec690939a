"""Energies of a joint motion: the objective that a plan minimizes.

An :class:`Energy` is a weighted sum of terms, each documented with its formula and unit. Energies are scaled and added
like numbers::

    energy = jaxik.energy.joint_motion() + 0.1 * jaxik.energy.smoothness()

Terms keep their own units; where these differ, the factors set the exchange rate.
"""

from jaxik.energy.custom import Custom, custom
from jaxik.energy.energy import Energy
from jaxik.energy.motion import JointMotion, Smoothness, joint_motion, smoothness
from jaxik.energy.proximity import Proximity, proximity
from jaxik.energy.term import DerivativeBounds, Differences, Term, counted, differences, durations, node_weights
from jaxik.energy.torque import Holding, Servo, holding, servo

__all__ = [
    "Custom",
    "DerivativeBounds",
    "Differences",
    "Energy",
    "Holding",
    "JointMotion",
    "Proximity",
    "Servo",
    "Smoothness",
    "Term",
    "counted",
    "custom",
    "differences",
    "durations",
    "holding",
    "joint_motion",
    "node_weights",
    "proximity",
    "servo",
    "smoothness",
]
