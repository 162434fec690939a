"""The least-energy elbow along a path: a global search, then a local polish at full resolution."""

from jaxik.planning.energy_map import EnergyMap, energy_map
from jaxik.planning.motion import SwivelMotion, least_energy_motion
from jaxik.planning.planner import plan
from jaxik.planning.result import Plan, PlanStatus

__all__ = ["EnergyMap", "Plan", "PlanStatus", "SwivelMotion", "energy_map", "least_energy_motion", "plan"]
