"""The least-energy elbow along a path: a global search, a refinement at full resolution, and a certificate."""

from jaxik.planning.ahead import compile_before_placing
from jaxik.planning.baselines import Baselines, baselines
from jaxik.planning.clearance_along import ClearanceAlong
from jaxik.planning.energy_map import EnergyMap, energy_map
from jaxik.planning.fast import BatchMotion, plan_batch
from jaxik.planning.motion import least_energy_motion
from jaxik.planning.path_fit import fit_path
from jaxik.planning.planner import plan
from jaxik.planning.result import Plan
from jaxik.planning.search_size import searched_waypoints
from jaxik.planning.status import PlanStatus
from jaxik.planning.swivel_grid import SwivelGrid, swivel_grid
from jaxik.planning.swivel_motion import SwivelMotion

__all__ = [
    "Baselines",
    "BatchMotion",
    "ClearanceAlong",
    "EnergyMap",
    "Plan",
    "PlanStatus",
    "SwivelGrid",
    "SwivelMotion",
    "baselines",
    "compile_before_placing",
    "energy_map",
    "fit_path",
    "least_energy_motion",
    "plan",
    "plan_batch",
    "searched_waypoints",
    "swivel_grid",
]
