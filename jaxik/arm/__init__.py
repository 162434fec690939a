"""The arm as data: its arrays, how it is built, read and stored, and ready-made ones."""

from jaxik.arm import presets
from jaxik.arm.arm import Arm, ArmModel, Gripper, HalfSpaces, LinkInertia, Motors, as_arm
from jaxik.arm.arm_classes import deviation_of
from jaxik.arm.axes_builder import arm_from_axes
from jaxik.arm.builder import CONTINUOUS, floats, make_arm
from jaxik.arm.dh_builder import arm_from_dh
from jaxik.arm.limits import clip_value, fit_to_limits, resting_angle, within_limits
from jaxik.arm.model_file import load_model, model_content, model_from_content, save_model
from jaxik.arm.outer_joint_arm import OuterJointArm, reversed_arm
from jaxik.arm.refined_arm import SLOTS, RefinedArm
from jaxik.arm.swivel_reference import PaperReference, StereographicReference, SwivelReference
from jaxik.arm.urdf import load_urdf
from jaxik.arm.urdf_arms import UrdfArm, list_arms
from jaxik.arm.urdf_chain import chain_between, children_of
from jaxik.arm.urdf_file import read_robot, urdf_frame, urdf_numbers
from jaxik.arm.urdf_mesh import urdf_mesh
from jaxik.arm.urdf_xml import Element

__all__ = [
    "CONTINUOUS",
    "SLOTS",
    "Arm",
    "ArmModel",
    "Element",
    "Gripper",
    "HalfSpaces",
    "LinkInertia",
    "Motors",
    "OuterJointArm",
    "PaperReference",
    "RefinedArm",
    "StereographicReference",
    "SwivelReference",
    "UrdfArm",
    "arm_from_axes",
    "arm_from_dh",
    "as_arm",
    "chain_between",
    "children_of",
    "clip_value",
    "deviation_of",
    "fit_to_limits",
    "floats",
    "list_arms",
    "load_model",
    "load_urdf",
    "make_arm",
    "model_content",
    "model_from_content",
    "presets",
    "read_robot",
    "resting_angle",
    "reversed_arm",
    "save_model",
    "urdf_frame",
    "urdf_mesh",
    "urdf_numbers",
    "within_limits",
]
