"""Obstacles in the scene: spheres to click and drag, half-spaces as plates, and the spheres of the arm's body."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from jaxik.arm import Arm
from jaxik.obstacles import World
from jaxik.view.elbow_curve import ITSELF
from jaxik.view.skeleton import Skeleton

if TYPE_CHECKING:
    import viser

_COLORS = ((222, 98, 0), (104, 40, 168), (190, 24, 110), (140, 96, 0), (0, 118, 150), (112, 52, 36))
_ITSELF, _BODY = (40, 44, 52), (42, 111, 151)
_UPRIGHT = (1.0, 0.0, 0.0, 0.0)


def blocker_color(blocker: int) -> tuple[int, int, int]:
    """Return the color of what blocks a part of the circle, as in :class:`jaxik.view.elbow_curve.ElbowCurve`."""
    return _ITSELF if blocker == ITSELF else _COLORS[blocker % len(_COLORS)]


class WorldView:
    """A world in the scene. A click on a sphere moves the handle to it; dragging the handle moves the sphere.

    Args:
        server: Server of the scene.
        world: The world, without batch axes.
        size: Length of the arm [m], the scale of handles and plates.
        changed: Function of the world after a sphere was dragged; None for obstacles that stay.
        name: Name in the scene.
    """

    def __init__(
        self,
        server: "viser.ViserServer",
        world: World,
        size: float,
        changed: Callable[[World], None] | None = None,
        name: str = "/world",
    ) -> None:
        self.world, self._changed = world, changed
        self._centers, radii = np.array(world.centers, float), np.asarray(world.radii, float)
        real = np.flatnonzero(radii >= 0.0)
        for i, (normal, offset) in enumerate(zip(np.asarray(world.normals), np.asarray(world.offsets), strict=True)):
            server.scene.add_box(
                f"{name}/half_space_{i}",
                blocker_color(len(radii) + i),
                (2.2 * size, 2.2 * size, 0.004 * size),
                opacity=0.12,
                cast_shadow=False,
                wxyz=_turn_to(np.asarray(normal, float)),
                position=tuple(np.asarray(normal, float) * float(offset)),
            )
        if not len(real):
            return
        self._spheres = add_spheres(
            server, f"{name}/spheres", self._centers, radii, np.array([blocker_color(i) for i in range(len(radii))])
        )
        if changed is None:
            return
        self.selected = int(real[0])
        self.handle = server.scene.add_transform_controls(
            f"{name}/handle",
            scale=0.16 * size,
            position=self._centers[real[0]],
            disable_rotations=True,
            depth_test=False,
        )

        @self._spheres.on_click
        async def _(event: "viser.SceneNodePointerEvent") -> None:
            if event.instance_index is not None and radii[event.instance_index] >= 0.0:
                self.selected = int(event.instance_index)
                self.handle.position = self._centers[self.selected]

        @self.handle.on_update
        async def _(event: "viser.TransformControlsEvent") -> None:  # async handlers run in order
            self.move(self.selected, np.asarray(self.handle.position, float))

    def move(self, sphere: int, center: np.ndarray) -> None:
        """Move a sphere to a center ``(3,)`` [m]."""
        self._centers[sphere] = center
        self._spheres.batched_positions = self._centers.astype(np.float32)
        old = self.world
        self.world = World(self._centers.astype(old.centers.dtype), old.radii, old.normals, old.offsets)
        if self._changed is not None:
            self._changed(self.world)


class BodySpheres:
    """The spheres of an arm's body, which follow its links.

    Args:
        server: Server of the scene.
        name: Name in the scene.
        arm: An arm with a body.
    """

    def __init__(self, server: "viser.ViserServer", name: str, arm: Arm) -> None:
        body = arm.surroundings.body
        self._skeleton, self._link = Skeleton.of(arm), list(body.link)
        self._centers = np.asarray(body.centers, float)
        colors = np.tile(_BODY, (len(self._link), 1))
        self.handle = add_spheres(server, name, self._centers, np.asarray(body.radii, float), colors, 0.22)
        self.handle.visible = False

    def move(self, q: np.ndarray) -> None:
        """Move the spheres to joint angles ``(joint,)`` [rad]."""
        turns, shifts = self._skeleton.motions(q)
        centers = np.einsum("mij,mj->mi", turns[self._link], self._centers) + shifts[self._link]
        self.handle.batched_positions = centers.astype(np.float32)


def add_spheres(
    server: "viser.ViserServer",
    name: str,
    centers: np.ndarray,
    radii: np.ndarray,
    colors: np.ndarray,
    opacity: float = 0.85,
) -> "viser.BatchedMeshHandle":
    """Add spheres ``(N, 3)``, ``(N,)`` [m] with colors ``(N, 3)`` as one mesh; a negative radius is none."""
    import trimesh

    ball = trimesh.creation.icosphere(3, 1.0)
    return server.scene.add_batched_meshes_simple(
        name,
        np.asarray(ball.vertices, np.float32),
        np.asarray(ball.faces),
        np.tile(np.array(_UPRIGHT, np.float32), (len(centers), 1)),
        centers.astype(np.float32),
        batched_scales=np.maximum(radii, 1e-6).astype(np.float32),
        batched_colors=colors.astype(np.uint8),
        lod="off",
        opacity=opacity,
        cast_shadow=False,
    )


def _turn_to(normal: np.ndarray) -> np.ndarray:
    """Quaternion that turns the z axis to a unit vector."""
    turn = np.array([1.0 + normal[2], -normal[1], normal[0], 0.0])
    size = np.linalg.norm(turn)
    return turn / size if size > 1e-6 else np.array([0.0, 1.0, 0.0, 0.0])
