"""Ready-made arms; each call builds a fresh :class:`jaxik.ArmModel` in JAX's default float type."""

from jaxik.arm.presets.iiwa import iiwa7, iiwa14
from jaxik.arm.presets.meccanoid import meccanoid
from jaxik.arm.presets.paper import paper_arm

__all__ = ["iiwa7", "iiwa14", "meccanoid", "paper_arm"]
