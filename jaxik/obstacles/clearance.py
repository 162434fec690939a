"""Distance of an arm from obstacles and from itself, by forward kinematics alone.

The closed form of :mod:`jaxik.obstacles.free_swivels` does not enter, so that plans are checked independently of how
they were found.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from jaxik.arm import Arm, ArmModel, as_arm
from jaxik.errors import UnreachableError
from jaxik.kinematics import turn_by, turns
from jaxik.numerics import to_batch_first, to_batch_last, tolerances, vec3
from jaxik.obstacles.body import Body
from jaxik.obstacles.surroundings import Surroundings, in_rows, in_world
from jaxik.obstacles.world import World
from jaxik.targets import as_array, as_floats, check_joints

if TYPE_CHECKING:
    from typing import Self

_NUMBERS = 1 << 20  # items times rows that are in memory at once


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Clearance:
    """Distance of the closest two of a body and a world.

    Attributes:
        distance: Signed distance, ``(*batch,)`` [m]: negative where they meet, infinite without anything to meet.
        sphere: Sphere of the body, ``(*batch,)``: an index of :class:`jaxik.Body`.
        other: Its counterpart, ``(*batch,)``: another sphere of the body below their number M; of a world with N
            spheres, padding included, sphere ``other - M`` below M + N, else half-space ``other - M - N``.
        surroundings: The body and the world.
    """

    distance: Float[Array, "*batch"]
    sphere: Int[Array, "*batch"]
    other: Int[Array, "*batch"]
    surroundings: Surroundings

    @property
    def ok(self) -> Bool[Array, "*batch"]:
        """True where nothing meets."""
        return self.distance >= 0.0

    def describe(self, *row: int) -> str:
        """Return the closest two of a row as text, such as "sphere 3 (forearm) and obstacle 5".

        Args:
            *row: Index of the row, one number per batch axis.
        """
        return self.surroundings.describe(int(self.sphere[row]), int(self.other[row]))

    def raise_if_invalid(self) -> "Self":
        """Return the clearance itself, so that calls chain; for use outside ``jit``.

        Raises:
            UnreachableError: Something meets; with the first row and by how much.
        """
        meets = np.argwhere(~np.asarray(self.ok))
        if len(meets):
            row = tuple(int(i) for i in meets[0])
            deep = -1e3 * float(self.distance[row])
            where = f"row {row}: " if row else ""
            raise UnreachableError(f"collision: {where}{self.describe(*row)} overlap by {deep:.1f} mm")
        return self


def clearance(arm: Arm | ArmModel, q: Float[ArrayLike, "*batch joint"], world: World | None = None) -> Clearance:
    """Return the distance of the closest two of the arm's body and a world, and of its own pairs.

    Args:
        arm: The arm, with a body (:func:`jaxik.with_body`).
        q: Joint angles, ``(*batch, n_joints)`` [rad].
        world: The world; its batch axes broadcast against those of ``q``. None for the arm's own pairs alone.

    Returns:
        Distance, sphere and counterpart of each row. Spheres of link 0, which no joint moves, are tested against the
        arm alone: a mount may stand in its table.

    Raises:
        ValueError: Wrong shapes, or an arm without a body.

    **Differentiability**: in ``q``, centers, radii, half-spaces and arm, that of the closest two; not where two centers
    coincide.
    """
    arm, q = as_arm(arm, any_class=True), as_array("joint angles of shape (*batch, n_joints)", q)
    arm = in_world(arm, World() if world is None else world)
    distance, sphere, other = _clearance(arm, q)
    return Clearance(distance, sphere, other, arm.surroundings)


@jax.jit
def _clearance(arm: Arm, q: ArrayLike) -> tuple[Array, Array, Array]:
    (q,) = as_floats(q)
    check_joints(arm, q)
    batch = np.broadcast_shapes(q.shape[:-1], arm.surroundings.world.batch)
    q, arm = to_batch_last(q, batch, 1), arm.astype(q.dtype)
    distance, sphere, other = closest_pair(arm, q, columns_of(arm.surroundings.world, batch))
    return to_batch_first(distance, batch), to_batch_first(sphere, batch), to_batch_first(other, batch)


def columns_of(world: World, batch: tuple[int, ...]) -> World:
    """Return a moving world with its rows last, broadcast to a batch; one for all gets an axis of length one."""
    batch = batch if world.moving else ()
    leaves, _ = world.tree_flatten()
    ranks = (2, 1, 2, 1)
    return World.tree_unflatten(None, tuple(to_batch_last(x, batch, r) for x, r in zip(leaves, ranks, strict=True)))


def closest_pair(arm: Arm, q: Array, world: World) -> tuple[Array, Array, Array]:
    """Return distance, sphere and counterpart of the closest two.

    Args:
        arm: The arm with its body.
        q: Joint angles, ``(joint, n)`` [rad].
        world: The world with its rows last (:func:`columns_of`).

    Returns:
        ``(n,)`` each.
    """
    body = arm.surroundings.body
    place = sphere_centers(arm, body, q)
    held = jax.lax.stop_gradient((place, body, world))
    sphere, other = _closest(*held)
    return _distance(place, body, world, sphere, other), sphere, other


def meets(arm: Arm, q: Array, world: World) -> Array:
    """Test whether anything meets at joint angles ``(joint, n)``, by more than rounding, ``(n,)``; no derivative."""
    body = arm.surroundings.body
    place, body, world = jax.lax.stop_gradient((sphere_centers(arm, body, q), body, world))
    least = jnp.min(_least_per_sphere(place, body, world), axis=0)
    if body.pairs:
        least = jnp.minimum(least, jnp.min(_own_distances(place, body), axis=0))
    return least < -tolerances(q.dtype).singular * arm.length


def rooms(arm: Arm, q: Array, world: World) -> Array:
    """Return the least distance of each sphere from a world, and that of the body's own pairs.

    Args:
        arm: The arm with its body.
        q: Joint angles, ``(joint, n)`` [rad].
        world: The world with its rows last (:func:`columns_of`).

    Returns:
        ``(M + 1, n)`` [m], infinite where nothing is to be met.

    **Differentiability**: in all, that of the closest.
    """
    body = arm.surroundings.body
    return rooms_at(sphere_centers(arm, body, q), body, world)


def rooms_at(place: Array, body: Body, world: World) -> Array:
    """Return :func:`rooms` for centers ``(3, M, n)``."""
    own = jnp.full((1, place.shape[-1]), jnp.inf, place.dtype)
    if body.pairs:
        own = jnp.min(_own_distances(place, body), axis=0, keepdims=True)
    return jnp.concatenate([_least_per_sphere(place, body, world), own])


def room_at_nodes(arm: Arm, q: Array) -> Array:
    """Return the distance of the closest two at nodes of n rows, whose worlds come last, in arm lengths.

    Args:
        arm: The arm with its body.
        q: Joint angles, ``(joint, ..., n)`` [rad].

    Returns:
        Negative where something meets, ``(..., n)``.
    """
    flat = q.reshape(len(q), -1)
    world = in_rows(arm, lambda x: jnp.tile(x, flat.shape[1] // q.shape[-1])).surroundings.world
    return (least_room(arm, flat, world) / arm.length).reshape(q.shape[1:])


def least_room(arm: Arm, q: Array, world: World) -> Array:
    """Return the least of :func:`rooms`, ``(n,)`` [m]; memory does not grow with the number of obstacles."""
    n, items = q.shape[-1], len(world.radii) + len(world.offsets) + 1
    size = max(_NUMBERS // items, 1)
    if n <= size:
        return jnp.min(rooms(arm, q, world), axis=0)
    chunks = -(-n // size)

    def split(x: Array) -> Array:
        padded = jnp.concatenate([x, jnp.repeat(x[..., -1:], chunks * size - n, axis=-1)], axis=-1)
        return jnp.moveaxis(padded.reshape(*x.shape[:-1], chunks, size), -2, 0)

    leaves = world.tree_flatten()[0]
    moving = tuple(x.shape[-1] > 1 for x in leaves)
    own = tuple(split(x) for x, moves in zip(leaves, moving, strict=True) if moves)

    def least(rows: tuple[Array, tuple[Array, ...]]) -> Array:
        given = iter(rows[1])
        parts = tuple(next(given) if moves else x for x, moves in zip(leaves, moving, strict=True))
        return jnp.min(rooms(arm, rows[0], World.tree_unflatten(None, parts)), axis=0)

    return lax.map(least, (split(q), own)).reshape(-1)[:n]


def closeness(arm: Arm, body: Body, world: World, distance: Array, q: Array) -> Array:
    """Return Σ max(0, 1 - d / distance)³ over the distances d of all that must not meet, ``(n,)``.

    Args:
        arm: The arm.
        body: The body.
        world: The world, the same for all rows.
        distance: Distance from which on nothing counts, ``()`` [m].
        q: Joint angles, ``(joint, n)`` [rad].
    """
    place = sphere_centers(arm, body, q)
    world = columns_of(world, ())

    def counted(apart: Array) -> Array:
        return jnp.sum(jnp.maximum(1.0 - apart / distance, 0.0) ** 3, axis=0)

    def of_sphere(one: tuple[Array, Array, Array]) -> Array:
        center, radius, tested = one
        return counted(_distances(center, radius, tested, world))

    total = jnp.sum(lax.map(of_sphere, (jnp.moveaxis(place, 1, 0), body.radii, _tested(body))), axis=0)
    return total + counted(_own_distances(place, body)) if body.pairs else total


def sphere_centers(arm: Arm, body: Body, q: Array) -> Array:
    """Return the centers of a body's spheres, ``(3, M, n)`` [m], at joint angles ``(joint, n)``."""
    rotations = turns(arm.axes, jnp.sin(q), jnp.cos(q))
    link, on = np.array(body.link), arm.station_of_joint
    at_rest = jnp.moveaxis(body.centers, 1, 0)[:, :, None]
    order, moved = [], jnp.zeros((3, 0, q.shape[-1]), q.dtype)
    for joint in reversed(range(arm.n_joints)):
        own = np.flatnonzero(link == joint + 1)
        joining = jnp.broadcast_to(at_rest[:, own], (3, len(own), q.shape[-1]))
        order += list(own)
        moved = jnp.concatenate([moved, joining], axis=1)
        point = arm.stations[on[joint]][:, None, None]
        moved = point + turn_by(rotations[joint], moved - point)
    own = np.flatnonzero(link == 0)
    moved = jnp.concatenate([moved, jnp.broadcast_to(at_rest[:, own], (3, len(own), q.shape[-1]))], axis=1)
    return moved[:, np.argsort([*order, *own])]


