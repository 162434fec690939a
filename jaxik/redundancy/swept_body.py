"""The body of an arm about the elbow's circles: rigid parts, whose free swivels the closed form gives."""

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxik.arm import Arm
from jaxik.ik import ArmConstants, Bend, CheckedTarget, into_plane
from jaxik.numerics import sincos_apart, vec3
from jaxik.obstacles import FreeSwivels, RigidParts, World, free_swivels

_SIDES = ((1.0,), (-1.0,))  # of the elbow, by its bit


def swept_free_swivels(
    arm: Arm, world: World, g: ArmConstants, target: CheckedTarget, n: Array, zero: Array, b: Bend, elbow: Array
) -> FreeSwivels:
    """Return the swivels at which the arm's body is free, for targets with the batch last.

    Args:
        arm: The arm with its body.
        world: The world, its rows last.
        g: Its constants.
        target: The targets, with position ``(3, n)`` and directions ``(3, 3 or 1, n)``.
        n: Unit vectors from shoulder to wrist in the shoulder frame, ``(3, n)``.
        zero: Directions of swivel zero, ``(3, n)``.
        b: Bend of the elbow.
        elbow: Joint 4, ``(elbow bit, n)`` [rad].
    """
    body = arm.surroundings.body
    parts, links = body.parts, np.array(body.link)
    base, upper, fore, hand = (np.flatnonzero(parts == part) for part in range(4))
    turning = np.sort([*upper, *fore]).astype(int)
    centers = body.centers.T
    hands, hand_radii = _hand(arm, g, target, centers[:, hand], body.radii[hand])
    bases = vec3.matmul(g.to_shoulder_frame, (centers[:, base] - g.shoulder)[..., None])
    bases = jnp.broadcast_to(bases, (3, len(base), n.shape[-1]))
    turned = _turning(arm, centers[:, turning], links[turning] == 4, elbow)
    place = np.argsort([*base, *hand])
    rigid = RigidParts(
        axis=n,
        zero=zero,
        quarter=g.reference.sense * vec3.cross(n, zero),
        sense=g.reference.sense,
        turning=into_plane(b, jnp.array(_SIDES, n.dtype), turned),
        turning_radii=body.radii[turning],
        fixed=jnp.concatenate([bases, hands], axis=1)[:, place],
        fixed_radii=jnp.concatenate([body.radii[base], hand_radii])[place],
    )
    return free_swivels(body, rigid, _from_shoulder(g, world))


def _turning(arm: Arm, centers: Array, on_forearm: np.ndarray, elbow: Array) -> Array:
    """Spheres of upper arm and forearm in the elbow frame, from the shoulder, ``(3, T, elbow bit, n)``."""
    along = arm.elbow - arm.shoulder
    a4 = arm.axes[3]
    along = along - vec3.dot(along, a4) * a4
    along = along / jnp.sqrt(vec3.dot(along, along))
    frame = jnp.stack([along, vec3.cross(a4, along), a4])
    point = vec3.matvec(frame, arm.elbow - arm.shoulder)[:, None, None, None]
    x, y, z = vec3.matmul(frame, centers - arm.elbow[:, None])[..., None, None]
    sin, cos = sincos_apart(elbow)
    bends = on_forearm[:, None, None]
    sin, cos = jnp.where(bends, sin, 0.0), jnp.where(bends, cos, 1.0)
    return point + jnp.stack([cos * x - sin * y, sin * x + cos * y, jnp.broadcast_to(z, sin.shape)])


def _hand(arm: Arm, g: ArmConstants, target: CheckedTarget, centers: Array, radii: Array) -> tuple[Array, Array]:
    """Spheres of the hand from the shoulder in the shoulder frame, ``(3, spheres, n)``, and their radii.

    A target that leaves the roll of the hand open has them on its axis, larger by their distance from it.
    """
    origin = vec3.matvec(g.to_shoulder_frame, target.position - g.shoulder)
    rotation = vec3.matmul(g.to_shoulder_frame, target.directions)
    x, y, z = vec3.matmul(arm.tool_rotation.T, centers - arm.tool_position[:, None])[..., None]
    if rotation.shape[1] == 1:
        square = (x * x + y * y)[:, 0]
        off = jnp.where(square > 0.0, jnp.sqrt(jnp.where(square > 0.0, square, 1.0)), 0.0)
        radii = jnp.where(radii < 0.0, radii, radii + off)
        return origin[:, None] + rotation * z, radii
    return origin[:, None] + rotation[:, 0, None] * x + rotation[:, 1, None] * y + rotation[:, 2, None] * z, radii


def _from_shoulder(g: ArmConstants, world: World) -> World:
    """A world with its rows last, from the shoulder in the shoulder frame."""
    centers, normals = (jnp.moveaxis(x, 1, 0) for x in (world.centers, world.normals))
    offsets = world.offsets - vec3.dot(normals, g.shoulder[:, None])
    centers, normals = (
        jnp.moveaxis(vec3.matmul(g.to_shoulder_frame, x), 0, 1) for x in (centers - g.shoulder[:, None], normals)
    )
    return World.tree_unflatten(None, (centers, world.radii, normals, offsets))
