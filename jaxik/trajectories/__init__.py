"""Joint motions with times: values, files, and the fastest times within limits."""

from jaxik.trajectories.retiming import Limits
from jaxik.trajectories.trajectory import Trajectory, load_trajectory

__all__ = [
    "Limits",
    "Trajectory",
    "load_trajectory",
]
