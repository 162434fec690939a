"""Distance of a motion from obstacles: at its waypoints, and a bound between them."""

from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxik.arm import Arm
from jaxik.obstacles import Clearance, clearance
from jaxik.planning.padding import padded, padded_size

_PARTS = 16  # of a step between two waypoints, at which distances are computed


class ClearanceAlong(NamedTuple):
    """Distances of a motion of K waypoints from obstacles and from itself.

    Attributes:
        at_waypoints: Distance of the closest two at each waypoint, ``(K,)`` [m].
        between: Bound on the distance during each step, in which joints and moving obstacles move linearly,
            ``(K - 1,)`` [m].
        closest: The closest two at the waypoint where they are closest, as text.
    """

    at_waypoints: np.ndarray
    between: np.ndarray
    closest: str


def clearance_at(arm: Arm, q: np.ndarray) -> Clearance:
    """Return the clearance of postures ``(K, joint)`` of an arm in its world, of the first K rows of a moving one."""
    size = padded_size(len(q))  # so that a path of another length is no other program
    world = arm.surroundings.world.rows(slice(len(q)))
    found = clearance(arm, padded(q, size), padded(world, size) if world.moving else world)
    rows = (jnp.asarray(np.asarray(x)[: len(q)]) for x in (found.distance, found.sphere, found.other))
    return replace(found, **dict(zip(("distance", "sphere", "other"), rows, strict=True)))


def clearance_along(arm: Arm, q: np.ndarray) -> ClearanceAlong:
    """Return distances of a motion ``(K, joint)`` [rad] of an arm with a body in its world.

    Between two postures no sphere moves farther than the sum over the joints of their motion times the largest distance
    of a sphere from the joint's axis: where the distance is d before and behind, it is no less than d minus half of
    that between.
    """
    world, last = arm.surroundings.world, len(q) - 1
    at = clearance_at(arm, q)
    places = np.minimum(np.arange(last * _PARTS + 1) / _PARTS, last)
    fine = arm
    moved = np.abs(np.diff(q, axis=0)) @ _reach(arm)
    if world.moving:
        worlds = jax.tree.map(lambda x: _between(np.asarray(x)[: len(q)], places), world)
        fine = replace(arm, surroundings=replace(arm.surroundings, world=worlds))
        steps = np.diff(np.asarray(world.centers)[: len(q)], axis=0)
        grown = np.abs(np.diff(np.asarray(world.radii)[: len(q)], axis=0)).max(axis=-1, initial=0.0)
        shifted = np.abs(np.diff(np.asarray(world.offsets)[: len(q)], axis=0)).max(axis=-1, initial=0.0)
        moved = moved + np.linalg.norm(steps, axis=-1).max(axis=-1, initial=0.0) + grown + shifted
    distance = np.asarray(clearance_at(fine, _between(q, places)).distance, float)
    parts = np.stack([distance[k : k + last * _PARTS : _PARTS] for k in range(_PARTS + 1)]) if last else distance[:0]
    bound = (parts[1:] + parts[:-1] - moved / _PARTS) / 2
    at_waypoints = np.asarray(at.distance, float)
    return ClearanceAlong(at_waypoints, bound.min(axis=0, initial=np.inf), at.describe(int(np.argmin(at_waypoints))))


def _between(rows: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Rows ``(K, ...)`` interpolated at places from 0 to K - 1."""
    low = np.minimum(places.astype(int), max(len(rows) - 2, 0))
    share = (places - low).reshape(-1, *(1,) * (rows.ndim - 1)).astype(rows.dtype)
    return rows[low] + share * (rows[np.minimum(low + 1, len(rows) - 1)] - rows[low])


def _reach(arm: Arm) -> np.ndarray:
    """Largest distance of a sphere's center from each joint's axis in any posture, ``(joint,)`` [m]."""
    centers, links = np.asarray(arm.surroundings.body.centers, float), np.array(arm.surroundings.body.link)
    stations, on = [np.asarray(x, float) for x in arm.stations], arm.station_of_joint
    reach = np.zeros(arm.n_joints)
    for joint in range(arm.n_joints):
        for center, link in zip(centers[links > joint], links[links > joint], strict=True):
            way = [stations[k] for k in range(on[joint], on[link - 1] + 1)] + [center]
            reach[joint] = max(reach[joint], np.linalg.norm(np.diff(way, axis=0), axis=-1).sum())
    return reach
