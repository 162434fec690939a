"""Page of arms that shows postures as they come, such as those of a playback on servos."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from jaxik.view.browser.body import Body
from jaxik.view.browser.gauges import joint_gauges
from jaxik.view.browser.server import Latest
from jaxik.view.skeleton import Skeleton

if TYPE_CHECKING:
    import viser

    from jaxik.arm import ArmModel


class PosturePage:
    """Arms side by side, first to last from left to right as they see it.

    Args:
        server: Server by :func:`jaxik.view.browser.open_server`.
        models: The arms.
    """

    def __init__(self, server: "viser.ViserServer", models: "Sequence[ArmModel]") -> None:
        self.server, self.models = server, models
        skeletons = [Skeleton.of(model.arm) for model in models]
        size = max(skeleton.length for skeleton in skeletons)
        middle = (len(models) - 1) / 2
        self._bodies = [
            Body(server, f"/arm_{i}", skeleton, position=(0.0, size * (middle - i), 0.0))
            for i, skeleton in enumerate(skeletons)
        ]
        server.scene.add_grid(
            "/floor", 4 * size, 4 * size, plane="xy", cell_size=size / 8, section_size=size / 2, position=(0, 0, -size)
        )
        server.initial_camera.position = (2.4 * size, 0.0, 0.4 * size)
        server.initial_camera.look_at = (0.0, 0.0, 0.0)
        self._state = server.gui.add_markdown("waiting for the first posture")
        self._gauges = [server.gui.add_html("") for _ in models]
        self._drawing = Latest[tuple[Sequence[np.ndarray], str]](self._draw)

    def show(self, postures: Sequence[np.ndarray], state: str) -> None:
        """Show a posture of every arm; one that comes while another is being drawn waits, and may be skipped.

        Args:
            postures: Joint angles per arm, ``(joint,)`` [rad].
            state: Line of text beside them.
        """
        self._drawing.put((postures, state))

    def wait(self) -> bool:
        """Return True once everything is drawn, or False after 30 s."""
        return self._drawing.wait()

    def close(self) -> None:
        """Stop drawing."""
        self._drawing.close()

    def _draw(self, shown: tuple[Sequence[np.ndarray], str]) -> None:
        postures, state = shown
        with self.server.atomic():
            self._state.content = state
            for body, gauges, model, q in zip(self._bodies, self._gauges, self.models, postures, strict=True):
                body.move(q)
                gauges.content = joint_gauges(model, q)
