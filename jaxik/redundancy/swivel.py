"""The inverse map: which swivel and branch a joint vector belongs to."""

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int

from jaxik.arm import Arm
from jaxik.ik import Geometry, bend, geometry, into_plane
from jaxik.numerics import arctan2, sincos, to_batch_first, to_batch_last, tolerances, vec3
from jaxik.targets import as_floats, check_joints


@jax.jit
def swivel_of(arm: Arm, q: Float[ArrayLike, "*batch joint"]) -> tuple[Float[Array, "*batch"], Int[Array, "*batch"]]:
    """Swivel angle and branch of a joint vector: ``solve_ik`` at that swivel returns it in that branch.

    Args:
        arm: The arm.
        q: Joint angles, ``(*batch, n_joints)`` [rad].

    Returns:
        Swivel ``(*batch,)`` [rad] in (-pi, pi] and branch ``(*batch,)``, 0 to 7. Where a bit has no meaning (a triple
        aligned, the elbow straight) it is 0.

    Raises:
        ValueError: If the last axis of ``q`` is not the arm's number of joints.

    **Differentiability**: the swivel in ``q`` and the arm; finite everywhere, and that of a reference carried along
    without spin where the wrist lies on the reference's singular line.

    References:
        The paper's eq. (37) solved for t; K. Kreutz-Delgado et al., "Kinematic analysis of 7-DOF manipulators", 1992.
    """
    (q,) = as_floats(q)
    check_joints(arm, q)
    arm, batch = arm.astype(q.dtype), q.shape[:-1]
    swivel, branch = _swivel_of(geometry(arm), to_batch_last(q, batch, 1))
    return to_batch_first(swivel, batch), to_batch_first(branch, batch)


def _swivel_of(g: Geometry, q: Array) -> tuple[Array, Array]:
    tol = tolerances(q.dtype)
    sin, cos = sincos(q[3] - g.straight)
    left = sin < 0.0
    b = bend(g, jnp.abs(sin), cos, tol)
    side = jnp.where(left, -1.0, 1.0).astype(q.dtype)
    # Columns l̂ and o of the arm plane, from the elbow frame through the shoulder joints into the shoulder frame.
    seen = into_plane(b, side, jnp.eye(3, dtype=q.dtype)[:, :, None])[:2]
    turned = vec3.matmul(vec3.transpose(g.shoulder_from_elbow), vec3.transpose(seen))
    n, e = jnp.moveaxis(_zyz(q[0], q[1] + g.shoulder_delta, q[2], turned), 1, 0)
    zero, _ = g.reference.zero_direction(n, tol)
    swivel = arctan2(g.reference.sense * vec3.dot(e, vec3.cross(n, zero)), vec3.dot(e, zero))
    branch = 4 * _bit(q[1] + g.shoulder_delta) + 2 * left.astype(int) + _bit(q[5] + g.wrist_delta)
    return swivel, branch


def _zyz(first: Array, middle: Array, third: Array, v: Array) -> Array:
    """Rz(first) Ry(middle) Rz(third) v."""
    (s1, c1), (s2, c2), (s3, c3) = sincos(first), sincos(middle), sincos(third)
    x, y, z = v
    x, y = c3 * x - s3 * y, s3 * x + c3 * y
    x, z = c2 * x + s2 * z, c2 * z - s2 * x
    return jnp.stack([c1 * x - s1 * y, s1 * x + c1 * y, z])


def _bit(angle: Array) -> Array:
    """Branch bit of a triple: 1 where the sine of its middle ZYZ angle is negative."""
    return (jnp.sin(angle) < 0.0).astype(int)
