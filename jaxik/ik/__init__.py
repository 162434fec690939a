"""Inverse kinematics of S-R-S arms in closed form: all eight branches at a swivel."""

from jaxik.ik.all_branches import all_branches
from jaxik.ik.arm_constants import ArmConstants, arm_constants
from jaxik.ik.branches import BRANCHES, BranchBits, branch_bits, branch_number
from jaxik.ik.closed_form import Branches, closed_form, elbow_angle, usable_circle, wrist_and_hand
from jaxik.ik.elbow_circle import Bend, Reach, bend, elbow_slack, into_plane, out_of_plane
from jaxik.ik.large_batches import over_targets
from jaxik.ik.outer_joint_branches import OuterJointBranches
from jaxik.ik.outer_joint_form import outer_joint_form
from jaxik.ik.refined_branches import RefinedBranches
from jaxik.ik.refined_form import refined_bits, refined_form
from jaxik.ik.refusal import raise_unless_ok
from jaxik.ik.residual import residual
from jaxik.ik.solution import BranchSolution, IKSolution, Residual
from jaxik.ik.solve import solve_ik, target_columns
from jaxik.ik.status import Status
from jaxik.ik.stream import SolvedRows, cores, solve_ik_columns, stream_ik
from jaxik.ik.target_checks import CheckedTarget, replace_bad_rows
from jaxik.ik.turns import Turns

__all__ = [
    "BRANCHES",
    "ArmConstants",
    "Bend",
    "BranchBits",
    "BranchSolution",
    "Branches",
    "CheckedTarget",
    "IKSolution",
    "OuterJointBranches",
    "Reach",
    "RefinedBranches",
    "Residual",
    "SolvedRows",
    "Status",
    "Turns",
    "all_branches",
    "arm_constants",
    "bend",
    "branch_bits",
    "branch_number",
    "closed_form",
    "cores",
    "elbow_angle",
    "elbow_slack",
    "into_plane",
    "out_of_plane",
    "outer_joint_form",
    "over_targets",
    "raise_unless_ok",
    "refined_bits",
    "refined_form",
    "replace_bad_rows",
    "residual",
    "solve_ik",
    "solve_ik_columns",
    "stream_ik",
    "target_columns",
    "usable_circle",
    "wrist_and_hand",
]
