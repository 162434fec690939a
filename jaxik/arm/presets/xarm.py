"""UFACTORY xArm 7: a U-R wrist, whose joint 7 is offset by 76 mm."""

import numpy as np

from jaxik.arm.arm import ArmModel, LinkInertia
from jaxik.arm.axes_builder import arm_from_axes
from jaxik.arm.builder import floats

_AXES = ((0, 0, 1), (0, 1, 0), (0, 0, 1), (0, -1, 0), (0, 0, -1), (0, 1, 0), (0, 0, -1))
_SHOULDER, _ELBOW, _WRIST = (0, 0, 0.267), (0.0525, 0, 0.56), (0.13, 0, 0.2175)
_FLANGE = (0.206, 0, 0.1205)

# Quarter turns about x from each link frame of the public description to the next, and the frames' origins [m].
_QUARTERS = (0, -1, 1, 1, 1, 1, -1)
_ORIGINS = np.array([_SHOULDER, _SHOULDER, (0, 0, 0.56), _ELBOW, _WRIST, _WRIST, _FLANGE])
_MASS = (2.382, 1.869, 1.6383, 1.7269, 1.3203, 1.325, 0.17)
# Centers of mass in the link frames [m], and ixx, ixy, ixz, iyy, iyz, izz about them [kg m²].
_CENTERS = np.array(
    [
        (-0.0002, 0.02905, -0.01233),
        (0.00022, -0.12856, 0.01735),
        (0.0466, -0.02463, -0.00768),
        (0.07047, -0.11575, 0.012),
        (-0.00032, 0.01604, -0.026),
        (0.06469, 0.03278, 0.02141),
        (0, -0.00677, -0.01098),
    ]
)
_INERTIA = (
    (0.0056905, -1.579e-05, 5.125e-06, 0.0049566, -0.000873378, 0.003316654),
    (0.0095989, 1.541e-06, 5.56e-06, 0.00382472, -0.00317156, 0.007565669),
    (0.00310955, 0.00030837, -0.00058453, 0.00264483, 0.000338893, 0.0026624),
    (0.005889, 0.00137112, 0.00088143, 0.00359703, -0.001762155, 0.00543244),
    (0.00534665, 1.5117e-05, -3.69e-07, 0.0049779, -0.00022132, 0.0013624),
    (0.0014745, -0.000488, 0.0002953, 0.0019037, 0.00014749, 0.0023652),
    (9.3e-05, 0.0, 0.0, 5.87e-05, -3.6e-06, 0.000132),
)


def xarm7() -> ArmModel:
    """Return the UFACTORY xArm 7: seven joints, the redundancy parameter is q7.

    Base frame in the mounting face, z up; at zero angles the forearm hangs down with the hand down. The tool is the
    flange.

    Example:
        >>> xarm7().kinematic_class
        'U-R wrist'
    """
    turn_x = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    frames, frame = [], np.eye(3)
    for quarter in _QUARTERS:
        frame = frame @ np.linalg.matrix_power(turn_x, quarter % 4)
        frames.append(frame)
    frames = np.stack(frames)
    places = [0, 1, 2, 1, 3, 4, 2, 4, 5]  # of the six numbers in the symmetric matrix, row by row
    tensors = np.array(_INERTIA)[:, places].reshape(7, 3, 3)
    arm = arm_from_axes(
        _AXES,
        (_SHOULDER, _SHOULDER, _SHOULDER, _ELBOW, _WRIST, _WRIST, _FLANGE),
        _FLANGE,
        np.diag([1.0, -1.0, -1.0]),
        lower=(-2 * np.pi, -2.059, -2 * np.pi, -0.19198, -2 * np.pi, -1.69297, -2 * np.pi),
        upper=(2 * np.pi, 2.0944, 2 * np.pi, 3.927, 2 * np.pi, np.pi, 2 * np.pi),
        velocity_limit=3.14,
        torque_limit=(50.0, 50.0, 30.0, 30.0, 30.0, 20.0, 20.0),
        links=LinkInertia(
            floats(_MASS),
            floats(np.einsum("lij,lj->li", frames, _CENTERS) + _ORIGINS),
            floats(np.einsum("lij,ljk,lmk->lim", frames, tensors, frames)),
        ),
    )
    return ArmModel(
        arm=arm,
        joint_names=tuple(f"joint{i}" for i in range(1, 8)),
        name="xarm7",
        source="xArm-Developer/xarm_ros, xarm_description/urdf/xarm7.urdf (lengths, limits, speeds, torques, masses)",
        notes=(
            "The redundancy parameter is q7, in the place of a swivel.",
            "Right angles are exact here; the file prints them as 1.5708.",
            "No motor data is published: resistance and torque constant are 1, so servo energy counts squared torque.",
        ),
    )
