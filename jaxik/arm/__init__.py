"""The arm as data: its arrays, how it is built, read and stored, and ready-made ones."""

from jaxik.arm import presets
from jaxik.arm.arm import Arm, ArmModel, Gripper, HalfSpaces, LinkInertia, Motors, as_arm
from jaxik.arm.builder import floats, make_arm
from jaxik.arm.limits import fit_to_limits, within_limits
from jaxik.arm.model_file import load_model, model_content, model_from_content, save_model
from jaxik.arm.swivel_reference import PaperReference, StereographicReference, SwivelReference
from jaxik.arm.urdf import load_urdf
from jaxik.arm.urdf_file import read_robot

__all__ = [
    "Arm",
    "ArmModel",
    "Gripper",
    "HalfSpaces",
    "LinkInertia",
    "Motors",
    "PaperReference",
    "StereographicReference",
    "SwivelReference",
    "as_arm",
    "fit_to_limits",
    "floats",
    "load_model",
    "load_urdf",
    "make_arm",
    "model_content",
    "model_from_content",
    "presets",
    "read_robot",
    "save_model",
    "within_limits",
]
