"""Pictures, which need the extra ``plots``, and the viewer in the browser, :mod:`jaxik.view.browser`."""

from jaxik.view.arcs_picture import draw_arcs
from jaxik.view.arm_picture import draw_arm
from jaxik.view.joints_picture import draw_joints, draw_torques, draw_velocities
from jaxik.view.learning_picture import draw_learning
from jaxik.view.map_picture import draw_energy_map
from jaxik.view.paper_picture import draw_construction
from jaxik.view.tracking_picture import TrackingLog, draw_tracking
from jaxik.view.urdf_meshes import urdf_meshes

__all__ = [
    "TrackingLog",
    "draw_arcs",
    "draw_arm",
    "draw_construction",
    "draw_energy_map",
    "draw_joints",
    "draw_learning",
    "draw_torques",
    "draw_tracking",
    "draw_velocities",
    "urdf_meshes",
]
