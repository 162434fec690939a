"""Ready-made arms; each call builds a fresh :class:`jaxik.ArmModel` in JAX's default float type."""

from jaxik.arm.presets.franka import franka_fr3, franka_panda
from jaxik.arm.presets.g1 import g1
from jaxik.arm.presets.gen3 import gen3
from jaxik.arm.presets.iiwa import iiwa7, iiwa14
from jaxik.arm.presets.meccanoid import meccanoid
from jaxik.arm.presets.openarm import openarm
from jaxik.arm.presets.paper import paper_arm
from jaxik.arm.presets.xarm import xarm7

__all__ = [
    "franka_fr3",
    "franka_panda",
    "g1",
    "gen3",
    "iiwa7",
    "iiwa14",
    "meccanoid",
    "openarm",
    "paper_arm",
    "xarm7",
]
