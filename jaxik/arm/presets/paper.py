"""The arm of the paper, in its own unitless lengths, so that its worked example reads off directly."""

import numpy as np

from jaxik.arm.arm import ArmModel, HalfSpaces, LinkInertia
from jaxik.arm.builder import floats, make_arm
from jaxik.arm.swivel_reference import PaperReference

# The paper gives no masses: slender rods of one unit of mass per unit of length, moved by the joints before them.
_RODS = {2: (0.0, 3.0), 3: (3.0, 6.0), 5: (6.0, 7.0)}  # joint: from and to along z


def paper_arm() -> ArmModel:
    """Return the paper's arm: Rz(q1) Ry(q2) Rz(q3) Ry(q4) Rz(q5) Ry(q6), stacked along z at zero angles.

    The base frame is the paper's: shoulder at the origin, z up. Its worked example, wrist (3, 3, -3), hand along +y,
    swivel pi, has the joint angles (9.74, 120, 70.53, 60, 51.59, 31.40) degrees.

    Example:
        >>> paper_arm().joint_names[3]
        'elbow_flexion'
    """
    z, y = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)
    inward = np.array([-1.0, 1.0, 0.0]) / np.sqrt(2)
    arm = make_arm(
        axes=[z, y, z, y, z, y],
        shoulder=(0, 0, 0),
        elbow=(0, 0, 3),
        wrist=(0, 0, 6),
        tool_position=(0, 0, 7),
        lower=np.radians([-90, 0, 0, 0, -90, -90]),
        upper=np.radians([90, 180, 180, 180, 90, 90]),
        velocity_limit=np.pi,
        links=_rods(),
        keep_out=HalfSpaces(normal=floats(inward[None]), offset=floats([0.0])),
        reference=PaperReference(axis=floats(z), fallback=floats(inward)),
    )
    return ArmModel(
        arm=arm,
        joint_names=(
            "shoulder_azimuth",
            "shoulder_elevation",
            "upper_arm_roll",
            "elbow_flexion",
            "forearm_roll",
            "hand_flexion",
        ),
        name="paper_arm",
        source="A. Losada, 3-D geometric inverse kinematics of a 7-DOF arm: eqs. (12)-(15), (21)-(27), (37)",
        notes=(
            "Lengths are the paper's unitless numbers: upper arm 3, forearm 3, hand 1 (its example uses a hand of 1 "
            "from eq. (12) on, although eq. (3) says 2).",
            "The paper limits every servo to 180 degrees without saying from where to where; the ranges here are 180 "
            "degrees wide and admit its worked example at every swivel of its arc. Upper arm roll in [0, 180] degrees "
            "is that arc, t in [pi/2, 3 pi/2], for every wrist: both put the elbow on one side of the vertical plane "
            "through shoulder and wrist.",
            "The paper's reason for the arc is the body, which does not turn with the wrist: the keep-out is the fixed "
            "half-space that gives the same arc for wrists in the vertical plane of the worked example, "
            "(-x + y) / sqrt 2 <= 0 for the elbow.",
            "Right under or over the shoulder the paper's reference is undefined; there the zero direction is held at "
            "(-1, 1, 0) / sqrt 2, its limit for wrists of the plane above.",
            "The velocity limit of 180 degrees a second is an estimate for a standard servo; the paper gives no "
            "torques, so they are unlimited.",
            "The paper gives no masses: upper arm, forearm and hand are estimated as slender rods of mass 1 per unit "
            "of length. Resistance and torque constant are 1, so servo energy counts squared torque; energies of "
            "torques compare motions of this arm, and mean nothing in joules.",
        ),
    )


def _rods() -> LinkInertia:
    """Return masses, centers and inertias of the rods."""
    mass, center, inertia = np.zeros(6), np.zeros((6, 3)), np.zeros((6, 3, 3))
    for joint, (start, end) in _RODS.items():
        mass[joint] = end - start
        center[joint, 2] = (start + end) / 2
        inertia[joint, 0, 0] = inertia[joint, 1, 1] = mass[joint] * (end - start) ** 2 / 12
    return LinkInertia(floats(mass), floats(center), floats(inertia))
