"""Pictures: the arm on its path, the energy map, the joints over time; need the extra ``plots``."""

from jaxik.view.arm_picture import draw_arm
from jaxik.view.joints_picture import draw_joints
from jaxik.view.map_picture import draw_energy_map

__all__ = ["draw_arm", "draw_energy_map", "draw_joints"]
