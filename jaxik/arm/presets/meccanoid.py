"""One arm of a Meccanoid G15KS with the paper's extra servos: six posed joints and a gripper."""

from typing import Literal

import numpy as np

from jaxik.arm.arm import ArmModel, Gripper, HalfSpaces, LinkInertia, Motors
from jaxik.arm.builder import floats, make_arm
from jaxik.arm.swivel_reference import StereographicReference

# Estimated for a robot 1.2 m tall [m].
_UPPER_ARM, _FOREARM, _HAND = 0.17, 0.15, 0.10

# Distance inward of the shoulder at which the elbow's center makes upper arm and flank touch [m], estimated.
_ROOM_INWARD = 0.02

_FORWARD, _UP = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
_JOINTS = ("shoulder_swing", "shoulder_lift", "upper_arm_roll", "elbow_flexion", "wrist_roll", "hand_flexion")

# Every range is at most the servo's 180 degrees. Swing and lift rest near one end, as the raw rest positions of a
# tested robot show, 28 and 214 of 24..232 (3.5 and 15.6 degrees from the end); the elbow's stop is an estimate.
_LOWER_DEG = (-5, -15, -90, 0, -90, -90)
_UPPER_DEG = (175, 165, 90, 150, 90, 90)

# Of the link between joints i and i + 1.
_MASS = (0.06, 0.07, 0.06, 0.05, 0.03, 0.05)  # [kg]
_CENTER_DEPTH = (0.0, 0.05, 0.14, 0.22, 0.32, 0.37)  # of the center below the shoulder [m]
_RADIUS = 0.02  # links taken as balls of this radius [m]


def meccanoid(side: Literal["left", "right"] = "right") -> ArmModel:
    """Return one arm of the Meccanoid G15KS as the paper extends it: four smart servos, two hobby servos, a gripper.

    Base frame at the shoulder: x forward, y left, z up. At zero angles the arm hangs straight down, its rest pose.
    Positive angles swing the arm forward, lift it outward, flex elbow and hand forward, and roll the upper arm and the
    forearm outward; the same angles on both sides are mirror images in the sagittal plane.

    Args:
        side: ``"left"`` or ``"right"``.

    Raises:
        ValueError: If the side is neither.

    Example:
        >>> meccanoid("left").gripper.name
        'left_gripper'
    """
    if side not in ("left", "right"):
        raise ValueError(f'side must be "left" or "right", got {side!r}')
    outward = np.array([0.0, 1.0 if side == "left" else -1.0, 0.0])
    swing = np.array([0.0, -1.0, 0.0])  # turns "down" to "forward" on both sides
    lift = np.cross(-_UP, outward)
    roll = lift @ _FORWARD * _UP  # turns "forward" to "outward"
    down = -_UP
    depth = np.array(_CENTER_DEPTH)
    mass = np.array(_MASS)
    arm = make_arm(
        axes=[swing, lift, roll, swing, roll, swing],
        shoulder=(0, 0, 0),
        elbow=_UPPER_ARM * down,
        wrist=(_UPPER_ARM + _FOREARM) * down,
        tool_position=(_UPPER_ARM + _FOREARM + _HAND) * down,
        lower=np.radians(_LOWER_DEG),
        upper=np.radians(_UPPER_DEG),
        velocity_limit=(2.0, 2.0, 2.0, 2.0, 5.0, 5.0),
        torque_limit=(1.0, 1.0, 1.0, 1.0, 0.3, 0.3),
        links=LinkInertia(
            floats(mass), floats(depth[:, None] * down), floats(0.4 * mass[:, None, None] * _RADIUS**2 * np.eye(3))
        ),
        motors=Motors(resistance=floats((5, 5, 5, 5, 8, 8)), torque_constant=floats((0.8, 0.8, 0.8, 0.8, 0.5, 0.5))),
        keep_out=HalfSpaces(normal=floats(-outward[None]), offset=floats([_ROOM_INWARD])),
        reference=_reference(outward),
    )
    return ArmModel(
        arm=arm,
        joint_names=tuple(f"{side}_{name}" for name in _JOINTS),
        name=f"meccanoid_{side}",
        source="Estimated from the paper's pictures and the robot's height of 1.2 m; no manual was at hand",
        notes=(
            f"Lengths are estimates: upper arm {_UPPER_ARM} m, forearm {_FOREARM} m, hand {_HAND} m; measure yours, or "
            "calibrate them from observed tool points.",
            "Every range lies within the servos' 180 degrees; where each range begins is an estimate, so calibrate "
            "before playing on hardware.",
            "Masses, centers, inertias, torques, speeds and motor data are estimates for smart and hobby servos: stall "
            "1.0 and 0.3 N m, 2 and 5 rad/s, 5 and 8 ohm, 0.8 and 0.5 N m/A.",
            f"The elbow must stay on its side of the body: at most {_ROOM_INWARD} m inward of the shoulder, estimated.",
            "Swivel 0 is the elbow out and down for a hand in front, and back for a hanging arm; the reference is "
            "singular for a wrist straight inward and a little back, through the robot's own chest, from which these "
            "ranges keep it by more than 20 degrees. Mirrored postures have opposite swivels.",
        ),
        gripper=Gripper(name=f"{side}_gripper", lower=0.0, upper=float(np.pi / 2)),
    )


def _reference(outward: np.ndarray) -> StereographicReference:
    """Return a reference with its pole in the robot's chest, where the servos' ranges never let the wrist go."""
    pole = -0.28 * _FORWARD - 0.96 * outward
    back = -0.96 * _FORWARD + 0.28 * outward
    return StereographicReference(pole=floats(pole), zero=floats(0.8 * back - 0.6 * _UP))
