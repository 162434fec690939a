"""Redundancy parameter and branch of postures of an arm with an outer joint."""

import jax.numpy as jnp
from jax import Array

from jaxik.arm import OuterJointArm
from jaxik.ik import arm_constants, branch_number
from jaxik.kinematics import carry_axes
from jaxik.numerics import principal, sincos, tolerances, vec3, wrap


def parameter_and_branch(arm: OuterJointArm, q: Array) -> tuple[Array, Array]:
    """Return the outer joint's angle in (-pi, pi] and the branch of joint angles ``(7, n)``, ``(n,)`` each."""
    g = arm_constants(arm)
    points, _, axes = carry_axes(arm, *sincos(principal(q)), arm.tool_rotation[:, :0])
    on = arm.station_of_joint
    line = points[:, on[4]] - points[:, on[2]]
    # The root: the side of the plane of line and axis 6 on which axis 5 points; from tip to base, of axes 2 and 3.
    far, near = (2, 1) if arm.mirrored else (5, 4)
    side = vec3.dot(line, vec3.cross(axes[:, far], axes[:, near]))
    root = side < -tolerances(q.dtype).singular * arm.length
    left = jnp.sin(q[3] - g.straight) < 0.0
    if arm.mirrored:
        shoulder, wrist = root, jnp.sin(q[5] + g.wrist_delta) < 0.0
    else:
        shoulder, wrist = jnp.sin(q[1] + g.shoulder_delta) < 0.0, root
    return wrap(principal(q[arm.outer_joint])), branch_number(shoulder, left, wrist)
