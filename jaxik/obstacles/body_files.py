"""Bodies from files: the collision shapes of a URDF, and cuRobo's spheres."""

import os
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxik.arm import Element, chain_between, children_of, read_robot, urdf_frame, urdf_mesh, urdf_numbers
from jaxik.errors import ArmClassError, FileFormatError, MissingExtraError
from jaxik.obstacles.body import Body
from jaxik.obstacles.covers import LARGEST, Cover, box_cover, capsule_cover, cylinder_cover, joined, sphere_cover
from jaxik.obstacles.hull_cover import hull_cover
from jaxik.ros_text import parse_yaml

File = str | os.PathLike[str]


class _Link(NamedTuple):
    """A link that an arm carries: its name, element and frame at zero, and the number of joints that move it."""

    name: str
    element: Element
    frame: np.ndarray
    moved_by: int


def body_of_urdf(file: File, base_link: str, tip_link: str, overhang: float, skip_meshes: bool) -> Body:
    """Return the body of :meth:`jaxik.Body.from_urdf`."""
    path = Path(file)
    numbers, covers, skipped, hulls = [], [], 0, 0
    for link in _links(path, base_link, tip_link):
        for number, collision in enumerate(link.element.all("collision")):
            where = f"{path.name}, line {collision.line}: collision {number} of link {link.name}"
            try:
                shape = _shape(collision, where)
                if shape.tag == "mesh" and skip_meshes:
                    skipped += 1
                    continue
                hulls += shape.tag == "mesh"
                cover = _cover(shape, where, path.parent, overhang)
            except FileFormatError:
                raise
            except ValueError as error:
                raise FileFormatError(f"{where}: {error}") from None
            placed = cover.placed(link.frame @ urdf_frame(collision, str(path), link.name))
            covers.append(placed)
            numbers += [link.moved_by] * len(placed.radii)
    if not covers:
        meshes = "; its meshes were skipped" if skipped else ""
        raise FileFormatError(f"{path.name}: no collision shapes between {base_link} and {tip_link}{meshes}")
    cover = joined(covers)
    notes = (f"Body: {len(numbers)} spheres cover the collision shapes of {path.name}, and reach "
             f"{1e3 * cover.overhang:.1f} mm beyond them at most.",)  # fmt: skip
    notes += (f"Body: {hulls} meshes of {path.name} count as their convex hulls.",) if hulls else ()
    notes += (f"Body: {skipped} meshes of {path.name} were left out.",) if skipped else ()
    return Body(numbers, cover.centers, cover.radii).noted(notes)


def body_of_yaml(file: File, urdf: File, base_link: str, tip_link: str) -> Body:
    """Return the body of :meth:`jaxik.Body.from_yaml`."""
    path = Path(file)
    try:
        content = parse_yaml(path.read_bytes().decode())
    except (FileFormatError, UnicodeDecodeError) as error:
        raise FileFormatError(f"{path.name}: {error}") from None
    found = _find(content, "collision_spheres")
    if not isinstance(found, dict):
        named = f"; they are in {found:.80}: give that file" if isinstance(found, str) else ""
        raise FileFormatError(f"{path.name}: expected collision_spheres with a list of spheres per link{named}")
    links = {link.name: link for link in _links(Path(urdf), base_link, tip_link)}
    numbers, centers, radii, owners = [], [], [], []
    for name, spheres in found.items():
        if name not in links:
            continue
        if not isinstance(spheres, list | None):
            raise FileFormatError(f"{path.name}: expected a list of spheres for link {name}; got {spheres!r:.80}")
        for number, sphere in enumerate(spheres or ()):
            center, radius = _sphere(sphere, f"{path.name}: sphere {number} of link {name}")
            frame = links[name].frame
            centers.append(frame[:3, :3] @ center + frame[:3, 3])
            radii.append(radius)
            numbers.append(links[name].moved_by)
            owners.append(name)
    if not centers:
        raise FileFormatError(
            f"{path.name}: none of its links ({', '.join(map(str, found))[:200]}) is between {base_link} and {tip_link}"
        )
    ignored = _find(content, "self_collision_ignore")
    return Body(numbers, np.array(centers), np.array(radii), _pairs(owners, numbers, ignored))


