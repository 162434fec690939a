"""Closed-form, batched, differentiable inverse kinematics for seven-joint arms, and the least-energy elbow along a path."""

from jaxik.arm import Arm, ArmModel, Gripper, HalfSpaces, LinkInertia, Motors
from jaxik.errors import ArmClassError, FileFormatError, JaxikError, MissingExtraError, UnreachableError
from jaxik.ik import solve_ik
from jaxik.kinematics import forward_kinematics, joint_positions
from jaxik.solution import IKSolution, Residual, Status
from jaxik.swivel_reference import PaperReference, StereographicReference
from jaxik.targets import Pointing, Pose

__all__ = [
    "Arm",
    "ArmClassError",
    "ArmModel",
    "FileFormatError",
    "Gripper",
    "HalfSpaces",
    "IKSolution",
    "JaxikError",
    "LinkInertia",
    "MissingExtraError",
    "Motors",
    "PaperReference",
    "Pointing",
    "Pose",
    "Residual",
    "Status",
    "StereographicReference",
    "UnreachableError",
    "forward_kinematics",
    "joint_positions",
    "solve_ik",
]
