"""Franka Panda (FER) and Franka Research 3: U-R wrists, whose joint 7 is offset by 88 mm."""

import numpy as np

from jaxik.arm.arm import ArmModel
from jaxik.arm.axes_builder import arm_from_axes

_AXES = ((0, 0, 1), (0, 1, 0), (0, 0, 1), (0, -1, 0), (0, 0, 1), (0, -1, 0), (0, 0, -1))
_SHOULDER, _ELBOW, _WRIST = (0, 0, 0.333), (0.0825, 0, 0.649), (0, 0, 1.033)
_OUTER, _FLANGE = (0.088, 0, 1.033), (0.088, 0, 0.926)
_TORQUE = (87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0)  # [N m]


def franka_panda() -> ArmModel:
    """Return the Franka Emika Panda (FER): seven joints, the redundancy parameter is q7.

    Base frame in the mounting face, z up; at zero angles the arm stands upright with its hand down. The tool is the
    flange. The ready posture is ``q = [0, -pi/4, 0, -3 pi/4, 0, pi/2, pi/4]``.

    Example:
        >>> franka_panda().kinematic_class
        'U-R wrist'
    """
    return _franka(
        "franka_panda",
        lower=(-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973),
        upper=(2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973),
        velocity=(2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61),
        source="Franka Control Interface documentation, robot and interface specifications, FER",
    )


def franka_fr3() -> ArmModel:
    """Return the Franka Research 3: seven joints, the redundancy parameter is q7.

    Frames and ready posture as :func:`franka_panda`.

    Example:
        >>> franka_fr3().arm.n_joints
        7
    """
    return _franka(
        "franka_fr3",
        lower=(-2.7437, -1.7837, -2.9007, -3.0421, -2.8065, 0.5445, -3.0159),
        upper=(2.7437, 1.7837, 2.9007, -0.1518, 2.8065, 4.5169, 3.0159),
        velocity=(2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26),
        source="Franka Control Interface documentation, robot and interface specifications, FR3; "
        "frankarobotics/franka_description, robots/fr3/joint_limits.yaml",
    )


def _franka(name: str, *, lower: tuple, upper: tuple, velocity: tuple, source: str) -> ArmModel:
    arm = arm_from_axes(
        _AXES,
        (_SHOULDER, _SHOULDER, _SHOULDER, _ELBOW, _WRIST, _WRIST, _OUTER),
        _FLANGE,
        np.diag([1.0, -1.0, -1.0]),
        lower=lower,
        upper=upper,
        velocity_limit=velocity,
        torque_limit=_TORQUE,
    )
    return ArmModel(
        arm=arm,
        joint_names=tuple(f"joint_{i}" for i in range(1, 8)),
        name=name,
        source=source,
        notes=(
            "The redundancy parameter is q7, in the place of a swivel.",
            "The velocity limits are those at the middle of the ranges; near their ends the robot admits less.",
            "Franka publishes no masses and no motor data: the arm is massless here, and servo energy counts squared "
            "torque.",
        ),
    )
