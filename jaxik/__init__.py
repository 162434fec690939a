"""Closed-form, batched, differentiable inverse kinematics for seven-joint arms, and the least-energy elbow along a path."""

from jaxik import presets
from jaxik.arm import Arm, ArmModel, Gripper, HalfSpaces, LinkInertia, Motors
from jaxik.build import make_arm
from jaxik.errors import ArmClassError, FileFormatError, JaxikError, MissingExtraError, UnreachableError
from jaxik.ik import solve_ik
from jaxik.kinematics import forward_kinematics, joint_positions
from jaxik.model_file import load_model, save_model
from jaxik.solution import IKSolution, Residual, Status
from jaxik.swivel import swivel_of
from jaxik.swivel_reference import PaperReference, StereographicReference
from jaxik.targets import Pointing, Pose
from jaxik.urdf import load_urdf

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
    "load_model",
    "load_urdf",
    "make_arm",
    "presets",
    "save_model",
    "solve_ik",
    "swivel_of",
]
