"""Constants of an arm with an outer joint in the solver's frames, computed once per call.

They are those of its shoulder and elbow (see :mod:`jaxik.ik.arm_constants`), the forearm's frame about axis 5, and the
hand as seen from the tool: all that lies before joint 7 turns about axis 7 as that joint's angle changes.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxik.arm import OuterJointArm
from jaxik.ik.arm_constants import ArmConstants, arm_constants
from jaxik.numerics import vec3


class OuterJointConstants(NamedTuple):
    """Constants of the closed form of a U-R wrist, each with one trailing axis of length 1 for the batch.

    Attributes:
        inner: Constants of shoulder and elbow.
        wrist: Vector from the tool point to the wrist in the tool frame as constant, cosine and sine part in joint 7,
            ``(3, 3, 1)`` [m].
        hand: Axis 6 and two unit vectors across it, the first toward axis 5, as columns in the tool frame, likewise
            in parts, ``(3, 3, 3, 1)``.
        forearm: Axis 5 and two unit vectors across it, the first toward axis 6, as columns in the elbow frame with the
            elbow straight, ``(3, 3, 1)``.
        between: Cosine of the angle between axes 5 and 6, ``(1,)``.
        upper_arm: Vector from the shoulder to the elbow point in the elbow frame, ``(3, 1)`` [m].
    """

    inner: ArmConstants
    wrist: Array
    hand: Array
    forearm: Array
    between: Array
    upper_arm: Array


def outer_joint_constants(arm: OuterJointArm) -> OuterJointConstants:
    """Derive the solver's constants from the arrays of a U-R wrist arm; smooth in all of them."""
    inner = arm_constants(arm)
    a4, a5, a6, a7 = arm.axes[3:]
    between = vec3.dot(a5, a6)
    to_hand, to_forearm = _unit(a6 - between * a5), _unit(a5 - between * a6)
    forearm = jnp.stack([a5, to_hand, vec3.cross(a5, to_hand)], axis=1)
    hand = jnp.stack([a6, to_forearm, vec3.cross(a6, to_forearm)], axis=1)

    upper_arm = arm.elbow - arm.shoulder
    along = _unit(vec3.project_out(upper_arm, a4))
    to_elbow_frame = jnp.stack([along, vec3.cross(a4, along), a4])
    sin, cos = jnp.sin(inner.straight[0]), jnp.cos(inner.straight[0])
    x, y, z = vec3.matmul(to_elbow_frame, forearm)
    forearm = jnp.stack([cos * x - sin * y, sin * x + cos * y, z])

    to_tool = arm.tool_rotation.T
    spoke = arm.wrist - arm.outer
    still, cosine, sine = _parts(a7[:, None], spoke[:, None])
    still = still + (arm.outer - arm.tool_position)[:, None]
    wrist = jnp.stack([vec3.matmul(to_tool, part)[:, 0] for part in (still, cosine, sine)])
    hand = jnp.stack([vec3.matmul(to_tool, part) for part in _parts(a7[:, None], hand)])
    constants = wrist, hand, forearm, between, vec3.matvec(to_elbow_frame, upper_arm)
    return OuterJointConstants(inner, *(c[..., None] for c in constants))


def _parts(axis: Array, v: Array) -> tuple[Array, Array, Array]:
    """Constant, cosine and sine part of vectors ``(3, k)`` turned back about an axis ``(3, 1)``."""
    along = vec3.dot(axis, v) * axis
    return along, v - along, -vec3.cross(jnp.broadcast_to(axis, v.shape), v)


def _unit(v: Array) -> Array:
    return v / jnp.sqrt(vec3.dot(v, v))
