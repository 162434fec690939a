"""From joint angles to poses, velocities and torques."""

from jaxik.kinematics.dynamics import (
    gravity_torque,
    inverse_dynamics,
    largest_gravity_torque,
    mass_matrix,
    with_payload,
)
from jaxik.kinematics.forward import carry, forward_kinematics, joint_positions

__all__ = [
    "carry",
    "forward_kinematics",
    "gravity_torque",
    "inverse_dynamics",
    "joint_positions",
    "largest_gravity_torque",
    "mass_matrix",
    "with_payload",
]
