"""All solutions of an arm, in the way of its class."""

from jax import Array

from jaxik.arm import Arm, OuterJointArm, RefinedArm
from jaxik.ik.closed_form import Branches, closed_form
from jaxik.ik.outer_joint_branches import OuterJointBranches
from jaxik.ik.outer_joint_form import outer_joint_form
from jaxik.ik.refined_branches import RefinedBranches
from jaxik.ik.refined_form import refined_form

AnyBranches = Branches | OuterJointBranches | RefinedBranches


def all_branches(arm: Arm, position: Array, directions: Array, parameter: Array) -> AnyBranches:
    """Return all branches of targets of one float dtype: ``(3, n)``, ``(3, 3 or 1, n)`` and ``(n,)``."""
    if isinstance(arm, OuterJointArm):
        return outer_joint_form(arm, position, directions, parameter)
    if isinstance(arm, RefinedArm):
        return refined_form(arm, position, directions, parameter)
    return closed_form(arm, position, directions, parameter)
