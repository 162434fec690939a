"""Mesh files of a URDF."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxik.arm.urdf_file import urdf_numbers
from jaxik.arm.urdf_xml import Element
from jaxik.errors import MissingExtraError

if TYPE_CHECKING:
    import trimesh


def urdf_mesh(shape: Element, folder: Path) -> "trimesh.Trimesh":
    """Load the file of a ``<mesh>`` and scale it.

    Args:
        shape: The element.
        folder: Folder of the URDF file, relative to which mesh files are found, ``package://`` included.

    Raises:
        MissingExtraError: trimesh is not installed.
        FileNotFoundError: There is no such file.
        ValueError: The mesh has no faces. A damaged file raises whatever its reader raises.
    """
    try:
        import trimesh
    except ImportError as error:
        raise MissingExtraError('meshes of a URDF need trimesh: pip install "jaxik[urdf]"') from error
    mesh: Any = trimesh.load(_mesh_file(shape.get("filename") or "", folder), force="mesh")
    if not len(mesh.faces):
        raise ValueError(f"the mesh file {shape.get('filename')} has no faces")
    if shape.get("scale") is not None:
        mesh.apply_scale(urdf_numbers(shape, "scale", len((shape.get("scale") or "").split()), "mesh"))
    return mesh


def _mesh_file(name: str, folder: Path) -> Path:
    """Return the file of a mesh, whose package is a folder above the URDF file or beside one of those."""
    plain = Path(re.sub(r"^(package|model|file)://", "", name))
    tails = [plain, Path(*plain.parts[1:])] if "://" in name else [plain]
    for start in (folder, *folder.resolve().parents):
        for tail in tails:
            if (start / tail).is_file():
                return start / tail
    raise FileNotFoundError(f"no mesh file {name}")
