"""URDF files read with yourdfpy, after a check that names the wrong line."""

from pathlib import Path
from typing import Any

import numpy as np

from jaxik.errors import FileFormatError, MissingExtraError

_TRIPLES = {"origin": ("xyz", "rpy"), "axis": ("xyz",)}
_SCALARS = {
    "limit": ("lower", "upper", "velocity", "effort"),
    "mass": ("value",),
    "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
}


def read_robot(path: Path) -> Any:
    """Return the file's ``yourdfpy.Robot``: links and joints as written, without meshes.

    Raises:
        OSError: If the file cannot be opened.
        FileFormatError: If the file is no URDF, or a number of a joint or link is malformed.
        MissingExtraError: If yourdfpy is not installed.
    """
    try:
        import yourdfpy
        from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]
    except ImportError as error:
        raise MissingExtraError('reading URDF files needs yourdfpy: pip install "jaxik[urdf]"') from error
    with path.open("rb"):  # raises the usual OSError for a missing file
        pass
    try:
        root = etree.parse(str(path)).getroot()
    except etree.XMLSyntaxError as error:
        raise FileFormatError(f"{path}, line {error.lineno}: not well-formed XML: {error.msg}") from None
    _check(root, path)
    try:
        return yourdfpy.URDF.load(str(path), build_scene_graph=False, load_meshes=False).robot
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        # Shapes, materials and the like, which the check above does not cover and yourdfpy reads as well.
        raise FileFormatError(f"{path}: yourdfpy cannot read it: {error!r}") from None


def _check(root: Any, path: Path) -> None:
    """Raise FileFormatError with the line unless joints and links are complete and their numbers finite."""
    if root.tag != "robot":
        raise FileFormatError(f"{path}, line {root.sourceline}: expected <robot>, found <{root.tag}>")
    for element in root.iter():
        if isinstance(element.tag, str) and "xacro" in element.tag:
            raise FileFormatError(
                f"{path}, line {element.sourceline}: this is a xacro file; expand it first: "
                f"xacro {path.name} > arm.urdf"
            )
    if root.get("name") is None:
        raise FileFormatError(f"{path}, line {root.sourceline}: <robot> has no name")
    for part in (*root.findall("joint"), *root.findall("link")):
        where = f"{path}, line {part.sourceline}"
        if not part.get("name"):
            raise FileFormatError(f"{where}: <{part.tag}> has no name")
        if part.tag == "joint":
            _check_joint(part, where)
        for element in (*part, *part.findall("inertial/*")):
            for names, count in ((_TRIPLES, 3), (_SCALARS, 1)):
                for key in names.get(element.tag, ()) if isinstance(element.tag, str) else ():
                    _check_numbers(element, key, count, f"{path}, line {element.sourceline}: {part.get('name')}")


def _check_joint(joint: Any, where: str) -> None:
    name = joint.get("name")
    if not joint.get("type"):
        raise FileFormatError(f"{where}: joint {name} has no type")
    for end in ("parent", "child"):
        element = joint.find(end)
        if element is None or not element.get("link"):
            raise FileFormatError(f"{where}: joint {name} has no {end} link")
    axis = joint.find("axis")  # many files give fixed joints an axis of zeros, which does no harm
    if joint.get("type") != "fixed" and axis is not None and axis.get("xyz") and not axis.get("xyz").strip("0. \t-"):
        raise FileFormatError(f"{where}: joint {name} has the axis {axis.get('xyz')}, which has no direction")


def _check_numbers(element: Any, key: str, count: int, where: str) -> None:
    text = element.get(key)
    if text is None:
        return
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    # Infinite limits are one way to write "none".
    if len(values) != count or not (element.tag == "limit" or np.isfinite(values).all()) or np.isnan(values).any():
        expected = f"{count} finite numbers" if count > 1 else "a number"
        raise FileFormatError(f'{where}: {element.tag} {key}="{text}" should be {expected}')
