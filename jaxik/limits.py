"""Joint ranges and the elbow's keep-out, on columns."""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxik import columns as col
from jaxik.arm import Arm
from jaxik.columns import Mat3
from jaxik.elbow import Circle, arm_plane
from jaxik.geometry import Geometry
from jaxik.numerics import Tolerances


class Fitted(NamedTuple):
    """Consecutive joint angles, each as the turn its range admits, and whether all are inside."""

    angles: tuple[Array, ...]
    inside: Array


def fit_to_limits(arm: Arm, first: int, angles: tuple[Array, ...]) -> Fitted:
    """Moves each angle by a turn where only that lies in its joint's range.

    Being at a limit counts as inside to 4096 eps (1e-12 rad in float64): a joint vector on its limit must survive the trip
    through forward and inverse kinematics.
    """
    slack = 4096 * float(jnp.finfo(arm.lower.dtype).eps)
    fitted, inside = [], jnp.ones((), bool)
    for joint, angle in enumerate(angles, start=first):
        low, high = arm.lower[joint] - slack, arm.upper[joint] + slack
        up, down = angle + 2 * jnp.pi, angle - 2 * jnp.pi
        angle = jnp.where((angle < low) & (up <= high), up, jnp.where((angle > high) & (down >= low), down, angle))
        inside = inside & (angle >= low) & (angle <= high)
        fitted.append(angle)
    return Fitted(tuple(fitted), inside)


def in_keep_out(arm: Arm, g: Geometry, c: Circle, plane: Mat3, side: float, tol: Tolerances) -> Array:
    """Whether the elbow lies in one of the forbidden half-spaces (touching the boundary is allowed)."""
    seen = arm_plane(c.bend, side)
    elbow = col.scale(g.upper, col.combine((seen[0][0], seen[1][0], seen[2][0]), plane))
    forbidden = jnp.zeros((), bool)
    for i in range(arm.keep_out.normal.shape[0]):
        normal = col.transposed_matmul(g.shoulder_frame, (col.split_vector(arm.keep_out.normal[i]),))[0]
        room = arm.keep_out.offset[i] - col.dot(col.split_vector(arm.keep_out.normal[i]), col.split_vector(arm.shoulder))
        forbidden = forbidden | (col.dot(normal, elbow) - room > tol.singular * g.upper)
    return forbidden

