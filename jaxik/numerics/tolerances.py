"""Thresholds derived from the machine epsilon of a dtype, each with its reason."""

from typing import NamedTuple

import jax.numpy as jnp


class Tolerances(NamedTuple):
    """Thresholds of the geometry, each a multiple of the dtype's resolution eps.

    Attributes:
        singular: 64 eps. Sine below which a direction carries no information: the inputs' own rounding is a few eps,
            and anything above still has relative accuracy eps / sine, which the derivatives need.
        aligned: 9e-13 in float64, 7.6e-6 in float32. Sine of a middle angle below which every split of the outer angles
            is on target.
        near_singular: eps^(3/8): 1.3e-6 in float64, 2.5e-3 in float32. Sine below which NEAR_SINGULAR is reported:
            joint speeds there exceed the tool's by about a million (float64).
        angle: 1e6 rad in float64, 1e3 in float32. Largest angle whose sine keeps its digits; larger swivels are
            refused.
        rotation: 2e-6 in float64, 3.6e-5 in float32. Largest entry of RᵀR - I and of det R - 1 taken for rounding:
            matrices computed in float32 or printed with six decimals stay valid in float64.
        limit: 4096 eps: 9e-13 rad in float64, 4.9e-4 in float32. Angles that far outside a limit are at it, so that
            joint angles on a limit survive forward and inverse kinematics.
        target: 4e-6 in float64, 1.05e-3 in float32. Largest distance from the target [arm lengths, rad] that a
            feasible branch leaves: two angles put on their limits, and a rotation that is one to its tolerance.
    """

    singular: float
    aligned: float
    near_singular: float
    angle: float
    rotation: float
    limit: float
    target: float


def tolerances(dtype: jnp.dtype) -> Tolerances:
    """Return the thresholds for a dtype."""
    eps = float(jnp.finfo(dtype).eps)
    rotation, limit = max(2e-6, 300 * eps), 4096 * eps
    return Tolerances(
        singular=64 * eps,
        aligned=max(64 * eps, 9e-13),
        near_singular=eps**0.375,
        angle=1e6 if eps < 1e-10 else 1e3,
        rotation=rotation,
        limit=limit,
        target=2 * limit + 2 * rotation,
    )
