"""Targets of the tool, rotations, and the checks of what callers pass in."""

from jaxik.targets.input_checks import as_floats, batch_shape, check_joints, check_target
from jaxik.targets.targets import Pointing, Pose, Target

__all__ = [
    "Pointing",
    "Pose",
    "Target",
    "as_floats",
    "batch_shape",
    "check_joints",
    "check_target",
]
