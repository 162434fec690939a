"""One arm of the Unitree G1 with 29 joints: offsets everywhere, solved by refinement."""

from typing import Literal

import numpy as np

from jaxik.arm.arm import ArmModel
from jaxik.arm.axes_builder import arm_from_axes
from jaxik.arm.presets.link_frames import links_of_frames

_JOINTS = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch", "wrist_yaw")
_AXES = (1, 0, 2, 1, 0, 1, 2)  # y, x, z, ... of each link's frame

# Origins of the left arm's joints in the frame of the link before [m], and roll, pitch, yaw there [rad].
_ORIGINS = (
    (0.0039563, 0.10022, 0.24778),
    (0, 0.038, -0.013831),
    (0, 0.00624, -0.1032),
    (0.015783, 0, -0.080518),
    (0.100, 0.00188791, -0.010),
    (0.038, 0, 0),
    (0.046, 0, 0),
)
_TURNS = ((0.27931, 5.4949e-05, -0.00019159), (-0.27925, 0.0, 0.0), *((0.0, 0.0, 0.0),) * 5)
_LOWER = (-3.0892, -1.5882, -2.618, -1.0472, -1.972222054, -1.614429558, -1.614429558)
_UPPER = (2.6704, 2.2515, 2.618, 2.0944, 1.972222054, 1.614429558, 1.614429558)

_MASS = (0.718, 0.643, 0.734, 0.6, 0.08544498, 0.48404956, 0.08457647)
_CENTERS = (
    (0, 0.035892, -0.011628),
    (-0.000227, 0.00727, -0.063243),
    (0.010773, -0.002949, -0.072009),
    (0.064956, 0.004454, -0.010062),
    (0.01713944778, 0.00053759094, 0.00000048864),
    (0.02299989837, -0.00111685314, -0.00111658096),
    (0.02200381568, 0.00049485096, 0.00053861123),
)
_INERTIA = (
    (0.0004291, -9.2e-06, 6.4e-06, 0.000453, 2.26e-05, 0.000423),
    (0.0006177, -1e-06, 8.7e-06, 0.0006912, -5.3e-06, 0.0003894),
    (0.0009988, 7.9e-06, 0.0001412, 0.0010605, -2.86e-05, 0.0004354),
    (0.0002891, 6.53e-05, 1.72e-05, 0.0004152, -5.6e-06, 0.0004197),
    (4.821544023e-05, -4.24511021e-06, 5.10599e-09, 3.722899093e-05, -1.23525e-09, 5.482106541e-05),
    (0.00016579646273, -1.231206746e-05, 1.231699194e-05, 0.0004295405741, 8.1417712e-07, 0.00042953697654),
    (4.929128828e-05, -4.5735494e-07, 4.45867591e-06, 5.973338134e-05, 4.3217198e-07, 3.928083826e-05),
)


def g1(side: Literal["left", "right"] = "left") -> ArmModel:
    """Return one arm of the Unitree G1 with 29 joints: neither shoulder nor wrist is a point; the parameter is q7.

    Base frame of the torso link: x forward, y left, z up; at zero angles the upper arm hangs down and the forearm
    points forward. The tool is the frame of the last link, without a hand. The right arm is the mirror image of the
    left one; roll and yaw joints turn the other way there.

    Args:
        side: ``"left"`` or ``"right"``.

    Raises:
        ValueError: If the side is neither.

    Example:
        >>> g1("right").kinematic_class
        'near U-R wrist'
    """
    if side not in ("left", "right"):
        raise ValueError(f'side must be "left" or "right", got {side!r}')
    left = side == "left"
    y = 1.0 if left else -1.0
    frames, frame = [], np.eye(4)
    for origin, (roll, pitch, yaw) in zip(_ORIGINS, _TURNS, strict=True):
        link = np.eye(4)
        link[:3, :3] = _about(2, y * yaw) @ _about(1, pitch) @ _about(0, y * roll)
        link[:3, 3] = np.array([1.0, y, 1.0]) * origin
        frame = frame @ link
        frames.append(frame)
    links = np.stack(frames)
    lower, upper = np.array(_LOWER), np.array(_UPPER)
    if not left:
        swapped = np.array(_AXES) != 1
        lower, upper = np.where(swapped, -upper, lower), np.where(swapped, -lower, upper)
    arm = arm_from_axes(
        np.stack([link[:3, axis] for link, axis in zip(links, _AXES, strict=True)]),
        links[:, :3, 3],
        links[6, :3, 3],
        links[6, :3, :3],
        lower=lower,
        upper=upper,
        velocity_limit=(37.0, 37.0, 37.0, 37.0, 37.0, 22.0, 22.0),
        torque_limit=(25.0, 25.0, 25.0, 25.0, 25.0, 5.0, 5.0),
        links=links_of_frames(
            links,
            _MASS,
            np.array(_CENTERS) * (1.0, y, 1.0),
            np.array(_INERTIA) * (1.0, y, 1.0, 1.0, y, 1.0),
        ),
    )
    return ArmModel(
        arm=arm,
        joint_names=tuple(f"{side}_{name}_joint" for name in _JOINTS),
        name=f"g1_{side}",
        source="unitreerobotics/unitree_ros, robots/g1_description/g1_29dof_rev_1_0.urdf (lengths, limits, speeds, "
        "torques, masses)",
        notes=(
            "The redundancy parameter is q7, in the place of a swivel.",
            "The file places the right shoulder 0.01 mm closer to the middle than the left one; here both are alike.",
            "No motor data is published: resistance and torque constant are 1, so servo energy counts squared torque.",
        ),
    )


def _about(axis: int, angle: float) -> np.ndarray:
    """Rotation about an axis of the frame."""
    c, s = np.cos(angle), np.sin(angle)
    turned = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turned[i, i], turned[i, j], turned[j, i], turned[j, j] = c, -s, s, c
    return turned
