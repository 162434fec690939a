"""Inverse kinematics of S-R-S arms in closed form: all eight branches at a swivel."""

from jaxik.ik.arm_constants import Geometry, geometry
from jaxik.ik.branches import BRANCHES, BranchBits, branch_bits, branch_number
from jaxik.ik.closed_form import closed_form, elbow_angle, usable_circle, wrist_and_hand
from jaxik.ik.elbow_circle import Bend, Reach, bend, into_plane, out_of_plane
from jaxik.ik.refusal import raise_unless_ok
from jaxik.ik.solution import IKSolution, Residual, Status
from jaxik.ik.solve import solve_ik, target_columns
from jaxik.ik.stream import cores, solve_ik_columns, stream_ik
from jaxik.ik.target_checks import Screened, screen

__all__ = [
    "BRANCHES",
    "Bend",
    "BranchBits",
    "Geometry",
    "IKSolution",
    "Reach",
    "Residual",
    "Screened",
    "Status",
    "bend",
    "branch_bits",
    "branch_number",
    "closed_form",
    "cores",
    "elbow_angle",
    "geometry",
    "into_plane",
    "out_of_plane",
    "raise_unless_ok",
    "screen",
    "solve_ik",
    "solve_ik_columns",
    "stream_ik",
    "target_columns",
    "usable_circle",
    "wrist_and_hand",
]