def _closest(place: Array, body: Body, world: World) -> tuple[Array, Array]:
    """Indices of the closest two, without derivative; memory grows with the spheres of body or world, not with both."""
    n = place.shape[-1]
    least = _least_per_sphere(place, body, world)
    first, least = jnp.argmin(least, axis=0).astype(jnp.int32), jnp.min(least, axis=0)
    center = jnp.take_along_axis(place, first[None, None], 1)[:, 0]
    distances = _distances(center, body.radii[first], _tested(body)[first], world)
    if len(distances):
        other = jnp.argmin(distances, axis=0).astype(jnp.int32) + len(body.link)
    else:
        other = jnp.full((n,), len(body.link), jnp.int32)
    if body.pairs:
        pairs = jnp.asarray(body.pairs, jnp.int32)
        own = _own_distances(place, body)
        pair, nearest = jnp.argmin(own, axis=0), jnp.min(own, axis=0)
        first = jnp.where(nearest < least, pairs[pair, 0], first)
        other = jnp.where(nearest < least, pairs[pair, 1], other)
    return first, other


def _least_per_sphere(place: Array, body: Body, world: World) -> Array:
    """Distance of each sphere from the world, ``(M, n)``."""

    def least(one: tuple[Array, Array, Array]) -> Array:
        center, radius, tested = one
        return jnp.min(_distances(center, radius, tested, world), axis=0, initial=jnp.inf)

    return lax.map(least, (jnp.moveaxis(place, 1, 0), body.radii, _tested(body)))


