"""Bodies of preset arms, most estimated from pictures and drawings: check them before relying on them."""

from itertools import product

import numpy as np

from jaxik.obstacles.body import Body
from jaxik.obstacles.covers import capsule_cover, joined

# Link, height [m] and radius [m]: all spheres of an upright iiwa are on the vertical, which is the axis of its links.
_IIWA14 = (
    (0, 0.07, 0.12),
    (0, 0.18, 0.11),
    (1, 0.28, 0.11),
    (2, 0.36, 0.12),
    (3, 0.46, 0.10),
    (3, 0.55, 0.10),
    (3, 0.64, 0.10),
    (3, 0.71, 0.11),
    (4, 0.78, 0.12),
    (4, 0.87, 0.10),
    (4, 0.96, 0.09),
    (4, 1.05, 0.09),
    (4, 1.11, 0.09),
    (6, 1.18, 0.10),
    (7, 1.26, 0.07),
)

# Link, middle at zero joint angles [m], direction, length between the ends' centers [m] and radius [m] of the capsules
# of Franka's own self-collision model: frankaemika/franka_ros, franka_description/robots/common/franka_arm.xacro.
_DIAGONAL = 0.5**0.5
_FRANKA = (
    (0, (-0.075, 0.0, 0.06), (1.0, 0.0, 0.0), 0.03, 0.06),
    (0, (0.0, 0.0, 0.1415), (0.0, 0.0, 1.0), 0.283, 0.06),  # link 1, which joint 1 turns on its axis, down to a table
    (2, (0.0, 0.0, 0.333), (0.0, 1.0, 0.0), 0.12, 0.06),
    (3, (0.0, 0.0, 0.504), (0.0, 0.0, 1.0), 0.15, 0.06),
    (4, (0.0825, 0.0, 0.649), (0.0, 1.0, 0.0), 0.12, 0.06),
    (5, (0.0, 0.0, 0.773), (0.0, 0.0, 1.0), 0.10, 0.06),
    (5, (0.0, 0.08, 0.903), (0.0, 0.0, 1.0), 0.14, 0.025),
    (6, (0.0, 0.03, 1.033), (0.0, 1.0, 0.0), 0.08, 0.05),
    (7, (0.088, 0.0, 1.023), (0.0, 0.0, 1.0), 0.14, 0.04),
    (7, (0.088 + 0.06 * _DIAGONAL, -0.06 * _DIAGONAL, 0.951), (_DIAGONAL, -_DIAGONAL, 0.0), 0.01, 0.03),
)
_FRANKA_OVERHANG = 0.008  # of the spheres beyond the capsules [m]

# Depth below the shoulder [m] and radius [m] along a hanging arm, by link.
_MECCANOID_ARM = (
    (3, 0.06, 0.025),
    (3, 0.11, 0.025),
    (3, 0.155, 0.028),
    (4, 0.20, 0.025),
    (4, 0.245, 0.025),
    (4, 0.29, 0.025),
    (6, 0.35, 0.035),
    (6, 0.395, 0.03),
)
# Distance inward of the shoulder, height above it and radius [m] of torso and head.
_MECCANOID_TRUNK = (
    (0.15, -0.02, 0.10),
    (0.15, -0.11, 0.10),
    (0.15, -0.20, 0.10),
    (0.15, -0.29, 0.10),
    (0.15, 0.15, 0.09),
)
_MECCANOID_WIDTH = 0.30  # from shoulder to shoulder [m]


def preset_body(name: str) -> Body:
    """Return the body of :meth:`jaxik.Body.preset`."""
    if name == "iiwa14":
        link, height, radius = np.array(_IIWA14).T
        centers = np.stack([np.zeros_like(height), np.zeros_like(height), height], axis=-1)
        return Body(link.astype(int), centers, radius).noted(
            ("Body: estimated from the data sheet's drawing; fingers and tools are not in it.",)
        )
    if name in ("franka_panda", "franka_fr3"):
        return _franka()
    if name in ("meccanoid_left", "meccanoid_right"):
        return _meccanoid(1.0 if name == "meccanoid_left" else -1.0)
    raise ValueError(
        f"no body for {name!r}: there are those of iiwa14, franka_panda, franka_fr3, meccanoid_left and meccanoid_right"
    )


def _franka() -> Body:
    """Spheres over the capsules, without a hand."""
    links, covers = [], []
    for link, middle, direction, length, radius in _FRANKA:
        half = 0.5 * length * np.array(direction)
        covers.append(capsule_cover(middle - half, middle + half, radius, _FRANKA_OVERHANG))
        links += [link] * len(covers[-1].radii)
    cover = joined(covers)
    return Body(links, cover.centers, cover.radii).noted(
        (
            "Body: spheres over the capsules of Franka's self-collision model (franka_ros, franka_description), up to "
            "8 mm larger; the hand and cables are not in it, and the covers of the links reach a little beyond.",
        )
    )


def _meccanoid(outward: float) -> Body:
    """Arm, torso and head, and the other arm hanging down."""
    link, depth, radius = np.array(_MECCANOID_ARM).T
    own = np.stack([np.zeros_like(depth), np.zeros_like(depth), -depth], axis=-1)
    other = own + np.array([0.0, -outward * _MECCANOID_WIDTH, 0.0])
    inward, height, trunk_radius = np.array(_MECCANOID_TRUNK).T
    trunk = np.stack([np.zeros_like(inward), -outward * inward, height], axis=-1)
    fixed = len(trunk) + len(other)
    links = np.concatenate([link, np.zeros(fixed)]).astype(int)
    pairs = [*product(range(len(link)), range(len(link), len(link) + fixed))]
    pairs += [(i, j) for i, j in product(range(len(link)), repeat=2) if link[i] == 3 and link[j] == 6]
    body = Body(links, np.concatenate([own, trunk, other]), np.concatenate([radius, trunk_radius, radius]), pairs)
    return body.noted(
        ("Body: torso, head and the other arm hanging down are estimates for a robot 1.2 m tall; measure yours.",)
    )
