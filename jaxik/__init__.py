"""Closed-form, batched, differentiable inverse kinematics for seven-joint arms, and the least-energy elbow."""

from jaxik import energy, paper
from jaxik.arm import (
    Arm,
    ArmModel,
    Gripper,
    HalfSpaces,
    LinkInertia,
    Motors,
    PaperReference,
    StereographicReference,
    load_model,
    load_urdf,
    make_arm,
    presets,
    save_model,
)
from jaxik.errors import ArmClassError, FileFormatError, JaxikError, MissingExtraError, UnreachableError
from jaxik.ik import IKSolution, Residual, Status, solve_ik, solve_ik_columns, stream_ik
from jaxik.kinematics import (
    forward_kinematics,
    gravity_torque,
    inverse_dynamics,
    joint_positions,
    mass_matrix,
    with_payload,
)
from jaxik.paths import Path, Placement, example_path, example_path_names, load_path, save_path
from jaxik.planning import EnergyMap, Plan, PlanStatus, SwivelMotion, energy_map, least_energy_motion, plan
from jaxik.planning.path_fit import fit_path
from jaxik.redundancy import NearestSolution, SwivelArcs, solve_nearest, swivel_arcs, swivel_of
from jaxik.targets import Pointing, Pose, nearest_rotation
from jaxik.trajectories import Trajectory, load_trajectory

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
    "nearest_rotation",
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
