"""Arms side by side in the scene, each on its motion, with the paths of tool and elbow."""

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jaxik.obstacles import World
from jaxik.trajectories import Trajectory
from jaxik.view.browser.body import LINK, Body
from jaxik.view.browser.world_view import WorldView
from jaxik.view.skeleton import Skeleton

if TYPE_CHECKING:
    import trimesh
    import viser

    from jaxik.arm import ArmModel

COOL, WARM = (42, 111, 151), (209, 73, 91)


@dataclass(frozen=True)
class ShownMotion:
    """A motion of an arm, to be shown.

    Attributes:
        model: The arm.
        trajectory: Its motion.
        caption: Text above it.
        meshes: One mesh or None per link, as for :class:`jaxik.view.browser.ArmPage`; None for plain links.
        world: Obstacles about the arm, or None.
        color: Color of plain links as RGBA.
    """

    model: "ArmModel"
    trajectory: Trajectory
    caption: str
    meshes: "list[trimesh.Trimesh | None] | None" = None
    world: World | None = None
    color: tuple[int, int, int, int] = LINK


class Stage:
    """Arms side by side on a floor.

    Args:
        server: Server by :func:`jaxik.view.browser.open_server`.
        motions: Motions to show, first to last from left to right as seen from behind.
        places: Number of arms to make room for; None for that of the motions.
        caption_scale: Size of the captions, relative to the browser's text.

    Attributes:
        start: First time of any motion [s].
        end: Last time of any motion [s].
    """

    def __init__(
        self,
        server: "viser.ViserServer",
        motions: Sequence[ShownMotion],
        *,
        places: int | None = None,
        caption_scale: float = 0.9,
    ) -> None:
        self.server, self._lock, self._caption_scale = server, threading.Lock(), caption_scale
        self._shown: list[tuple[Trajectory, Body]] = []
        self.start = min(float(motion.trajectory.time[0]) for motion in motions)
        self.end = max(float(motion.trajectory.time[-1]) for motion in motions)
        skeletons = [Skeleton.of(motion.model.arm) for motion in motions]
        tools = [s.posture(m.trajectory.q)[:, 3] for s, m in zip(skeletons, motions, strict=True)]
        offsets = [_offset_between(s, tool) for s, tool in zip(skeletons, tools, strict=True)]
        self._offset = max(offsets, key=lambda offset: float(np.linalg.norm(offset)))
        places = len(motions) if places is None else places
        lowest = min(min(0.0, float(s.points[0, 2]) - s.length) for s in skeletons)
        middle = (places - 1) / 2 * self._offset
        size = max(s.length for s in skeletons)
        wide = size * max(4, np.ceil(2 * (places * np.linalg.norm(self._offset) / size + 1)) / 2)
        server.scene.add_grid(
            "/floor", wide, wide, plane="xy", cell_size=size / 8, section_size=size / 2,
            position=(*middle[:2], lowest),
        )  # fmt: skip
        _set_camera(server, skeletons[0], tools[0], self._offset, places)
        for motion in motions:
            self.add(motion)

    def add(self, motion: ShownMotion) -> None:
        """Add an arm beside the others."""
        name, skeleton = f"/motion_{len(self._shown)}", Skeleton.of(motion.model.arm)
        offset = len(self._shown) * self._offset
        body = Body(self.server, name, skeleton, motion.meshes, tuple(offset), motion.color)
        points, size = skeleton.posture(motion.trajectory.q), skeleton.length
        for part, line, tint in (("tool", points[:, 3], COOL), ("elbow", points[:, 1], WARM)):
            pieces = np.stack([line[:-1], line[1:]], axis=1).astype(np.float32)
            if len(pieces):
                self.server.scene.add_line_segments(f"{name}/path_of_{part}", pieces, tint, thickness=0.006 * size)
        top = points.reshape(-1, 3).max(0)[2] + 0.22 * size
        position = (*points[0, 0, :2], top)
        self.server.scene.add_label(
            f"{name}/label", motion.caption, position=position, anchor="bottom-center",
            font_screen_scale=self._caption_scale,
        )  # fmt: skip
        if motion.world is not None:
            WorldView(self.server, motion.world, size, name=f"{name}/world")
        body.move(motion.trajectory.q[0])
        with self._lock:
            self._shown.append((motion.trajectory, body))

    def draw(self, time: float) -> None:
        """Draw every arm at a time [s]; before its motion and after it, an arm stands still."""
        with self._lock, self.server.atomic():
            for trajectory, body in self._shown:
                body.move(trajectory.sample(time))


def _offset_between(skeleton: Skeleton, tool: np.ndarray) -> np.ndarray:
    """Offset between neighboring arms: perpendicular to their reach, and wide enough that they do not overlap."""
    ahead = tool.mean(0)[:2] - skeleton.points[0, :2]
    ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
    across = np.array([ahead[1], -ahead[0], 0.0])
    spread = np.concatenate([tool @ across, [skeleton.points[0] @ across]])
    return across * max(float(np.ptp(spread)) + 0.35 * skeleton.length, 0.8 * skeleton.length)


def _set_camera(
    server: "viser.ViserServer", skeleton: Skeleton, tool: np.ndarray, offset: np.ndarray, places: int
) -> None:
    """View the arms from behind, so that writing is not mirrored, centered on the middle one."""
    middle = (tool.mean(0) + skeleton.points[0]) / 2 + (places - 1) / 2 * offset
    across = offset / max(float(np.linalg.norm(offset)), 1e-9)
    ahead = np.array([-across[1], across[0], 0.0])
    if places == 1:  # from aside too, where nothing has to be in one row
        ahead = (ahead + 0.8 * across) / np.linalg.norm(ahead + 0.8 * across)
    width = (places - 1) * float(np.linalg.norm(offset)) + (1.5 if places == 1 else 0.8) * skeleton.length
    server.initial_camera.position = tuple(middle - 0.82 * width * ahead + np.array([0.0, 0.0, 0.25 * width]))
    server.initial_camera.look_at = tuple(middle)
