"""Numbers of a URDF file that look as if they were in degrees or millimeters."""

import math

import numpy as np

from jaxik.arm.urdf_chain import Chain
from jaxik.arm.urdf_file import UrdfJoint, urdf_numbers

_MANY_TURNS, _NO_LIMIT = 4.5 * math.pi, 720.0
"""Between more than two turns and 720, limits are rather degrees; robots with more turns, and "none", lie outside."""

_TURN = 2 * math.pi + 0.01
"""Angles of an origin beyond a turn are rather degrees."""

_LONG = 10.0
"""Links longer than this [m] are rather millimeters: 10 mm is the shortest, and cranes are rare."""


def unit_problems(chain: Chain) -> list[str]:
    """Return one sentence per kind of number that seems to have a wrong unit, with the joints and values.

    Args:
        chain: The chain; its numbers are well-formed.
    """
    limits, angles, lengths = [], [], []
    for joint in chain.joints:
        low, high = joint.limit("lower") or 0.0, joint.limit("upper") or 0.0
        if joint.type == "revolute" and _MANY_TURNS < max(abs(low), abs(high)) <= _NO_LIMIT:
            limits.append(f"{joint.name} ({low:g} to {high:g})")
        if any(abs(angle) > _TURN for angle in _angles(joint)):
            angles.append(f"{joint.name} ({' '.join(f'{angle:g}' for angle in _angles(joint))})")
        if (length := float(np.linalg.norm(joint.origin()[:3, 3]))) > _LONG:
            lengths.append(f"{joint.name} ({length:g} m)")
    found = []
    if limits:
        found.append(f"the limits of {', '.join(limits)} look like degrees; URDF has radians")
    if angles:
        found.append(f"the origin rpy of {', '.join(angles)} looks like degrees; URDF has radians")
    if lengths:
        found.append(f"the origin xyz of {', '.join(lengths)} looks like millimeters; URDF has meters")
    return found


def _angles(joint: UrdfJoint) -> list[float]:
    origin = joint.element.first("origin")
    return [] if origin is None or origin.get("rpy") is None else urdf_numbers(origin, "rpy", 3, joint.name)
