"""OpenArm 1.0 by Enactic: an S-R-S arm with an elbow offset of 31.5 mm."""

from typing import Literal

import numpy as np

from jaxik.arm.arm import ArmModel
from jaxik.arm.axes_builder import arm_from_axes

# The single arm of the public description, upright at zero angles [m]; joint 2 of the pair rests a quarter turn aside.
_AXES = ((0, 0, 1), (-1, 0, 0), (0, 0, 1), (0, 1, 0), (0, 0, 1), (1, 0, 0), (0, -1, 0))
_SHOULDER, _ELBOW, _WRIST = (0, 0, 0.1225), (0, 0.0315, 0.3425), (0, 0, 0.5585)


def openarm(side: Literal["left", "right"] = "left") -> ArmModel:
    """Return one arm of an OpenArm pair (version 1.0): seven joints, the redundancy parameter is the swivel.

    Base frame of the arm's link 0, z along axis 1, outward from the body; at zero angles the arm points along y (left)
    or against it (right). The tool is the flange, in the wrist.

    Args:
        side: ``"left"`` or ``"right"``.

    Raises:
        ValueError: If the side is neither.

    Example:
        >>> openarm("right").kinematic_class
        'S-R-S'
    """
    if side not in ("left", "right"):
        raise ValueError(f'side must be "left" or "right", got {side!r}')
    quarter = -1.0 if side == "left" else 1.0
    turn = np.array([[1.0, 0, 0], [0, 0, -quarter], [0, quarter, 0]])  # about x, as joint 2 turns
    shoulder = np.array(_SHOULDER)
    beyond = shoulder + (np.array([_SHOULDER, _ELBOW, _WRIST, _WRIST, _WRIST]) - shoulder) @ turn.T
    axes = np.array(_AXES, float)
    axes[2:] = axes[2:] @ turn.T
    swing = (-3.490659, 1.396263) if side == "left" else (-1.396263, 3.490659)
    lift = (-3.316125, 0.174533) if side == "left" else (-0.174533, 3.316125)
    arm = arm_from_axes(
        axes,
        np.concatenate([[shoulder, shoulder], beyond]),
        beyond[-1],
        turn,
        lower=(swing[0], lift[0], -1.570796, 0.0, -1.570796, -0.785398, -1.570796),
        upper=(swing[1], lift[1], 1.570796, 2.443461, 1.570796, 0.785398, 1.570796),
        velocity_limit=(16.754666, 16.754666, 5.445426, 5.445426, 20.943946, 20.943946, 20.943946),
        torque_limit=(40.0, 40.0, 27.0, 27.0, 7.0, 7.0, 7.0),
    )
    return ArmModel(
        arm=arm,
        joint_names=tuple(f"openarm_{side}_joint{i}" for i in range(1, 8)),
        name=f"openarm_{side}",
        source="enactic/openarm_description, arm v1.0 (lengths, limits, speeds, torques)",
        notes=(
            "Masses are left out: the arm is massless here, and servo energy counts squared torque.",
            "Torques and speeds are the largest of the motors, not what they sustain.",
        ),
    )
