"""Constants of an arm in the solver's frames, computed once per call.

Two frames do all the work. The shoulder frame C1 has z along axis 1 and y along axis 2; the elbow frame B has x towards
the elbow and z along axis 4. Any three axes a ⊥ b ⊥ c through a point are a ZYZ joint in such a frame, with the third
axis turned by a constant angle delta about y: exp(a q1) exp(b q2) exp(c q3) = C Rz(q1) Ry(q2 + delta) Rz(q3) Ry(-delta)
Cᵀ.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxik.arm import Arm, SwivelReference
from jaxik.numerics import arctan2, vec3


class ArmConstants(NamedTuple):
    """Constants of the closed form, each with one trailing axis of length 1 for the batch.

    Attributes:
        shoulder: Point S, ``(3, 1)`` [m].
        to_shoulder_frame: C1ᵀ, ``(3, 3, 1)``.
        shoulder_delta: Constant angle delta of the shoulder, ``(1,)`` [rad].
        shoulder_from_elbow: Bᵀ C1 Ry(delta), ``(3, 3, 1)``.
        upper: Distance from S to axis 4, ``(1,)`` [m].
        fore: Distance from W to axis 4, ``(1,)`` [m].
        skew: Part of SW along axis 4, the same at every bend of the elbow, ``(1,)`` [m].
        straight: Joint 4 at full stretch, ``(1,)`` [rad].
        wrist_delta: Constant angle delta of the wrist, ``(1,)`` [rad].
        wrist_from_elbow: C5ᵀ B Rz(-straight), ``(3, 3, 1)``.
        tool_to_wrist: R_Tᵀ C5 Ry(delta), ``(3, 3, 1)``.
        tool_offset: Vector from the wrist to the tool point in the tool frame, ``(3, 1)`` [m].
        reference: Swivel reference in the shoulder frame, its vectors ``(3, 1)``.
    """

    shoulder: Array
    to_shoulder_frame: Array
    shoulder_delta: Array
    shoulder_from_elbow: Array
    upper: Array
    fore: Array
    skew: Array
    straight: Array
    wrist_delta: Array
    wrist_from_elbow: Array
    tool_to_wrist: Array
    tool_offset: Array
    reference: SwivelReference


def arm_constants(arm: Arm) -> ArmConstants:
    """Derive the solver's constants from the arm's arrays; smooth in all of them."""
    last = arm.axes[6] if arm.n_joints == 7 else arm.tool_rotation[:, 2]
    # Shoulder and wrist together, on a trailing axis of two.
    joints = jnp.stack([arm.axes[:3], jnp.stack([arm.axes[4], arm.axes[5], last])], axis=-1)
    frames, turned, delta = _zyz_frames(*joints)
    shoulder_frame, wrist_frame = frames[..., 0], frames[..., 1]

    a4 = arm.axes[3]
    upper_arm = vec3.project_out(arm.elbow - arm.shoulder, a4)
    upper = jnp.sqrt(vec3.dot(upper_arm, upper_arm))
    along = upper_arm / upper
    elbow_frame = jnp.stack([along, vec3.cross(a4, along), a4], axis=1)
    forearm = vec3.matvec(elbow_frame.T, arm.wrist - arm.elbow)
    fore = jnp.sqrt(forearm[0] ** 2 + forearm[1] ** 2)
    cos, sin = forearm[0] / fore, -forearm[1] / fore
    from_elbow = vec3.matmul(wrist_frame.T, elbow_frame)
    x, y, z = from_elbow.T
    unbent = jnp.stack([cos * x - sin * y, sin * x + cos * y, z], axis=1)
    reference = type(arm.reference)(
        *(vec3.matvec(shoulder_frame.T, v)[:, None] for v in arm.reference.vectors())  # pyright: ignore
    )
    constants = (
        arm.shoulder,
        shoulder_frame.T,
        delta[0],
        vec3.matmul(elbow_frame.T, turned[..., 0]),
        upper,
        fore,
        vec3.dot(arm.wrist - arm.shoulder, a4),
        arctan2(sin, cos),
        delta[1],
        unbent,
        vec3.matmul(arm.tool_rotation.T, turned[..., 1]),
        vec3.matvec(arm.tool_rotation.T, arm.tool_position - arm.wrist),
    )
    return ArmConstants(*(c[..., None] for c in constants), reference=reference)


def _zyz_frames(a: Array, b: Array, c: Array) -> tuple[Array, Array, Array]:
    """Return frames of three axes ``(3, ...)`` each, the same turned, and the angle of that turn.

    A frame has z along the first axis and y along the second; it is turned about y until z lies along the third.
    """
    x, y, z = vec3.cross(b, a), b, a
    sin, cos = vec3.dot(x, c), vec3.dot(z, c)
    turned = jnp.stack([cos * x - sin * z, y, sin * x + cos * z], axis=1)
    return jnp.stack([x, y, z], axis=1), turned, arctan2(sin, cos)
