"""Visual meshes and shapes of a URDF file, grouped by the links of the arm."""

import io
import logging
from pathlib import Path
from typing import TYPE_CHECKING

from jaxik.arm import read_robot
from jaxik.errors import FileFormatError, MissingExtraError

if TYPE_CHECKING:
    import trimesh


def urdf_meshes(path: str | Path, base_link: str, tip_link: str) -> "list[trimesh.Trimesh | None] | None":
    """Load the visual meshes, boxes, cylinders and spheres of a URDF file, one mesh per link of the arm.

    Args:
        path: The file; mesh files are found relative to it, ``package://`` included.
        base_link: Base link, as for :func:`jaxik.load_urdf`.
        tip_link: Tip link, as for :func:`jaxik.load_urdf`.

    Returns:
        One mesh per link, starting at the base, at zero joint angles in the base frame [m], with None for links without
        visuals; or None if the file has no visuals at all.

    Raises:
        FileFormatError: The file or one of its meshes cannot be read.
        MissingExtraError: yourdfpy is not installed.
        OSError: The file cannot be opened.
    """
    path = Path(path)
    read_robot(path)  # reports errors with their line numbers
    try:
        import trimesh
        import yourdfpy
    except ImportError as error:
        raise MissingExtraError('meshes of a URDF need yourdfpy: pip install "jaxik[urdf,view]"') from error
    missing = _Missing()
    logger = logging.getLogger("yourdfpy.urdf")
    logger.addHandler(missing)
    try:
        robot = yourdfpy.URDF.load(str(path), build_scene_graph=True, load_meshes=True)
    except Exception as error:
        raise FileFormatError(f"{path}: the meshes cannot be loaded: {error}") from error
    finally:
        logger.removeHandler(missing)
    if missing.text.getvalue():
        raise FileFormatError(
            f"{path}: {missing.text.getvalue().splitlines()[0]}; add the mesh file or remove the visual"
        )
    carried = _carriers(robot.robot.joints, base_link, tip_link)
    parts: list[list[trimesh.Trimesh]] = [[] for _ in range(max(carried.values()) + 1)]
    scene = robot.scene
    for node in scene.graph.nodes_geometry:
        _, geometry = scene.graph.get(node)
        link = _link_above(scene.graph, node, carried)
        if link is not None:
            mesh = scene.geometry[geometry].copy()
            to_base, _ = scene.graph.get(node, frame_from=base_link)
            parts[carried[link]].append(mesh.apply_transform(to_base))
    if not any(parts):
        return None
    return [trimesh.util.concatenate(meshes) if meshes else None for meshes in parts]  # pyright: ignore


class _Missing(logging.Handler):
    """Collect the warnings of yourdfpy, which skips meshes that it cannot find."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.text = io.StringIO()

    def emit(self, record: logging.LogRecord) -> None:
        self.text.write(record.getMessage() + "\n")


def _carriers(joints: list, base_link: str, tip_link: str) -> dict[str, int]:
    """Number of the arm's link that carries each link of the file; links outside the arm are left out."""
    above = {joint.child: joint for joint in joints}
    chain, name = [], tip_link
    while name != base_link:
        chain.insert(0, above[name])
        name = above[name].parent
    moving = [joint.name for joint in chain if joint.type != "fixed"]
    carried = {base_link: 0}
    waiting = [base_link]
    while waiting:
        link = waiting.pop()
        for joint in joints:
            if joint.parent == link and joint.child not in carried:
                carried[joint.child] = moving.index(joint.name) + 1 if joint.name in moving else carried[link]
                waiting.append(joint.child)
    return carried


def _link_above(graph, node: str, carried: dict[str, int]) -> str | None:
    """Link that carries a geometry node."""
    parents = graph.transforms.parents
    while node is not None and node not in carried:
        node = parents.get(node)
    return node
