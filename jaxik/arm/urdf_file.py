"""URDF files: links and joints as written.

Only what kinematics needs is read, and its numbers when they are asked for: shapes, sensors, transmissions and whatever
else an author added can neither be wrong nor stop the reading.
"""

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from jaxik.arm.urdf_xml import Element, read_xml
from jaxik.errors import FileFormatError

XACRO_MARK = re.compile(r"\$[{(]|<xacro:|</xacro:")

_LONGEST_NAME = 200  # characters
_LONGEST = 1000  # characters of an attribute with numbers
_LARGEST = 1e9  # m, kg, kg m²: squares of products of lengths remain far inside float64, and inside float32


@dataclass(frozen=True)
class UrdfLink:
    """A link.

    Attributes:
        name: Its name.
        element: Its XML element.
        file: Name of the file.
    """

    name: str
    element: Element
    file: str

    def body(self) -> tuple[float, np.ndarray, np.ndarray] | None:
        """Return mass [kg], frame of the center of mass ``(4, 4)`` and inertia in that frame ``(3, 3)`` [kg m²].

        Returns:
            None for a link without mass.

        Raises:
            FileFormatError: A number is malformed, or the mass is negative.
        """
        inertial = self.element.first("inertial")
        mass = None if inertial is None else inertial.first("mass")
        if inertial is None or mass is None:
            return None
        value = self._number(mass, "value")
        if value < 0:
            raise FileFormatError(
                f"{self.file}, line {mass.line}: link {self.name} has a negative mass, {value:g} kg; "
                f"give it a positive one or remove its <inertial>"
            )
        if value == 0:
            return None
        tensor = np.zeros((3, 3))
        if (inertia := inertial.first("inertia")) is not None:
            for i, j, key in ((0, 0, "ixx"), (0, 1, "ixy"), (0, 2, "ixz"), (1, 1, "iyy"), (1, 2, "iyz"), (2, 2, "izz")):
                tensor[i, j] = tensor[j, i] = self._number(inertia, key)
        return value, urdf_frame(inertial, self.file, f"link {self.name}"), tensor

    def _number(self, element: Element, key: str) -> float:
        if element.get(key) is None:
            return 0.0
        return urdf_numbers(element, key, 1, f"{self.file}, line {element.line}: link {self.name}")[0]


@dataclass(frozen=True)
class UrdfJoint:
    """A joint.

    Attributes:
        name: Its name; may be empty off the chain.
        type: Its type, such as ``"revolute"``.
        parent: Name of the parent link.
        child: Name of the child link.
        element: Its XML element.
        file: Name of the file.
    """

    name: str
    type: str
    parent: str
    child: str
    element: Element
    file: str

    @property
    def turns(self) -> bool:
        """True for a joint that turns on its own."""
        return self.type in ("revolute", "continuous") and self.mimics is None

    @property
    def mimics(self) -> str | None:
        """Name of the joint that it follows, or None."""
        mimic = self.element.first("mimic")
        return None if mimic is None else mimic.get("joint") or "another joint"

    def origin(self) -> np.ndarray:
        """Return the frame at zero in the parent link, ``(4, 4)``."""
        return urdf_frame(self.element, self.file, self.name)

    def axis(self) -> np.ndarray:
        """Return the unit axis in the joint's frame, ``(3,)``."""
        element = self.element.first("axis")
        if element is None or element.get("xyz") is None:
            return np.array([1.0, 0.0, 0.0])
        axis = np.array(urdf_numbers(element, "xyz", 3, f"{self.file}, line {element.line}: {self.name}"))
        length = float(np.linalg.norm(axis))
        if not length > 1e-9:  # rounded zeros
            raise FileFormatError(
                f"{self.file}, line {element.line}: joint {self.name} has the axis "
                f"{(element.get('xyz') or '')[:80]}, which has no direction"
            )
        return axis / length

    def limit(self, key: str) -> float | None:
        """Return ``lower``, ``upper``, ``velocity`` or ``effort``, None where the file gives none; may be infinite."""
        element = self.element.first("limit")
        if element is None or element.get(key) is None:
            return None
        return urdf_numbers(element, key, 1, f"{self.file}, line {element.line}: {self.name}", infinite=True)[0]


@dataclass(frozen=True)
class UrdfRobot:
    """Content of a URDF file.

    Attributes:
        name: Name of the robot; that of the file where it gives none.
        links: Links by name.
        joints: Joints in the order of the file.
        root: Root element.
        xacro: True if macros of xacro are left in the file.
    """

    name: str
    links: dict[str, UrdfLink]
    joints: tuple[UrdfJoint, ...]
    root: Element
    xacro: bool


