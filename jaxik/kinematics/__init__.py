"""From joint angles to poses, velocities and torques."""

from jaxik.kinematics.dynamics import gravity_torque, inverse_dynamics, largest_gravity_torque, mass_matrix
from jaxik.kinematics.forward import carry, carry_axes, forward_kinematics, joint_positions, turn_by, turns
from jaxik.kinematics.jacobian import jacobian, manipulability, self_motion_direction
from jaxik.kinematics.payload import with_payload

__all__ = [
    "carry",
    "carry_axes",
    "forward_kinematics",
    "gravity_torque",
    "inverse_dynamics",
    "jacobian",
    "joint_positions",
    "largest_gravity_torque",
    "manipulability",
    "mass_matrix",
    "self_motion_direction",
    "turn_by",
    "turns",
    "with_payload",
]
