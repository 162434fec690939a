"""Interactive page of several arms side by side, each with its panel in a tab."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from jaxik.view.browser.arm_page import ArmPage

if TYPE_CHECKING:
    import trimesh
    import viser

    from jaxik.arm import ArmModel


class ArmsPage:
    """Several interactive arms side by side, out of reach of each other; a tab of the panel belongs to each.

    Args:
        server: Server by :func:`jaxik.view.browser.open_server`.
        models: The arms, from left to right as seen from the front.
        meshes: For each arm what :class:`ArmPage` takes; plain links by default.

    Attributes:
        pages: The page of each arm.
    """

    def __init__(
        self,
        server: "viser.ViserServer",
        models: "Sequence[ArmModel]",
        meshes: "Sequence[list[trimesh.Trimesh | None] | None] | None" = None,
    ) -> None:
        self.pages: list[ArmPage] = []
        tabs, place, before = server.gui.add_tab_group(), 0.0, 0.0
        for k, (model, mesh) in enumerate(zip(models, meshes or [None] * len(models), strict=True)):
            root = f"/place_{k}"
            frame = server.scene.add_frame(root, show_axes=False)
            with tabs.add_tab(model.name or f"arm {k + 1}"):
                page = ArmPage(server, model, mesh, root=root)
            size = page.scene.skeleton.length
            place += before + size if k else 0.0  # the floors, as wide as two lengths of an arm, touch
            frame.position, before = (0.0, place, 0.0), size
            self.pages.append(page)
        server.gui.set_panel_label("jaxik")
        middle = self.pages[0].scene.points[:3].mean(0) + np.array([0.0, place / 2, 0.0])
        wide = place + 2 * before
        server.initial_camera.position = tuple(middle + wide * np.array([0.65, -0.2, 0.25]))
        server.initial_camera.look_at = tuple(middle)

    def wait(self) -> bool:
        """Return True once everything is drawn, or False after 30 s per arm."""
        return all(page.wait() for page in self.pages)

    def close(self) -> None:
        """Stop drawing."""
        for page in self.pages:
            page.close()

    @property
    def busy(self) -> bool:
        """True while a computation is running; always False after :meth:`close`."""
        return False
