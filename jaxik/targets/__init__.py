"""Targets of the tool, rotations, and the checks of what callers pass in."""

from jaxik.targets.arrays import as_array, as_floats
from jaxik.targets.input_checks import as_target, batch_shape, check_joints, check_target
from jaxik.targets.rotations import (
    compose,
    cross_matrix,
    matrix_from_rotation_vector,
    matrix_from_wxyz,
    nearest_rotation,
    rotate,
    wxyz_from_matrix,
)
from jaxik.targets.targets import Pointing, Pose, RigidTransform, Target, TargetLike

__all__ = [
    "Pointing",
    "Pose",
    "RigidTransform",
    "Target",
    "TargetLike",
    "as_array",
    "as_floats",
    "as_target",
    "batch_shape",
    "check_joints",
    "check_target",
    "compose",
    "cross_matrix",
    "matrix_from_rotation_vector",
    "matrix_from_wxyz",
    "nearest_rotation",
    "rotate",
    "wxyz_from_matrix",
]
