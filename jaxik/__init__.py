"""Closed-form, batched, differentiable inverse kinematics for seven-joint arms, and the least-energy elbow."""

from jaxik import energy, paper, presets
from jaxik.arcs import SwivelArcs, swivel_arcs
from jaxik.arm import Arm, ArmModel, Gripper, HalfSpaces, LinkInertia, Motors
from jaxik.batches import solve_ik_columns, stream_ik
from jaxik.build import make_arm
from jaxik.dynamics import gravity_torque, inverse_dynamics, mass_matrix, with_payload
from jaxik.errors import ArmClassError, FileFormatError, JaxikError, MissingExtraError, UnreachableError
from jaxik.example_paths import example_path, example_path_names
from jaxik.ik import solve_ik
from jaxik.kinematics import forward_kinematics, joint_positions
from jaxik.model_file import load_model, save_model
from jaxik.nearest import NearestSolution, solve_nearest
from jaxik.path import Path, Placement
from jaxik.path_files import load_path, save_path
from jaxik.path_fit import fit_path
from jaxik.planning import EnergyMap, Plan, PlanStatus, SwivelMotion, energy_map, least_energy_motion, plan
from jaxik.solution import IKSolution, Residual, Status
from jaxik.swivel import swivel_of
from jaxik.swivel_reference import PaperReference, StereographicReference
from jaxik.targets import Pointing, Pose
from jaxik.trajectory import Trajectory, load_trajectory
from jaxik.urdf import load_urdf

__all__ = [
    "Arm",
    "ArmClassError",
    "ArmModel",
    "EnergyMap",
    "FileFormatError",
    "Gripper",
    "HalfSpaces",
    "IKSolution",
    "JaxikError",
    "LinkInertia",
    "MissingExtraError",
    "Motors",
    "NearestSolution",
    "PaperReference",
    "Path",
    "Placement",
    "Plan",
    "PlanStatus",
    "Pointing",
    "Pose",
    "Residual",
    "Status",
    "StereographicReference",
    "SwivelArcs",
    "SwivelMotion",
    "Trajectory",
    "UnreachableError",
    "energy",
    "energy_map",
    "example_path",
    "example_path_names",
    "fit_path",
    "forward_kinematics",
    "gravity_torque",
    "inverse_dynamics",
    "joint_positions",
    "least_energy_motion",
    "load_model",
    "load_path",
    "load_trajectory",
    "load_urdf",
    "make_arm",
    "mass_matrix",
    "paper",
    "plan",
    "presets",
    "save_model",
    "save_path",
    "solve_ik",
    "solve_ik_columns",
    "solve_nearest",
    "stream_ik",
    "swivel_arcs",
    "swivel_of",
    "with_payload",
]
