"""MJCF text of an arm: a chain of hinges, masses, limits and servos."""

from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from jaxik.arm import CONTINUOUS, Arm, ArmModel
from jaxik.kinematics import mass_matrix

VELOCITY_LIMIT = "jaxik_velocity_limit"
"""Name of the numbers in which MJCF, which has no limits of velocity, carries them."""

_UNLIMITED = 1e6  # N m, rad/s: the largest that an arm holds, where nothing is known
_LIGHT = 1e-6  # kg, kg m²: bodies without mass, which MuJoCo does not take, weigh next to nothing
_THICKNESS = 0.04  # of the drawn links' radius to the arm's length


def to_mjcf(model: ArmModel, *, bandwidth: float | None = 20.0) -> str:
    """Return an arm as MJCF, the description that MuJoCo loads.

    Bodies are parallel to the base frame at zero joint angles, which is the world's frame. The site ``tool`` is the
    tool frame. Links are drawn as capsules that touch nothing. Joints have the arm's limits, and one position servo
    each, with its torque limit, that bears the arm's weight by itself, as the controllers of such arms do. Velocity
    limits are kept as numbers for :func:`from_mjcf`, since MuJoCo has none.

    Args:
        model: The arm.
        bandwidth: Bandwidth of the position servos, critically damped at zero joint angles [rad/s]; None for motors
            whose control is the torque, weight included.

    Returns:
        The text; ``mujoco.MjModel.from_xml_string`` loads it.

    Raises:
        ValueError: It is no arm model, or the bandwidth is not positive.

    Example:
        >>> import jaxik
        >>> jaxik.to_mjcf(jaxik.presets.iiwa7()).count("<joint ")
        7
    """
    if not isinstance(model, ArmModel):
        raise ValueError(f"expected a jaxik.ArmModel, which has the names; got {type(model).__name__}")
    if bandwidth is not None and not bandwidth > 0:
        raise ValueError(f"expected a positive bandwidth [rad/s], or None for motors; got {bandwidth}")
    arm, names = model.arm, model.joint_names
    root = Element("mujoco", model=model.name or "arm")
    # Every body has its inertia below; the bound is for those without.
    SubElement(root, "compiler", angle="radian", boundmass=repr(_LIGHT), boundinertia=repr(_LIGHT), autolimits="true")
    SubElement(root, "option", gravity=_text(arm.gravity), integrator="implicitfast")
    numbers = SubElement(SubElement(root, "custom"), "numeric", name=VELOCITY_LIMIT)
    numbers.set("data", _text(arm.velocity_limit))
    _add_bodies(SubElement(root, "worldbody"), arm, names, bandwidth is not None)
    _add_actuators(SubElement(root, "actuator"), arm, names, bandwidth)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _add_bodies(world: Element, arm: Arm, names: tuple[str, ...], weightless: bool) -> None:
    """Add the chain of bodies, one per joint, and the tool's site to the last."""
    stations = np.asarray(arm.stations, np.float64)
    lower, upper = np.asarray(arm.lower, np.float64), np.asarray(arm.upper, np.float64)
    radius = _THICKNESS * float(np.linalg.norm(np.diff(stations, axis=0), axis=1).sum())
    parent, before = world, np.zeros(3)
    for i, (name, at) in enumerate(zip(names, arm.station_of_joint, strict=True)):
        origin = stations[at]
        body = SubElement(parent, "body", name=f"{name}_link", pos=_text(origin - before))
        joint = SubElement(body, "joint", name=name, type="hinge", axis=_text(arm.axes[i]))
        if weightless:
            body.set("gravcomp", "1")
            joint.set("actuatorgravcomp", "true")
        if upper[i] - lower[i] < CONTINUOUS:
            joint.set("range", _text([lower[i], upper[i]]))
        mass = float(arm.links.mass[i])
        inertial = SubElement(body, "inertial", mass=repr(max(mass, _LIGHT)))
        inertial.set("pos", _text(np.asarray(arm.links.center_of_mass[i]) - origin if mass > 0 else np.zeros(3)))
        full = np.asarray(arm.links.inertia[i], np.float64)
        if np.linalg.eigvalsh(full).min() > _LIGHT:
            inertial.set("fullinertia", _text(full[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]))
        else:
            inertial.set("diaginertia", _text([_LIGHT] * 3))
        after = arm.station_of_joint[i + 1] if i + 1 < len(names) else len(stations) - 1
        if np.linalg.norm(stations[after] - origin) > radius / 10:
            ends = _text([*np.zeros(3), *(stations[after] - origin)])
            SubElement(body, "geom", type="capsule", fromto=ends, size=repr(radius), contype="0", conaffinity="0")
        parent, before = body, origin
    rotation = np.asarray(arm.tool_rotation, np.float64)
    tool = _text(np.asarray(arm.tool_position, np.float64) - before)
    SubElement(parent, "site", name="tool", pos=tool, xyaxes=_text([*rotation[:, 0], *rotation[:, 1]]))


def _add_actuators(actuators: Element, arm: Arm, names: tuple[str, ...], bandwidth: float | None) -> None:
    """Add a servo or a motor per joint."""
    torque = np.asarray(arm.torque_limit, np.float64)
    inertia = np.diagonal(np.asarray(mass_matrix(arm, np.zeros(arm.n_joints)), np.float64))
    for i, name in enumerate(names):
        if bandwidth is None:
            actuator = SubElement(actuators, "motor", name=name, joint=name)
        else:
            turned = max(float(inertia[i]), _LIGHT)
            actuator = SubElement(actuators, "position", name=name, joint=name, kp=repr(turned * bandwidth**2))
            actuator.set("kv", repr(2 * turned * bandwidth))
        if torque[i] < _UNLIMITED:
            actuator.set("forcerange", _text([-torque[i], torque[i]]))


def _text(numbers: object) -> str:
    return " ".join(repr(float(x)) for x in np.asarray(numbers, np.float64))
