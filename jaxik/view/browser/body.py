"""An arm in the scene: meshes attached to link frames, of which only the frames are updated."""

from typing import TYPE_CHECKING

import numpy as np

from jaxik.targets import wxyz_from_matrix
from jaxik.view.skeleton import Skeleton

if TYPE_CHECKING:
    import trimesh
    import viser

LINK, DRUM, STRIPE = (214, 222, 228, 255), (52, 73, 94, 255), (209, 73, 91, 255)
_RADIUS = 0.030  # of a link, relative to the length of the arm
_ALONG = 0.9  # cosine between a rod and an axis that turns it in place


class Body:
    """An arm drawn by meshes on its links.

    Args:
        server: Server of the scene.
        name: Name in the scene, such as ``"/arm"``.
        skeleton: Skeleton of the arm.
        meshes: One mesh or None per link, starting at the base, at zero joint angles in the base frame; by default
            plain links with drums at the bending joints and a stripe that shows the roll.
        position: Position of the base [m].
        color: Color of the plain links as RGBA.
    """

    def __init__(
        self,
        server: "viser.ViserServer",
        name: str,
        skeleton: Skeleton,
        meshes: "list[trimesh.Trimesh | None] | None" = None,
        position: tuple[float, float, float] = (0.0, 0.0, 0.0),
        color: tuple[int, int, int, int] = LINK,
    ) -> None:
        self._skeleton = skeleton
        server.scene.add_frame(name, show_axes=False, position=position)
        self._links = []
        for i, mesh in enumerate(plain_meshes(skeleton, color) if meshes is None else meshes):
            self._links.append(server.scene.add_frame(f"{name}/link_{i}", show_axes=False))
            if mesh is not None:
                server.scene.add_mesh_trimesh(f"{name}/link_{i}/mesh", mesh)

    def move(self, q: np.ndarray) -> None:
        """Move the links to joint angles ``(joint,)`` [rad]."""
        turns, shifts = self._skeleton.motions(q)
        for link, turn, shift in zip(self._links, turns, shifts, strict=True):
            link.wxyz, link.position = wxyz_from_matrix(turn), shift


def plain_meshes(skeleton: Skeleton, color: tuple[int, int, int, int] = LINK) -> "list[trimesh.Trimesh | None]":
    """Return plain links: rods from each point of the skeleton to the next.

    Args:
        skeleton: Skeleton of the arm.
        color: Color of the rods as RGBA.

    Returns:
        One mesh or None per link, starting at the base, at zero joint angles in the base frame [m].
    """
    import trimesh

    radius, joints = _RADIUS * skeleton.length, len(skeleton.axes)
    stations, carriers = skeleton.stations, skeleton.carriers
    parts: list[list[trimesh.Trimesh]] = [[] for _ in range(joints + 1)]
    if np.linalg.norm(stations[0]) > 2 * radius:  # a stand between the base frame and the first joint
        parts[0].append(_painted(trimesh.creation.cylinder(1.6 * radius, segment=[np.zeros(3), stations[0]]), DRUM))
    widths = (*np.linspace(1.0, 0.85, len(stations) - 2), 0.6)
    for start, end, carrier, width in zip(stations[:-1], stations[1:], carriers[1:], widths, strict=True):
        if (length := float(np.linalg.norm(end - start))) < 1e-3 * skeleton.length:
            continue
        parts[carrier].append(_painted(_rod(start, end, width * radius), color))
        if length > 0.1 * skeleton.length:
            along = abs(skeleton.axes[carrier] @ (end - start)) / length if carrier < joints else 0.0
            turned = carrier + 1 if along > _ALONG else carrier  # the stripe shows a joint that rolls the rod
            parts[turned].append(_painted(_stripe(start, end, skeleton.axes[3], width * radius), STRIPE))
    for joint in (1, 3, 5):  # bending joints of shoulder, elbow and wrist
        half = 1.45 * radius * skeleton.axes[joint]
        drum = trimesh.creation.cylinder(1.3 * radius, segment=[*(skeleton.centers[joint] + s * half for s in (-1, 1))])
        parts[joint + 1].append(_painted(drum, DRUM))
    return [trimesh.util.concatenate(meshes) if meshes else None for meshes in parts]  # pyright: ignore


def _rod(start: np.ndarray, end: np.ndarray, radius: float) -> "trimesh.Trimesh":
    """Cylinder with round ends; a ball if the ends coincide."""
    import trimesh

    balls = [trimesh.creation.icosphere(3, radius) for _ in (start, end)]
    for ball, at in zip(balls, (start, end), strict=True):
        ball.apply_translation(at)
    if np.linalg.norm(end - start) > 1e-9:
        balls.append(trimesh.creation.cylinder(radius, segment=[start, end]))
    return trimesh.util.concatenate(balls)  # pyright: ignore


def _stripe(start: np.ndarray, end: np.ndarray, side: np.ndarray, radius: float) -> "trimesh.Trimesh":
    """Thin rod along one side of a link."""
    across = np.cross(end - start, side)
    size = float(np.linalg.norm(across))
    across = across / size if size > 1e-9 else side
    lift = 0.86 * radius * across
    return _rod(start + 0.2 * (end - start) + lift, start + 0.8 * (end - start) + lift, 0.25 * radius)


def _painted(mesh: "trimesh.Trimesh", color: tuple[int, int, int, int]) -> "trimesh.Trimesh":
    mesh.visual.vertex_colors = np.tile(np.array(color, np.uint8), (len(mesh.vertices), 1))  # pyright: ignore
    return mesh
