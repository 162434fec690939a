"""Ready-made arms; each call builds a fresh :class:`jaxik.ArmModel` in JAX's default float type."""

from jaxik.presets.iiwa import iiwa7, iiwa14
from jaxik.presets.meccanoid import meccanoid
from jaxik.presets.paper import paper_arm

__all__ = ["iiwa7", "iiwa14", "meccanoid", "paper_arm"]
