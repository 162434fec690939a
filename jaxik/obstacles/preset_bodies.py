"""Bodies of preset arms, estimated from pictures and drawings: check them against the robot before relying on them."""

from itertools import product

import numpy as np

from jaxik.obstacles.body import Body

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
    if name in ("meccanoid_left", "meccanoid_right"):
        return _meccanoid(1.0 if name == "meccanoid_left" else -1.0)
    raise ValueError(f"no body for {name!r}: there are those of iiwa14, meccanoid_left and meccanoid_right")


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
