"""Kinova Gen3 with seven joints: near an R-U shoulder, solved by refinement."""

import numpy as np

from jaxik.arm.arm import ArmModel
from jaxik.arm.axes_builder import arm_from_axes
from jaxik.arm.presets.link_frames import links_of_frames

# Quarter turns about x from each link frame of the public description to the next, and the origins there [m].
_QUARTERS = (2, 1, -1, 1, -1, 1, -1)
_ORIGINS = (
    (0, 0, 0.15643),
    (0, 0.005375, -0.12838),
    (0, -0.21038, -0.006375),
    (0, 0.006375, -0.21038),
    (0, -0.20843, -0.006375),
    (0, 0.00017505, -0.10593),
    (0, -0.10593, -0.00017505),
)
_FLANGE = (0, 0, -0.061525)  # in the last link's frame, half a turn about x further
_MASS = (1.3773, 1.1636, 1.1636, 0.9302, 0.6781, 0.6781, 0.364)
_CENTERS = (
    (-2.3e-05, -0.010364, -0.07336),
    (-4.4e-05, -0.09958, -0.013278),
    (-4.4e-05, -0.006641, -0.117892),
    (-1.8e-05, -0.075478, -0.015006),
    (1e-06, -0.009432, -0.063883),
    (1e-06, -0.045483, -0.00965),
    (-9.3e-05, 0.000132, -0.022905),
)
_INERTIA = (
    (0.00457, 1e-06, 2e-06, 0.004831, 0.000448, 0.001409),
    (0.011088, 5e-06, 0, 0.001072, -0.000691, 0.011255),
    (0.010932, 0, -7e-06, 0.011127, 0.000606, 0.001043),
    (0.008147, -1e-06, 0, 0.000631, -0.0005, 0.008316),
    (0.001596, 0, 0, 0.001607, 0.000256, 0.000399),
    (0.001641, 0, 0, 0.00041, -0.000278, 0.001641),
    (0.000214, 0, 1e-06, 0.000223, -2e-06, 0.00024),
)


def gen3() -> ArmModel:
    """Return the Kinova Gen3 with seven joints: no two of its shoulder axes meet within 5 mm; the parameter is q1.

    Base frame in the mounting face, z up; at zero angles the arm stands upright. The tool is the interface of the
    gripper.

    Example:
        >>> gen3().kinematic_class
        'near R-U shoulder'
    """
    turn = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    frames, frame = [], np.eye(4)
    for quarters, origin in zip((*_QUARTERS, 2), (*_ORIGINS, _FLANGE), strict=True):
        link = np.eye(4)
        link[:3, :3], link[:3, 3] = np.linalg.matrix_power(turn, quarters % 4), origin
        frame = frame @ link
        frames.append(frame)
    links, flange = np.stack(frames[:7]), frames[7]
    free = np.inf
    arm = arm_from_axes(
        links[:, :3, 2],
        links[:, :3, 3],
        flange[:3, 3],
        flange[:3, :3],
        lower=(-free, -2.24, -free, -2.57, -free, -2.09, -free),
        upper=(free, 2.24, free, 2.57, free, 2.09, free),
        velocity_limit=(1.3963, 1.3963, 1.3963, 1.3963, 1.2218, 1.2218, 1.2218),
        torque_limit=(39.0, 39.0, 39.0, 39.0, 9.0, 9.0, 9.0),
        links=links_of_frames(links, _MASS, _CENTERS, _INERTIA),
    )
    return ArmModel(
        arm=arm,
        joint_names=tuple(f"joint_{i}" for i in range(1, 8)),
        name="gen3",
        source="Kinovarobotics/ros2_kortex, kortex_description/arms/gen3/7dof (lengths, speeds, torques, masses "
        "without vision module); GEN3_URDF_V12 (limits)",
        notes=(
            "The redundancy parameter is q1, in the place of a swivel.",
            "Right angles are exact here; the file prints them as 1.5708.",
            "No motor data is published: resistance and torque constant are 1, so servo energy counts squared torque.",
        ),
    )