def _tested(body: Body) -> Array:
    """True for spheres that a joint moves."""
    return jnp.asarray(np.array(body.link) > 0)


def _distances(center: Array, radius: Array, tested: Array, world: World) -> Array:
    """Distances of one sphere per row from all of a world, ``(N + H, n)``."""
    off = center[:, None] - jnp.moveaxis(world.centers, 1, 0)
    spheres = _length(off) - world.radii - radius
    spheres = jnp.where(world.radii < 0.0, jnp.inf, spheres)
    flat = world.offsets - vec3.dot(jnp.moveaxis(world.normals, 1, 0), center[:, None]) - radius
    return jnp.where(tested & (radius >= 0.0), jnp.concatenate([spheres, flat]), jnp.inf)


def _own_distances(place: Array, body: Body) -> Array:
    """Distances of the body's own pairs, ``(pairs, n)``."""
    first, second = np.array(body.pairs).T
    off = place[:, first] - place[:, second]
    distance = _length(off) - (body.radii[first] + body.radii[second])[:, None]
    real = (body.radii[first] >= 0.0) & (body.radii[second] >= 0.0)
    return jnp.where(real[:, None], distance, jnp.inf)


def _length(off: Array) -> Array:
    """Length of vectors ``(3, ...)``, with derivative zero where there is none."""
    square = vec3.dot(off, off)
    apart = square > 0.0
    return jnp.where(apart, jnp.sqrt(jnp.where(apart, square, 1.0)), 0.0)


