"""Trajectories: joint angles over time, their files, messages of ROS 2, and the fastest times within limits."""

from jaxik.trajectories.retiming import Limits
from jaxik.trajectories.trajectory import (
    Trajectory,
    follow_joint_trajectory_goal,
    joint_trajectory_message,
    load_trajectory,
    save_trajectory,
    trajectory_from_message,
)

__all__ = [
    "Limits",
    "Trajectory",
    "follow_joint_trajectory_goal",
    "joint_trajectory_message",
    "load_trajectory",
    "save_trajectory",
    "trajectory_from_message",
]
