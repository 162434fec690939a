"""Worlds from files: spheres, boxes, capsules and half-spaces in JSON, and clouds of points."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from jaxik.atomic_file import write_atomically
from jaxik.errors import FileFormatError
from jaxik.obstacles.covers import LARGEST, Cover, box_cover, capsule_cover, joined, sphere_cover
from jaxik.obstacles.world import World
from jaxik.tables import decoded, divided, number

OVERHANG = 0.02
"""Largest distance [m] that spheres reach beyond the boxes and capsules of a file, unless it says otherwise."""

_SHAPES = {
    "spheres": {"center": 3, "radius": 1},
    "boxes": {"center": 3, "size": 3},
    "capsules": {"from": 3, "to": 3, "radius": 1},
    "half_spaces": {"normal": 3, "offset": 1},
}
_LEAST = 1e-6  # m; an overhang or a normal below it is no length


def load_world(
    file: str | os.PathLike[str], *, radius: float = 0.02, voxel: float | None = None, overhang: float | None = None
) -> World:
    """Load a world: shapes from JSON, or points from a table or an array.

    A ``.json`` file holds lists of shapes in meters, each of which may be left out: ``{"spheres": [{"center": [x, y,
    z], "radius": r}], "boxes": [{"center": ..., "size": [x, y, z], "rpy": [roll, pitch, yaw]}], "capsules": [{"from":
    ..., "to": ..., "radius": r}], "half_spaces": [{"normal": ..., "offset": d}], "overhang": 0.02}``; ``rpy`` [rad] may
    be left out. A half-space ``normal · x <= offset`` is free. Boxes and capsules are covered by spheres.

    A ``.csv``, ``.txt`` or ``.xyz`` file holds a point in the first three columns of each row, and a radius in the
    fourth if there is one; an ``.npy`` file an array ``(points, 3 or 4)``.

    Args:
        file: File name.
        radius: Radius of points that have none [m].
        voxel: Edge of cells that are filled by one sphere about all of their points [m]; None keeps all points.
        overhang: Largest distance that spheres may reach beyond boxes and capsules [m]; None for the file's own.

    Returns:
        The world.

    Raises:
        FileFormatError: It is not what its ending says, or a shape lacks a number.
        OSError: The file cannot be opened.
    """
    path = Path(file)
    if path.suffix.lower() == ".json":
        return _of_shapes(path, overhang)
    return points_world(_points(path), radius, voxel)


def save_world(world: World, file: str | os.PathLike[str]) -> None:
    """Save a world that does not move as JSON.

    Args:
        world: The world.
        file: File name; complete or absent, whatever happens.

    Raises:
        ValueError: The world moves.
    """
    if world.moving:
        raise ValueError(f"only a world without batch axes can be saved; got {world.batch}")
    arrays = [np.asarray(x, float) for x in world.tree_flatten()[0]]
    real = arrays[1] >= 0
    content = {
        "spheres": [
            {"center": c.tolist(), "radius": float(r)} for c, r in zip(arrays[0][real], arrays[1][real], strict=True)
        ],
        "half_spaces": [{"normal": n.tolist(), "offset": float(d)} for n, d in zip(arrays[2], arrays[3], strict=True)],
    }
    write_atomically(file, json.dumps(content, indent=1))


def points_world(points: np.ndarray, radius: float, voxel: float | None) -> World:
    """Return a sphere per point ``(n, 3 or 4)``, or one per filled cell."""
    radii = points[:, 3] if points.shape[1] == 4 else np.full(len(points), radius)
    centers = points[:, :3]
    if voxel is None:
        return World(centers, radii)
    if not voxel > 0:
        raise ValueError(f"voxel is the edge of a cell, above 0 m; got {voxel!r}")
    _, cell = np.unique(np.floor(centers / voxel).astype(np.int64), axis=0, return_inverse=True)
    cell = cell.ravel()
    low, high = (np.full((cell.max(initial=-1) + 1, 3), x) for x in (np.inf, -np.inf))
    np.minimum.at(low, cell, centers)
    np.maximum.at(high, cell, centers)
    middle = (low + high) / 2
    needed = np.linalg.norm(centers - middle[cell], axis=-1) + radii
    largest = np.zeros(len(middle))
    np.maximum.at(largest, cell, needed)
    return World(middle, largest)


def _points(path: Path) -> np.ndarray:
    if path.suffix.lower() == ".npy":
        try:
            points = np.asarray(np.load(path, allow_pickle=False), float)
        except ValueError as error:
            raise FileFormatError(f"{path.name}: no array of numbers: {str(error)[:120]}") from None
    elif path.suffix.lower() in (".csv", ".txt", ".xyz"):
        points = _table(path)
    else:
        raise FileFormatError(f"{path.name}: expected .json, .csv, .txt, .xyz or .npy")
    if points.ndim != 2 or points.shape[1] not in (3, 4):
        raise FileFormatError(f"{path.name}: expected points (n, 3), or (n, 4) with radii; got {points.shape}")
    if not (np.abs(points) <= LARGEST).all():
        raise FileFormatError(
            f"{path.name}: expected finite numbers, in meters; got one that is not, or above {LARGEST:g}"
        )
    return points


def _table(path: Path) -> np.ndarray:
    try:
        divider, rows = divided(decoded(path.read_bytes()))
    except ValueError as error:
        raise FileFormatError(f"{path.name}: {error}") from None
    found: list[list[float]] = []
    for row in rows:
        cells = row.cells[:4] if len(row.cells) > 1 else row.cells[0].split()[:4] if row.cells else []
        try:
            found.append([number(cell, divider) for cell in cells])
        except ValueError:
            if found:
                raise FileFormatError(f"{path.name}, line {row.number}: expected three or four numbers") from None
    if not found or len({len(row) for row in found}) > 1:
        raise FileFormatError(f"{path.name}: expected rows of three or four numbers each")
    return np.array(found, float)


def _of_shapes(path: Path, overhang: float | None) -> World:
    try:
        content = json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        raise FileFormatError(f"{path.name}: not valid JSON: {str(error)[:120]}") from None
    if not isinstance(content, dict):
        raise FileFormatError(f"{path.name}: expected an object with {', '.join(_SHAPES)}")
    if unknown := ", ".join(sorted(set(content) - {*_SHAPES, "overhang"})):
        raise FileFormatError(f"{path.name}: unknown {unknown[:80]}; known are {', '.join(_SHAPES)}")
    given = content.get("overhang", OVERHANG) if overhang is None else overhang
    allowed = _number(given, 1)
    if allowed is None or not allowed >= _LEAST:
        raise FileFormatError(f"{path.name}: overhang is a distance of at least {_LEAST:g} m; got {given!r:.80}")
    for kind in _SHAPES:
        if not isinstance(content.get(kind, []), list):
            raise FileFormatError(f"{path.name}: {kind} needs a list of shapes; got {content[kind]!r:.80}")
    shapes = {kind: [_numbers(path, kind, i, s) for i, s in enumerate(content.get(kind, []))] for kind in _SHAPES}
    covers = [sphere_cover(s["radius"]).placed(_frame(s["center"])) for s in shapes["spheres"]]
    overhang = float(allowed)
    covers += _covered(path, shapes["boxes"], lambda s: _box(s, overhang))
    covers += _covered(
        path, shapes["capsules"], lambda s: capsule_cover(s["from"], s["to"], abs(s["radius"]), overhang)
    )
    cover = joined(covers)
    normals = np.array([s["normal"] for s in shapes["half_spaces"]]).reshape(-1, 3)
    offsets = np.array([s["offset"] for s in shapes["half_spaces"]])
    length = np.linalg.norm(normals, axis=-1)
    if not (length >= _LEAST).all():
        raise FileFormatError(f"{path.name}: half_spaces {int(np.argmin(length))} has a normal without length")
    return World(cover.centers, cover.radii, normals / length[:, None], offsets / length)


def _covered(path: Path, shapes: list[dict[str, Any]], cover: Callable[[dict[str, Any]], Cover]) -> list[Cover]:
    try:
        return [cover(shape) for shape in shapes]
    except ValueError as error:
        raise FileFormatError(f"{path.name}: {error}") from None


def _box(shape: dict[str, Any], overhang: float) -> Cover:
    return box_cover(np.abs(shape["size"]), overhang).placed(_frame(shape["center"], shape.get("rpy")))


def _frame(center: np.ndarray, rpy: np.ndarray | None = None) -> np.ndarray:
    frame = np.eye(4)
    frame[:3, 3] = center
    if rpy is not None:
        (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
        x, y, z = ([[1, 0, 0], [0, cr, -sr], [0, sr, cr]], [[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]],
                   [[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])  # fmt: skip
        frame[:3, :3] = np.array(z) @ y @ x
    return frame


def _numbers(path: Path, kind: str, index: int, shape: Any) -> dict[str, Any]:
    """Numbers of a shape, checked."""
    wanted = dict(_SHAPES[kind])
    if isinstance(shape, dict) and "rpy" in shape and kind == "boxes":
        wanted["rpy"] = 3
    found = {}
    for name, count in wanted.items():
        value = _number(shape.get(name), count) if isinstance(shape, dict) else None
        if value is None:
            needs = "a number" if count == 1 else "three numbers"
            raise FileFormatError(f"{path.name}: {kind} {index} needs {name}, {needs}; got {shape!r:.80}")
        found[name] = float(value) if count == 1 else value
    return found


def _number(value: Any, count: int) -> np.ndarray | None:
    """A number, or so many, of JSON; None for anything else."""
    if not isinstance(value, int | float | list):
        return None
    try:
        found = np.array(value, float)
    except (TypeError, ValueError, OverflowError):
        return None
    fits = found.shape == (() if count == 1 else (count,)) and (np.abs(found) <= LARGEST).all()
    return found if fits else None