def _links(path: Path, base_link: str, tip_link: str) -> Iterator[_Link]:
    """Links of the chain and those that it carries, in the base frame, joints off the chain at zero."""
    robot = read_robot(path)
    try:
        chain, below = chain_between(robot, base_link, tip_link), children_of(robot)
    except ArmClassError as error:
        raise ArmClassError(f"{path.name}: {error}") from None
    except ValueError as error:
        raise ValueError(f"{path.name}: {error}") from None
    todo, visited = [(chain.base, np.eye(4), 0)], set()
    while todo:
        name, frame, owner = todo.pop()
        if name in visited or name not in robot.links:
            continue
        visited.add(name)
        yield _Link(name, robot.links[name].element, frame, owner)
        for joint in below.get(name, []):
            todo.append((joint.child, frame @ joint.origin(), chain.owners.get(joint.child, owner)))


def _shape(collision: Element, where: str) -> Element:
    """The element of a collision shape."""
    geometry = collision.first("geometry")
    for kind in ("sphere", "box", "cylinder", "capsule", "mesh"):
        shape = None if geometry is None else geometry.first(kind)
        if shape is not None:
            return shape
    raise FileFormatError(f"{where} has no sphere, box, cylinder, capsule or mesh")


def _cover(shape: Element, where: str, folder: Path, overhang: float) -> Cover:
    """The spheres over a collision shape in its frame."""
    if shape.tag == "mesh":
        try:
            corners = urdf_mesh(shape, folder).vertices
        except MissingExtraError:
            raise
        except Exception as error:  # of any reader of mesh files, on any content
            reason = " ".join(str(error).split())[:120]
            raise FileFormatError(
                f"{where} is a mesh that cannot be read ({reason}); leave meshes out with skip_meshes=True"
            ) from None
        return hull_cover(corners, overhang)
    if shape.tag == "box":
        return box_cover(np.abs(urdf_numbers(shape, "size", 3, where)), overhang)
    radius = abs(urdf_numbers(shape, "radius", 1, where)[0])
    if shape.tag == "sphere":
        return sphere_cover(radius)
    length = abs(urdf_numbers(shape, "length", 1, where)[0])
    if shape.tag == "cylinder":
        return cylinder_cover(radius, length, overhang)
    half = np.array([0.0, 0.0, length / 2])
    return capsule_cover(-half, half, radius, overhang)


def _find(content: Any, key: str) -> Any:
    """The first value of a key anywhere in nested dictionaries, which may hold one another, or None."""
    todo, seen = [content], set()
    while todo:
        inner = todo.pop()
        if not isinstance(inner, dict) or id(inner) in seen:
            continue
        if inner.get(key) is not None:
            return inner[key]
        seen.add(id(inner))
        todo += reversed(list(inner.values()))
    return None


def _sphere(sphere: Any, where: str) -> tuple[np.ndarray, float]:
    try:
        center, radius = np.array(sphere["center"], float), float(sphere["radius"])
    except (TypeError, KeyError, ValueError, OverflowError, IndexError):
        raise FileFormatError(f"{where} needs a center of three numbers and a radius; got {sphere!r:.80}") from None
    if center.shape != (3,) or not (np.abs([*center, radius]) <= LARGEST).all():
        raise FileFormatError(f"{where} needs a center of three numbers and a radius; got {sphere!r:.80}")
    return center, radius


def _pairs(owners: list[str], numbers: list[int], ignored: Any) -> list[tuple[int, int]] | None:
    """Pairs of spheres of different links that the file does not ignore; None where it ignores none."""
    if not isinstance(ignored, dict):
        return None
    lists = ((name, others) for name, others in ignored.items() if isinstance(others, list))
    skipped = {frozenset((name, str(other))) for name, others in lists for other in others}
    return [
        (i, j)
        for i, j in combinations(range(len(owners)), 2)
        if numbers[i] != numbers[j] and frozenset((owners[i], owners[j])) not in skipped
    ]
