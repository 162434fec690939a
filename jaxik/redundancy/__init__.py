"""The freedom that a target leaves: the self-motion of the swivel, its feasible arcs, and the nearest posture."""

from jaxik.redundancy.alignment import hold_split, only_aligned
from jaxik.redundancy.arcs import SwivelArcs, feasible_arcs, swivel_arcs
from jaxik.redundancy.branch_motion import BranchMotion, Rates, near_range
from jaxik.redundancy.closest import ClosestSolution, solve_closest
from jaxik.redundancy.follow_step import FollowStatus, FollowStep
from jaxik.redundancy.nearest import NearestSolution, solve_nearest
from jaxik.redundancy.parameter_motion import ParameterBranch, ParameterMotion, parameter_motion
from jaxik.redundancy.parameter_nearest import has_swivel
from jaxik.redundancy.posture_charts import PostureCharts, feasible_coordinates, moving_ends, posture_charts
from jaxik.redundancy.posture_search import parameter_nodes
from jaxik.redundancy.self_motion import SelfMotion, self_motion
from jaxik.redundancy.swivel import SwivelBranch, swivel_of, swivel_toward
from jaxik.redundancy.tangent import correction, error_and_columns
from jaxik.redundancy.target_following import follow

__all__ = [
    "BranchMotion",
    "ClosestSolution",
    "FollowStatus",
    "FollowStep",
    "NearestSolution",
    "ParameterBranch",
    "ParameterMotion",
    "PostureCharts",
    "Rates",
    "SelfMotion",
    "SwivelArcs",
    "SwivelBranch",
    "correction",
    "error_and_columns",
    "feasible_arcs",
    "feasible_coordinates",
    "follow",
    "has_swivel",
    "hold_split",
    "moving_ends",
    "near_range",
    "only_aligned",
    "parameter_motion",
    "parameter_nodes",
    "posture_charts",
    "self_motion",
    "solve_closest",
    "solve_nearest",
    "swivel_arcs",
    "swivel_of",
    "swivel_toward",
]
