"""Visual meshes and shapes of a URDF file, grouped by the links of the arm."""

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from jaxik.arm import Element, chain_between, children_of, load_urdf, read_robot, urdf_frame, urdf_mesh, urdf_numbers
from jaxik.errors import JaxikError, JaxikWarning, MissingExtraError
from jaxik.view.skeleton import Skeleton

if TYPE_CHECKING:
    import trimesh

_NAMED = 3  # shapes that cannot be drawn, named in a warning
_SHAPES: dict[str, tuple[tuple[str, int], ...]] = {  # numbers of each, in the order of trimesh's arguments
    "box": (("size", 3),),
    "sphere": (("radius", 1),),
    "cylinder": (("radius", 1), ("length", 1)),
    "capsule": (("radius", 1), ("length", 1)),
}


def urdf_meshes(path: str | Path, base_link: str, tip_link: str) -> "list[trimesh.Trimesh | None] | None":
    """Load the visual meshes, boxes, cylinders, capsules and spheres of a URDF file, one mesh per link of the arm.

    Links of which nothing can be drawn, because a mesh is missing or damaged, become plain links; a
    :class:`jaxik.JaxikWarning` says so.

    Args:
        path: The file; mesh files are found relative to it, ``package://`` included.
        base_link: Base link, as for :func:`jaxik.load_urdf`.
        tip_link: Tip link, as for :func:`jaxik.load_urdf`.

    Returns:
        One mesh per link, starting at the base, at zero joint angles in the base frame [m], with None for links without
        visuals; or None if no link has a visual that can be drawn.

    Raises:
        FileFormatError: The file cannot be read.
        MissingExtraError: trimesh is not installed.
        OSError: The file cannot be opened.
        ValueError: The links are not base and tip of a chain.
    """
    path = Path(path)
    robot = read_robot(path)
    chain = chain_between(robot, base_link, tip_link)
    load = _loader(path)
    colors = {m.get("name"): m for m in robot.root.all("material")}
    parts: list[list[trimesh.Trimesh]] = [[] for _ in range(len(chain.joints) + 1)]
    missing: list[tuple[int, str]] = []
    below, todo, visited = children_of(robot), [(base_link, np.eye(4), 0)], set()
    while todo:
        name, frame, owner = todo.pop()
        if name in visited or name not in robot.links:
            continue
        visited.add(name)
        for visual in robot.links[name].element.all("visual"):
            try:
                mesh = load(visual)
                _paint(mesh, visual, colors)
                parts[owner].append(mesh.apply_transform(frame @ urdf_frame(visual, path.name, name)))
            except Exception as error:  # of any reader of mesh files, on any content
                missing.append((owner, f"{name}: {' '.join(str(error).split())[:120]}"))
        for joint in below.get(name, []):
            moved_by = chain.owners.get(joint.child, owner)
            try:
                todo.append((joint.child, frame @ joint.origin(), moved_by))
            except JaxikError as error:
                missing.append((owner, str(error)))
    if missing:
        _warn(path, [text for _, text in missing])
    if not any(parts):
        return None
    plain = _plain(path, base_link, tip_link) if any(not parts[owner] for owner, _ in missing) else None
    lost = {owner for owner, _ in missing}
    return [_joined(meshes, plain[i] if plain and i in lost else None) for i, meshes in enumerate(parts)]


def _loader(path: Path) -> "Callable[[Element], trimesh.Trimesh]":
    """Return a function that loads the shape of a ``<visual>``, and raises where it cannot."""
    try:
        import trimesh
    except ImportError as error:
        raise MissingExtraError('meshes of a URDF need trimesh: pip install "jaxik[urdf,view]"') from error

    def load(visual: Element) -> "trimesh.Trimesh":
        geometry = visual.first("geometry")
        shape = geometry.children[0] if geometry is not None and geometry.children else None
        if shape is None:
            raise ValueError("a visual without a shape")
        if shape.tag == "mesh":
            return urdf_mesh(shape, path.parent)
        if shape.tag not in _SHAPES:
            raise ValueError(f"no shape <{shape.tag}>")
        values = [urdf_numbers(shape, key, count, shape.tag) for key, count in _SHAPES[shape.tag]]
        if not all(x > 0 for value in values for x in value):
            raise ValueError(f"a {shape.tag} without a size")
        if shape.tag == "box":
            return trimesh.creation.box(values[0])
        if shape.tag == "sphere":
            return trimesh.creation.icosphere(radius=values[0][0])
        (radius,), (height,) = values
        if shape.tag == "cylinder":
            return trimesh.creation.cylinder(radius, height)
        return trimesh.creation.capsule(height, radius)

    return load


def _paint(mesh: "trimesh.Trimesh", visual: Element, colors: dict[str | None, Element]) -> None:
    """Give a mesh the color of its material, unless the file of the mesh has colors."""
    material = visual.first("material")
    if material is None or getattr(mesh.visual, "defined", False):
        return
    color = material.first("color") or (
        colors[material.get("name")].first("color") if material.get("name") in colors else None
    )
    if color is not None and color.get("rgba"):
        rgba = np.clip(urdf_numbers(color, "rgba", 4, "material"), 0, 1)
        mesh.visual.face_colors = np.round(255 * rgba).astype(np.uint8)  # pyright: ignore


def _plain(path: Path, base_link: str, tip_link: str) -> "list[trimesh.Trimesh | None] | None":
    """Return plain links for an arm of the class, else None."""
    from jaxik.view.browser.body import plain_meshes

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", JaxikWarning)  # said where the arm itself was loaded
        try:
            return plain_meshes(Skeleton.of(load_urdf(path, base_link, tip_link).arm))
        except JaxikError:
            return None


def _joined(meshes: "list[trimesh.Trimesh]", plain: "trimesh.Trimesh | None") -> "trimesh.Trimesh | None":
    import trimesh

    return trimesh.util.concatenate(meshes) if meshes else plain  # pyright: ignore


def _warn(path: Path, reasons: list[str]) -> None:
    more = f" and {len(reasons) - _NAMED} more" if len(reasons) > _NAMED else ""
    warnings.warn(
        f"{path.name}: {len(reasons)} shapes cannot be drawn ({'; '.join(reasons[:_NAMED])}{more}); links without any "
        "other are drawn plain",
        JaxikWarning,
        stacklevel=3,
    )
