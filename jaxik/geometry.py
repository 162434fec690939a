"""Constants of an arm in the solver's frames, worked out once per call.

Two frames do all the work. The shoulder frame C1 has z along axis 1 and y along axis 2; the elbow frame has x towards
the elbow, z along axis 4. Any triple of axes a ⊥ b ⊥ c is a ZYZ triple in such a frame, with the third axis turned by a
constant angle delta about y: exp(a q1) exp(b q2) exp(c q3) = C Rz(q1) Ry(q2 + delta) Rz(q3) Ry(-delta) Cᵀ.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxik import columns as col
from jaxik.arm import Arm
from jaxik.columns import Mat3, Vec3
from jaxik.swivel_reference import PaperReference, StereographicReference


class Geometry(NamedTuple):
    """What the closed form needs of an arm, every entry a scalar array (see :func:`geometry`)."""

    shoulder_frame: Mat3  # C1, in the base frame
    shoulder_origin: Vec3  # C1ᵀ S
    shoulder_delta: Array
    shoulder_from_elbow: Mat3  # Bᵀ C1 Ry(delta): rows in the elbow frame B
    upper: Array  # S to axis 4
    fore: Array  # W to axis 4
    skew: Array  # what S-W spans along axis 4 whatever the elbow does
    straight: Array  # q4 at full stretch
    wrist_delta: Array
    wrist_from_elbow: Mat3  # C5ᵀ B Rz(-straight)
    tool_to_wrist: tuple[Vec3, ...]  # R_Tᵀ C5 Ry(delta), three columns, or the last alone for six joints
    tool_offset: Vec3  # R_Tᵀ p_T, wrist to tool point in the tool frame
    hand: Array  # the same along the tool's z axis
    reference: type[PaperReference] | type[StereographicReference]
    reference_vectors: tuple[Vec3, Vec3]  # in the shoulder frame


def triple_frame(a: Vec3, b: Vec3) -> Mat3:
    """The frame with z along the first axis of a triple and y along the second."""
    return col.cross(b, a), b, a


def geometry(arm: Arm) -> Geometry:
    """Derives the solver's constants from the arm's arrays; smooth in all of them."""
    axes = [col.split_vector(arm.axes[i]) for i in range(arm.n_joints)]
    shoulder, elbow, wrist, tool = (
        col.split_vector(p) for p in (arm.shoulder, arm.elbow, arm.wrist, arm.tool_position)
    )
    tool_frame = col.split_matrix(arm.tool_rotation)
    shoulder_frame = triple_frame(axes[0], axes[1])
    wrist_frame = triple_frame(axes[4], axes[5])
    last = axes[6] if arm.n_joints == 7 else tool_frame[2]

    a4 = axes[3]
    upper_arm = col.project_out(col.sub(elbow, shoulder), a4)
    forearm = col.sub(wrist, elbow)
    upper = jnp.sqrt(col.dot(upper_arm, upper_arm))
    along = col.scale(1.0 / upper, upper_arm)
    elbow_frame = (along, col.cross(a4, along), a4)
    fore_x, fore_y = col.dot(forearm, elbow_frame[0]), col.dot(forearm, elbow_frame[1])
    fore = jnp.sqrt(fore_x**2 + fore_y**2)
    cos_straight, sin_straight = fore_x / fore, -fore_y / fore

    tool_offset = col.transposed_matmul(tool_frame, (col.sub(tool, wrist),))[0]
    wrist_turned, wrist_delta = _turn_about_y(wrist_frame, last)
    shoulder_turned, shoulder_delta = _turn_about_y(shoulder_frame, axes[2])
    to_wrist = col.transposed_matmul(tool_frame, wrist_turned)
    from_elbow = col.transposed_matmul(wrist_frame, elbow_frame)
    vectors = (col.split_vector(v) for v in arm.reference.vectors())
    first, second = col.transposed_matmul(shoulder_frame, tuple(vectors))
    return Geometry(
        shoulder_frame=shoulder_frame,
        shoulder_origin=col.transposed_matmul(shoulder_frame, (shoulder,))[0],
        shoulder_delta=shoulder_delta,
        shoulder_from_elbow=_three(col.transposed_matmul(elbow_frame, shoulder_turned)),
        upper=upper,
        fore=fore,
        skew=col.dot(col.sub(wrist, shoulder), a4),
        straight=jnp.arctan2(sin_straight, cos_straight),
        wrist_delta=wrist_delta,
        wrist_from_elbow=(
            col.combine((cos_straight, -sin_straight), from_elbow[:2]),
            col.combine((sin_straight, cos_straight), from_elbow[:2]),
            from_elbow[2],
        ),
        tool_to_wrist=to_wrist if arm.n_joints == 7 else to_wrist[2:],
        tool_offset=tool_offset,
        hand=tool_offset[2],
        reference=type(arm.reference),
        reference_vectors=(first, second),
    )


def _turn_about_y(frame: Mat3, third: Vec3) -> tuple[Mat3, Array]:
    """The frame turned about its y axis until z lies along ``third``, and the angle of that turn."""
    sin, cos = col.dot(frame[0], third), col.dot(frame[2], third)
    x = col.combine((cos, -sin), (frame[0], frame[2]))
    z = col.combine((sin, cos), (frame[0], frame[2]))
    return (x, frame[1], z), jnp.arctan2(sin, cos)


def _three(columns: tuple[Vec3, ...]) -> Mat3:
    a, b, c = columns
    return a, b, c
