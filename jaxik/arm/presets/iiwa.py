"""KUKA LBR iiwa 7 R800 and 14 R820: exact members of the class, with published data."""

from dataclasses import dataclass

import numpy as np

from jaxik.arm.arm import ArmModel, LinkInertia, Motors
from jaxik.arm.builder import floats, make_arm
from jaxik.arm.swivel_reference import StereographicReference

_AXES = ((0, 0, 1), (0, 1, 0), (0, 0, 1), (0, -1, 0), (0, 0, 1), (0, 1, 0), (0, 0, 1))

# Rotation of link frame i in the base frame at zero angles, as rows: y and z of some links are exchanged.
_EVEN = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
_LINK_FRAMES = np.array(
    [
        _EVEN,
        ((-1, 0, 0), (0, 0, 1), (0, 1, 0)),
        _EVEN,
        ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
        ((-1, 0, 0), (0, -1, 0), (0, 0, 1)),
        ((-1, 0, 0), (0, 0, 1), (0, 1, 0)),
        _EVEN,
    ],
    float,
)

# Centers of mass in the link frames [m]: the same in both public descriptions.
_CENTERS = np.array(
    [
        (0, -0.03, 0.12),
        (0.0003, 0.059, 0.042),
        (0, 0.03, 0.13),
        (0, 0.067, 0.034),
        (0.0001, 0.021, 0.076),
        (0, 0.0006, 0.0004),
        (0, 0, 0.02),
    ]
)

# No motor data is published. Estimate: every joint draws this current through this resistance at its largest torque;
# that is 64 W of heat, of the size that a frameless motor of that diameter can give off behind a harmonic gear.
_CURRENT, _RESISTANCE = 8.0, 1.0  # [A], [ohm]


@dataclass(frozen=True)
class _Sizes:
    """Differences between the two arms; lengths from the floor up [m]."""

    joint_heights: tuple[float, ...]  # origins of the link frames along z
    flange: float
    frame_6_offset: float  # distance along y of the public description's link frame 6 from the z axis
    torque: tuple[float, ...]  # [N m]
    velocity_deg: tuple[float, ...]  # [deg/s]
    mass: tuple[float, ...]  # [kg]
    inertia: tuple[tuple[float, float, float], ...]  # ixx, iyy, izz in the link frames [kg m²]


_IIWA7 = _Sizes(
    joint_heights=(0.15, 0.34, 0.55, 0.74, 0.95, 1.14, 1.221),
    flange=1.266,
    frame_6_offset=-0.0607,
    torque=(176.0, 176.0, 110.0, 110.0, 110.0, 40.0, 40.0),
    velocity_deg=(98.0, 98.0, 100.0, 130.0, 140.0, 180.0, 180.0),
    mass=(4.0, 4.0, 3.0, 2.7, 1.7, 1.8, 0.3),
    inertia=(
        (0.1, 0.09, 0.02),
        (0.05, 0.018, 0.044),
        (0.08, 0.075, 0.01),
        (0.03, 0.01, 0.029),
        (0.02, 0.018, 0.005),
        (0.005, 0.0036, 0.0047),
        (0.001, 0.001, 0.001),
    ),
)

_IIWA14 = _Sizes(
    joint_heights=(0.1575, 0.36, 0.5645, 0.78, 0.9645, 1.18, 1.261),
    flange=1.306,
    frame_6_offset=0.0,
    torque=(320.0, 320.0, 176.0, 176.0, 110.0, 40.0, 40.0),
    velocity_deg=(85.0, 85.0, 100.0, 75.0, 130.0, 135.0, 135.0),
    mass=(5.76, 6.35, 3.5, 3.5, 3.5, 1.8, 1.2),
    inertia=(
        (0.033, 0.0333, 0.0123),
        (0.0305, 0.0304, 0.011),
        (0.025, 0.0238, 0.0076),
        (0.017, 0.0164, 0.006),
        (0.01, 0.0087, 0.00449),
        (0.0049, 0.0047, 0.0036),
        (0.001, 0.001, 0.001),
    ),
)


def iiwa7() -> ArmModel:
    """Return the KUKA LBR iiwa 7 R800: seven joints, upper arm 0.4 m, forearm 0.4 m, wrist to flange 0.126 m.

    Base frame in the floor plate, z up; at zero angles the arm stands upright. The tool is the flange.

    Example:
        >>> iiwa7().arm.n_joints
        7
    """
    return _iiwa(
        "iiwa7",
        _IIWA7,
        "KUKA LBR iiwa 7 R800 data sheet (limits, speeds, torques); masses and inertias: "
        "IFL-CAMP/iiwa_stack, iiwa7.xacro",
    )


def iiwa14() -> ArmModel:
    """Return the KUKA LBR iiwa 14 R820: seven joints, upper arm 0.42 m, forearm 0.4 m, wrist to flange 0.126 m.

    Base frame in the floor plate, z up; at zero angles the arm stands upright. The tool is the flange.

    Example:
        >>> iiwa14().joint_names[0]
        'joint_1'
    """
    return _iiwa(
        "iiwa14",
        _IIWA14,
        "KUKA LBR iiwa 14 R820 data sheet (limits, speeds, torques); masses and inertias: "
        "RobotLocomotion/drake, iiwa14_no_collision.urdf",
    )


def _iiwa(name: str, sizes: _Sizes, source: str) -> ArmModel:
    heights = np.array(sizes.joint_heights)
    up = np.array([0.0, 0.0, 1.0])
    centers = np.einsum("lij,lj->li", _LINK_FRAMES, _CENTERS) + heights[:, None] * up
    centers[5, 1] += sizes.frame_6_offset
    inertia = np.einsum("lij,lj,lkj->lik", _LINK_FRAMES, np.array(sizes.inertia), _LINK_FRAMES)
    limits = np.radians([170, 120, 170, 120, 170, 120, 175])
    arm = make_arm(
        axes=_AXES,
        shoulder=heights[1] * up,
        elbow=heights[3] * up,
        wrist=heights[5] * up,
        tool_position=sizes.flange * up,
        lower=-limits,
        upper=limits,
        velocity_limit=np.radians(sizes.velocity_deg),
        torque_limit=sizes.torque,
        links=LinkInertia(floats(sizes.mass), floats(centers), floats(inertia)),
        motors=Motors(floats(np.full(7, _RESISTANCE)), floats(np.array(sizes.torque) / _CURRENT)),
        reference=StereographicReference(pole=floats(-up), zero=floats((-1, 0, 0))),
    )
    return ArmModel(
        arm=arm,
        joint_names=tuple(f"joint_{i}" for i in range(1, 8)),
        name=name,
        source=source,
        notes=(
            "Masses and inertias are the public description's estimates; KUKA publishes none.",
            f"No motor data is published: resistance and torque constant are estimates, {_CURRENT:g} A through "
            f"{_RESISTANCE:g} ohm at the largest torque.",
            "Swivel 0 is the elbow above a wrist that reaches forward; the reference is singular for a wrist straight "
            "below the shoulder, inside the arm's own base.",
        ),
    )