def _distance(place: Array, body: Body, world: World, sphere: Array, other: Array) -> Array:
    """Distance of one pair per row, with its derivative."""
    count, spheres = len(body.link), world.radii.shape[0]
    n = place.shape[-1]

    def picked(x: Array, index: Array) -> Array:
        """Rows ``(..., n)`` of an array ``(items, ..., n or 1)``; nothing is read of an empty one."""
        if not x.shape[0]:
            return jnp.zeros((*x.shape[1:-1], n), x.dtype)
        x = jnp.broadcast_to(x, (*x.shape[:-1], n))
        index = jnp.clip(index, 0, x.shape[0] - 1).reshape((1,) * (x.ndim - 1) + (n,))
        return jnp.take_along_axis(x, index, 0)[0]

    by_sphere = jnp.moveaxis(place, 1, 0)
    center, radius = picked(by_sphere, sphere), picked(body.radii[:, None], sphere)
    itself, item = other < count, other - count
    there = jnp.where(itself, picked(by_sphere, other), picked(world.centers, item))
    size = jnp.where(itself, picked(body.radii[:, None], other), picked(world.radii, item))
    flat = (item >= spheres) & (world.offsets.shape[0] > 0)
    off = center - there
    round_ = _length(off) - size - radius
    normal, offset = picked(world.normals, item - spheres), picked(world.offsets, item - spheres)
    distance = jnp.where(flat, offset - vec3.dot(normal, center) - radius, round_)
    something = (radius >= 0.0) & (flat | (size >= 0.0)) & (itself | flat | (item < spheres))
    moved = jnp.asarray(np.array(body.link) > 0)[sphere]
    return jnp.where(something & (itself | moved), distance, jnp.inf)
