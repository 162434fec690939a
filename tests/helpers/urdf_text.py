"""URDF texts for tests: the two KUKA arms from their published joint origins, and small chains to break."""

import re
from math import pi

# Per arm: origins of joints 1-7 and the flange in their parents (xyz [m], rpy [rad]), as IFL-CAMP/iiwa_stack has them.
_TURNS = [
    (0, 0, 0),
    (pi / 2, 0, pi),
    (pi / 2, 0, pi),
    (pi / 2, 0, 0),
    (-pi / 2, pi, 0),
    (pi / 2, 0, 0),
    (-pi / 2, pi, 0),
    (pi, pi, pi),
]
_IIWA7 = [
    (0, 0, 0.15),
    (0, 0, 0.19),
    (0, 0.21, 0),
    (0, 0, 0.19),
    (0, 0.21, 0),
    (0, 0.0607, 0.19),
    (0, 0.081, 0.0607),
    (0, 0, 0.045),
]
_IIWA14 = [
    (0, 0, 0.1575),
    (0, 0, 0.2025),
    (0, 0.2045, 0),
    (0, 0, 0.2155),
    (0, 0.1845, 0),
    (0, 0, 0.2155),
    (0, 0.081, 0),
    (0, 0, 0.045),
]
# Link frame masses: kg, center [m], principal inertia [kg m²].
_BODIES7 = [
    (4, (0, -0.03, 0.12), (0.1, 0.09, 0.02)),
    (4, (0.0003, 0.059, 0.042), (0.05, 0.018, 0.044)),
    (3, (0, 0.03, 0.13), (0.08, 0.075, 0.01)),
    (2.7, (0, 0.067, 0.034), (0.03, 0.01, 0.029)),
    (1.7, (0.0001, 0.021, 0.076), (0.02, 0.018, 0.005)),
    (1.8, (0, 0.0006, 0.0004), (0.005, 0.0036, 0.0047)),
    (0.3, (0, 0, 0.02), (0.001, 0.001, 0.001)),
]
_BODIES14 = [
    (5.76, (0, -0.03, 0.12), (0.033, 0.0333, 0.0123)),
    (6.35, (0.0003, 0.059, 0.042), (0.0305, 0.0304, 0.011)),
    (3.5, (0, 0.03, 0.13), (0.025, 0.0238, 0.0076)),
    (3.5, (0, 0.067, 0.034), (0.017, 0.0164, 0.006)),
    (3.5, (0.0001, 0.021, 0.076), (0.01, 0.0087, 0.00449)),
    (1.8, (0, 0.0006, 0.0004), (0.0049, 0.0047, 0.0036)),
    (1.2, (0, 0, 0.02), (0.001, 0.001, 0.001)),
]
LIMITS_DEG = (170, 120, 170, 120, 170, 120, 175)


def iiwa_urdf(size: int, digits: int = 17) -> str:
    """URDF of the KUKA LBR iiwa 7 or 14 from link_0 to flange; angles printed with so many digits."""
    origins, bodies = (_IIWA7, _BODIES7) if size == 7 else (_IIWA14, _BODIES14)
    parts = [link("link_0")]
    for i in range(7):
        parts.append(link(f"link_{i + 1}", *bodies[i]))
        limit = LIMITS_DEG[i] * pi / 180
        parts.append(
            joint(
                f"joint_{i + 1}",
                f"link_{i}",
                f"link_{i + 1}",
                xyz=origins[i],
                rpy=_TURNS[i],
                limit=limit,
                digits=digits,
            )
        )
    parts.append(link("flange"))
    parts.append(joint("to_flange", "link_7", "flange", kind="fixed", xyz=origins[7], rpy=_TURNS[7], digits=digits))
    return robot(*parts, name=f"iiwa{size}")


def robot(*parts: str, name: str = "test") -> str:
    """A whole file."""
    return f'<?xml version="1.0"?>\n<robot name="{name}">\n' + "".join(parts) + "</robot>\n"


def link(name: str, mass: float = 0, center: tuple = (0, 0, 0), inertia: tuple = (0, 0, 0)) -> str:
    """One link, with a mesh that does not exist."""
    body = (
        f'<inertial><origin xyz="{_text(center)}"/><mass value="{mass}"/><inertia ixx="{inertia[0]}" ixy="0" ixz="0" '
        f'iyy="{inertia[1]}" iyz="0" izz="{inertia[2]}"/></inertial>'
        if mass
        else ""
    )
    mesh = '<visual><geometry><mesh filename="package://nowhere/none.stl"/></geometry></visual>'
    return f'<link name="{name}">{body}{mesh}</link>\n'


def joint(
    name: str,
    parent: str,
    child: str,
    *,
    kind: str = "revolute",
    axis: tuple = (0, 0, 1),
    xyz: tuple = (0, 0, 0),
    rpy: tuple = (0, 0, 0),
    limit: float = 2.0,
    extra: str = "",
    digits: int = 17,
) -> str:
    """One joint with symmetric limits."""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{_text(xyz)}" rpy="{_text(rpy, digits)}"/><axis xyz="{_text(axis)}"/>'
        f'<limit lower="{-limit}" upper="{limit}" effort="10" velocity="3"/>{extra}</joint>\n'
    )


def arm_urdf(
    axes: str = "zyzyzyz",
    shifts: dict[int, tuple] | None = None,
    kinds: dict[int, str] | None = None,
    extra: dict[int, str] | None = None,
    more: str = "",
) -> str:
    """An arm stacked along z with 0.3 m links; joints j1.., links base, l1.., tip; ``shifts`` replaces origins."""
    unit = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}
    heights = {4: 0.3, 5: 0.3}
    parts, parent = [link("base")], "base"
    for i, letter in enumerate(axes, start=1):
        xyz = (shifts or {}).get(i, (0, 0, heights.get(i, 0)))
        parts.append(link(f"l{i}", 1.0, (0, 0, 0.1), (0.01, 0.01, 0.01)))
        parts.append(
            joint(
                f"j{i}",
                parent,
                f"l{i}",
                kind=(kinds or {}).get(i, "revolute"),
                axis=unit[letter],
                xyz=xyz,
                extra=(extra or {}).get(i, ""),
            )
        )
        parent = f"l{i}"
    parts += [link("tip"), joint("to_tip", parent, "tip", kind="fixed", xyz=(0, 0, 0.1)), more]
    return robot(*parts)


def two_arms(second: str = "") -> str:
    """Two arms on one body, the second's links and joints with _2 at the end; on request the second has other axes."""
    left = arm_urdf().split("\n", 2)[2].removesuffix("</robot>\n")
    other = arm_urdf(second).split("\n", 2)[2].removesuffix("</robot>\n") if second else left
    right = re.sub(r'((?:name|link)=")(\w+)"', r'\1\2_2"', other)
    mounts = [
        joint(f"mount{end}", "body", f"base{end}", kind="fixed", xyz=(0, side, 0))
        for end, side in (("", 1), ("_2", -1))
    ]
    return robot(link("body"), left, right, *mounts)


def _text(numbers: tuple, digits: int = 17) -> str:
    return " ".join(f"{x:.{digits}g}" for x in numbers)
