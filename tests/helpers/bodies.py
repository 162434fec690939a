"""Random bodies and worlds of one size each, and distances by forward kinematics written independently in numpy."""

import numpy as np

import jaxik
from jaxik.arm.arm import Arm

SPHERES = 20


def random_body(arm: Arm, seed: int) -> jaxik.Body:
    """Twelve spheres, two on the base, four on upper arm and forearm and two on the hand, on and off their axes."""
    rng, length, last = np.random.default_rng(seed), float(arm.length), arm.n_joints
    shoulder, elbow, wrist, tool = (np.asarray(x) for x in (arm.shoulder, arm.elbow, arm.wrist, arm.tool_position))
    below = shoulder - 0.4 * length * np.asarray(arm.axes[0])
    link = np.array([0, 0, 3, 3, 3, 3, 4, 4, 4, 4, last, last])
    ends = {0: (below, shoulder), 3: (shoulder, elbow), 4: (elbow, wrist), last: (wrist, tool)}
    along = rng.uniform(0.2, 0.8, len(link))[:, None]
    first, second = (np.array([ends[int(i)][k] for i in link]) for k in (0, 1))
    aside = rng.normal(0.0, 0.04 * length, (len(link), 3))
    aside[link == last] *= last == 7  # a hand whose roll is free has its spheres on its axis
    return jaxik.Body(link, first + along * (second - first) + aside, rng.uniform(0.02, 0.06, len(link)) * length)


def random_world(arm: Arm, seed: int, count: int = SPHERES) -> jaxik.World:
    """Spheres about the shoulder, and a table below it."""
    rng, length = np.random.default_rng(seed), float(arm.length)
    away = rng.normal(size=(count, 3))
    away *= rng.uniform(0.2, 1.0, (count, 1)) * length / np.linalg.norm(away, axis=1, keepdims=True)
    down = -np.asarray(arm.axes[0])
    offset = down @ np.asarray(arm.shoulder) + 0.35 * length
    centers, radii = np.asarray(arm.shoulder) + away, rng.uniform(0.01, 0.08, count) * length
    return jaxik.World(centers, radii, normals=down[None], offsets=[offset])


def carried(arm: Arm, body: jaxik.Body, q: np.ndarray) -> np.ndarray:
    """Centers of the spheres at joint angles ``(..., joint)``, by products of turns, ``(..., M, 3)``."""
    axes = np.asarray(arm.axes)
    points = [np.asarray(x) for x in [arm.shoulder] * 3 + [arm.elbow] + [arm.wrist] * 3]
    centers = []
    for link, center in zip(body.link, np.asarray(body.centers), strict=True):
        place = np.broadcast_to(center, (*q.shape[:-1], 3))
        for joint in reversed(range(link)):
            place = points[joint] + _turned(axes[joint], q[..., joint], place - points[joint])
        centers.append(place)
    return np.stack(centers, axis=-2)


def distance(body: jaxik.Body, world: jaxik.World, centers: np.ndarray) -> np.ndarray:
    """Distance of the closest two for centers ``(..., M, 3)``: ``(...,)``."""
    radii, moved = np.asarray(body.radii), np.array(body.link) > 0
    least = np.full(centers.shape[:-2], np.inf)
    for center, radius in zip(np.asarray(world.centers), np.asarray(world.radii), strict=True):
        apart = np.linalg.norm(centers[..., moved, :] - center, axis=-1) - radii[moved] - radius
        least = np.minimum(least, apart.min(axis=-1))
    for normal, offset in zip(np.asarray(world.normals), np.asarray(world.offsets), strict=True):
        least = np.minimum(least, (offset - centers[..., moved, :] @ normal - radii[moved]).min(axis=-1))
    for i, j in body.pairs:
        apart = np.linalg.norm(centers[..., i, :] - centers[..., j, :], axis=-1) - radii[i] - radii[j]
        least = np.minimum(least, apart)
    return least


def _turned(axis: np.ndarray, angle: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Vectors turned about an axis (Rodrigues)."""
    sin, cos = np.sin(angle)[..., None], np.cos(angle)[..., None]
    return cos * v + sin * np.cross(axis, v) + (1 - cos) * (v @ axis)[..., None] * axis
