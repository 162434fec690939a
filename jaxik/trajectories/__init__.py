"""Trajectories: joint angles over time, their files, and the fastest times within limits."""

from jaxik.trajectories.retiming import Limits
from jaxik.trajectories.trajectory import Trajectory, load_trajectory, save_trajectory

__all__ = [
    "Limits",
    "Trajectory",
    "load_trajectory",
    "save_trajectory",
]