def read_robot(path: Path) -> UrdfRobot:
    """Return links and joints of a URDF file.

    Args:
        path: The file.

    Raises:
        OSError: The file cannot be opened.
        FileFormatError: It is no URDF, has a name twice, or a joint without links; names the line.
    """
    root, text = read_xml(path)
    if root.tag != "robot":
        raise FileFormatError(f"{path}, line {root.line}: expected <robot>, found <{root.tag}>")
    xacro = XACRO_MARK.search(text) is not None
    file = str(path)
    links: dict[str, UrdfLink] = {}
    for element in root.all("link"):
        if name := element.get("name"):
            _once(name, element, links, file)
            links[name] = UrdfLink(name, element, file)
    joints: dict[str, UrdfJoint] = {}
    for i, element in enumerate(root.all("joint")):
        name = element.get("name") or ""
        _once(name, element, joints, file)
        ends = [end.get("link") if (end := element.first(tag)) is not None else None for tag in ("parent", "child")]
        for tag, link in zip(("parent", "child"), ends, strict=True):
            if not link:
                raise FileFormatError(f"{path}, line {element.line}: joint {name} has no {tag} link")
        parent, child = (str(link)[: _LONGEST_NAME + 1] for link in ends)  # links have no longer names
        joints[name or f"\0{i}"] = UrdfJoint(name, element.get("type") or "", parent, child, element, file)
    if not links:
        advice = f"this is a xacro file; expand it first: xacro {path.name} > arm.urdf" if xacro else "expected <link>"
        raise FileFormatError(f"{path}, line {root.line}: the robot has no links; {advice}")
    return UrdfRobot(root.get("name") or path.stem, links, tuple(joints.values()), root, xacro)


def _once(name: str, element: Element, known: dict[str, UrdfLink] | dict[str, UrdfJoint], file: str) -> None:
    """Raise if a name is given twice, since it cannot be known which is meant, or is longer than a message may be."""
    if len(name) > _LONGEST_NAME:
        raise FileFormatError(
            f"{file}, line {element.line}: a {element.tag} has a name of {len(name)} characters, {name[:40]}...; "
            f"use at most {_LONGEST_NAME}"
        )
    if name in known:
        raise FileFormatError(
            f"{file}, line {element.line}: a second {element.tag} {name}, the first is on line "
            f"{known[name].element.line}; rename or remove one"
        )


def urdf_frame(element: Element, file: str, name: str) -> np.ndarray:
    """Return the frame that the ``<origin>`` inside an element describes, ``(4, 4)``; the identity without one.

    Args:
        element: The element.
        file: Name of the file, for messages.
        name: Name of the link or joint.

    Raises:
        FileFormatError: A number is malformed.
    """
    matrix = np.eye(4)
    origin = element.first("origin")
    if origin is None:
        return matrix
    where = f"{file}, line {origin.line}: {name}"
    if origin.get("xyz") is not None:
        matrix[:3, 3] = urdf_numbers(origin, "xyz", 3, where)
    if origin.get("rpy") is not None:
        matrix[:3, :3] = _from_angles(*urdf_numbers(origin, "rpy", 3, where))
    elif origin.get("quat_xyzw") is not None:  # URDF 1.2
        quaternion = np.array(urdf_numbers(origin, "quat_xyzw", 4, where))
        if not abs(np.linalg.norm(quaternion) - 1) < 1e-3:
            raise FileFormatError(f'{where}: origin quat_xyzw="{origin.get("quat_xyzw")}" should be a unit quaternion')
        matrix[:3, :3] = _from_quaternion(*(quaternion / np.linalg.norm(quaternion)))
    return matrix


def urdf_numbers(element: Element, key: str, count: int, where: str, *, infinite: bool = False) -> list[float]:
    """Return the numbers of an attribute, separated by spaces or commas.

    Args:
        element: The element.
        key: Name of the attribute.
        count: Number of numbers expected.
        where: Start of the message.
        infinite: Accept infinity, as limits use it for "none".

    Raises:
        FileFormatError: They are not that many finite numbers.
    """
    text = (element.get(key) or "")[:_LONGEST]
    words = re.sub(r"\s*,(\s+|$)", " ", text).split()
    if len(words) == 1:
        words = words[0].split(",")
    try:
        values = [float(word) for word in words if "_" not in word]
    except ValueError:
        values = []
    if len(values) == count == len(words) and all(
        abs(x) <= _LARGEST or (infinite and not math.isnan(x)) for x in values
    ):
        return values
    expected = f"{count} finite numbers" if count > 1 else "a number"
    advice = "; this is a xacro expression, expand the file first: xacro FILE > arm.urdf" if "${" in text else ""
    raise FileFormatError(f'{where}: {element.tag} {key}="{text[:80]}" should be {expected}{advice}')


def _from_angles(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Rotation about the fixed axes x, y, z in turn."""
    (cr, cp, cy), (sr, sp, sy) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _from_quaternion(x: float, y: float, z: float, w: float) -> np.ndarray:
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
