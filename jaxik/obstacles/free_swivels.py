"""Swivels at which a body of spheres is free of a world, and of itself, in closed form.

1. With the target fixed, upper arm and forearm turn rigidly about the line from shoulder to wrist. In cylinder
   coordinates about it a sphere of theirs (along, across, angle + swivel) and a sphere or half-space of the world
   (along, across, angle) meet where cos(swivel - center) > cos(half width): one blocked interval per pair at most.
2. The hand is fixed, and so are spheres on axis 1: they meet or they do not.
3. Each turning sphere is tested against all items, bits tell which ones block, and these are subtracted from the free
   arcs one after the other: memory does not grow with the number of pairs, and what never blocks costs a few products.
4. The ends of the arcs are computed again from the pairs that bound them, which has the derivatives.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxik.numerics import arctan2, clipped_sqrt, fused_separately, principal, tolerances, vec3, with_value
from jaxik.obstacles.body import Body
from jaxik.obstacles.world import World

ARCS = 16
"""Free arcs of each elbow side that are kept; of more, which are narrow, the narrowest are left out."""

_WORD = 32
_BLOCK = 8 * _WORD  # items tested at once
_NUMBERS = 1 << 20  # items times rows that are in memory at once
_ROWS = ("axis", "zero", "quarter", "turning", "fixed")  # of the parts, that have rows
_FAR = 1e6  # m or m²: no number of an arm; a blocked interval this far from zero is none
_NOWHERE = 9.0  # rad; start of an unused place, beyond half a turn


class RigidParts(NamedTuple):
    """Spheres of a body about the elbow's circles of n targets, from the shoulder in the shoulder frame.

    Attributes:
        axis: Unit vectors from shoulder to wrist, ``(3, n)``.
        zero: Directions of swivel zero across it, ``(3, n)``.
        quarter: Directions of swivel pi / 2, ``(3, n)``.
        sense: Sense in which the swivel grows about the axis, 1 or -1.
        turning: Upper arm and forearm along the axis, the direction of the swivel, and axis × direction,
            ``(3, T, elbow bit, n)`` [m].
        turning_radii: Their radii, ``(T,)`` [m].
        fixed: Base and hand, ``(3, F, n)`` [m].
        fixed_radii: Their radii, ``(F,)`` [m].
    """

    axis: Array
    zero: Array
    quarter: Array
    sense: float
    turning: Array
    turning_radii: Array
    fixed: Array
    fixed_radii: Array


class FreeSwivels(NamedTuple):
    """Free arcs of the elbow's circle, within [-pi, pi] and in no order.

    Attributes:
        start: Starts, ``(arc, elbow bit, *rows)`` [rad]; of an unused place pi.
        end: Ends, likewise; of an unused place -pi.
    """

    start: Array
    end: Array

    def contain(self, swivel: Array, slack: float = 0.0) -> Array:
        """Test swivels ``(..., elbow bit, *rows)`` in [-pi, pi]."""
        free = jnp.zeros((), bool)
        for start, end in zip(self.start, self.end, strict=True):
            free = free | ((swivel >= start - slack) & (swivel <= end + slack) & (start <= end))
        return free

    def missed(self, swivel: Array) -> Array:
        """Distance of swivels ``(..., elbow bit, *rows)`` from the nearest free arc, pi where there is none [rad]."""
        swivel = principal(swivel)
        least = jnp.full((), jnp.pi, swivel.dtype)
        for start, end in zip(self.start, self.end, strict=True):
            inside = (swivel >= start) & (swivel <= end)
            ends = jnp.minimum(jnp.abs(principal(swivel - start)), jnp.abs(principal(swivel - end)))
            least = jnp.minimum(least, jnp.where(start <= end, jnp.where(inside, 0.0, ends), jnp.pi))
        return least


class _Items(NamedTuple):
    """Spheres and half-spaces that a turning sphere can meet, ``(J, n)`` each.

    A turning sphere with radius r, at distance rho from the shoulder, meets one where
    round (rho² - r²) / 2 + room - size r < along along' + across across' cos(swivel - center).
    """

    along: Array
    across: Array
    angle: Array
    round: Array
    room: Array
    size: Array


class _Turning(NamedTuple):
    """Turning spheres: cylinder coordinates and (rho² - r²) / 2, ``(T, elbow bit, n)``, and radii ``(T, 1, 1)``."""

    along: Array
    across: Array
    angle: Array
    square: Array
    radius: Array


class _Arcs(NamedTuple):
    """Free arcs under way, ``(ARCS, elbow bit, n)`` each: their ends, and the pairs that bound them, -1 for none."""

    start: Array
    end: Array
    first: Array
    last: Array


def free_swivels(body: Body, parts: RigidParts, world: World) -> FreeSwivels:
    """Return the free swivels of n targets.

    Args:
        body: The body, whose pairs and links count; its spheres are those of ``parts``.
        parts: Its spheres about the circles.
        world: The world from the shoulder in the shoulder frame, its rows last, ``(N, 3, n or 1)``, ``(N, n or 1)``.

    Returns:
        The free arcs for each elbow bit.

    **Differentiability**: the ends in all arrays, while the pairs that bound them stay the same.
    """
    n, per_row = parts.axis.shape[-1], len(world.radii) + len(world.offsets) + len(body.link)
    size = max(_NUMBERS // per_row, 1)
    if n <= size:
        return _free_swivels(body, parts, world)
    chunks, moving = -(-n // size), world.radii.shape[-1] > 1 or world.offsets.shape[-1] > 1

    def split(x: Array) -> Array:
        """Rows in chunks, the last filled up with its own last row: ``(chunks, ..., size)``."""
        padded = jnp.concatenate([x, jnp.repeat(x[..., -1:], chunks * size - n, axis=-1)], axis=-1)
        return jnp.moveaxis(padded.reshape(*x.shape[:-1], chunks, size), -2, 0)

    def solve(rows: tuple[tuple[Array, ...], tuple[Array, ...]]) -> FreeSwivels:
        own = parts._replace(**dict(zip(_ROWS, rows[0], strict=True)))
        return _free_swivels(body, own, World.tree_unflatten(None, rows[1]) if moving else world)

    leaves = world.tree_flatten()[0] if moving else ()
    found = lax.map(solve, jax.tree.map(split, (tuple(getattr(parts, name) for name in _ROWS), leaves)))
    return FreeSwivels(*(jnp.moveaxis(x, 0, -2).reshape(*x.shape[1:-1], -1)[..., :n] for x in found))


def _free_swivels(body: Body, parts: RigidParts, world: World) -> FreeSwivels:
    turning, items, allowed = _turning(parts), _items(body, parts, world), _allowed(body, world)
    held = jax.lax.stop_gradient((turning, items, parts, world))
    blocked = _blocked_all_round(body, *held[2:])
    arcs = _all_free(blocked, parts.axis.dtype)
    if len(turning.along) and len(items.along):
        arcs = _subtract_all(arcs, *held[:2], allowed)
    sides = (arcs.start, arcs.first, 1.0), (arcs.end, arcs.last, -1.0)
    start, end = (_with_derivative(value, pair, side, turning, items) for value, pair, side in sides)
    unused = arcs.start >= arcs.end
    return FreeSwivels(jnp.where(unused, jnp.pi, start), jnp.where(unused, -jnp.pi, end))


@fused_separately
def _cylinder(vectors: Array, axis: Array, zero: Array, quarter: Array) -> tuple[Array, Array, Array]:
    x, y = vec3.dot(vectors, zero), vec3.dot(vectors, quarter)
    return vec3.dot(vectors, axis), clipped_sqrt(x * x + y * y), arctan2(y, x)


def _turning(parts: RigidParts) -> _Turning:
    along, x, y = parts.turning
    radius = parts.turning_radii[:, None, None]
    y = parts.sense * y
    square = 0.5 * (vec3.dot(parts.turning, parts.turning) - radius * radius)
    # Padding is nowhere.
    square, radius = jnp.where(radius < 0.0, _FAR, square), jnp.where(radius < 0.0, -_FAR, radius)
    return _Turning(along, clipped_sqrt(x * x + y * y), arctan2(y, x), square, radius)


def _items(body: Body, parts: RigidParts, world: World) -> _Items:
    """World spheres, half-spaces, and fixed spheres of the body that a turning one must not meet."""
    n = parts.axis.shape[-1]
    spheres, own = len(world.radii), _own_items(body)
    centers, normals = (jnp.moveaxis(x, 1, 0) for x in (world.centers, world.normals))
    vectors = [jnp.broadcast_to(x, (*x.shape[:2], n)) for x in (centers, normals, parts.fixed[:, own])]
    coordinates = _cylinder(jnp.concatenate(vectors, axis=1), *(x[:, None] for x in parts[:3]))
    sizes = [world.radii, jnp.broadcast_to(parts.fixed_radii[own, None], (len(own), 1))]
    room = [0.5 * (vec3.dot(o, o) - r * r) for o, r in zip((centers, parts.fixed[:, own]), sizes, strict=True)]
    room, size = (
        jnp.concatenate([jnp.broadcast_to(x, (len(x), n)) for x in rows])
        for rows in ((room[0], world.offsets, room[1]), (sizes[0], jnp.ones_like(world.offsets), sizes[1]))
    )
    is_flat = (np.arange(len(room)) >= spheres) & (np.arange(len(room)) < spheres + len(world.offsets))
    absent = (size < 0.0) & ~is_flat[:, None]
    room, size = jnp.where(absent, _FAR, room), jnp.where(absent, 0.0, size)
    round_ = jnp.where(absent | is_flat[:, None], 0.0, jnp.ones_like(room))
    return _Items(*coordinates, round_, room, size)


def _turning_spheres(body: Body) -> np.ndarray:
    return np.flatnonzero((body.parts == 1) | (body.parts == 2))


def _fixed_spheres(body: Body) -> np.ndarray:
    return np.flatnonzero((body.parts == 0) | (body.parts == 3))


def _own_items(body: Body) -> np.ndarray:
    """Places among the fixed spheres of those that a turning one must not meet."""
    turning, fixed = _turning_spheres(body), _fixed_spheres(body)
    met = {j for pair in body.pairs for i, j in (pair, pair[::-1]) if i in turning and j in fixed}
    return np.array([place for place, sphere in enumerate(fixed) if sphere in met], int)


def _allowed(body: Body, world: World) -> np.ndarray:
    """Pairs of turning spheres and items that must not meet, ``(T, J)``."""
    pairs = {*body.pairs, *(pair[::-1] for pair in body.pairs)}
    turning, fixed = _turning_spheres(body), _fixed_spheres(body)[_own_items(body)]
    own = np.array([[(int(i), int(j)) in pairs for j in fixed] for i in turning], bool).reshape(
        len(turning), len(fixed)
    )
    return np.concatenate([np.ones((len(turning), len(world.radii) + len(world.offsets)), bool), own], axis=1)


def _blocked_all_round(body: Body, parts: RigidParts, world: World) -> Array:
    """True where spheres meet that no swivel moves against each other, ``(elbow bit, n)``."""
    n, slack = parts.axis.shape[-1], tolerances(parts.axis.dtype).singular
    turning, fixed = _turning_spheres(body), _fixed_spheres(body)
    blocked = jnp.zeros((2, n), bool)
    links = np.array(body.link)
    tested = np.flatnonzero(links[fixed] > 0)
    if len(tested) and len(world.radii) + len(world.offsets):
        rows = jnp.moveaxis(parts.fixed, 1, 0)[tested], parts.fixed_radii[tested]
        meets = lax.map(lambda one: _meets_world(one[0], one[1], world, slack), rows)
        blocked = blocked | jnp.any(meets, axis=0)
    place = {int(s): (i, kind) for kind, some in enumerate((turning, fixed)) for i, s in enumerate(some)}
    groups: dict[int, list[tuple[int, int]]] = {0: [], 1: []}
    for i, j in body.pairs:
        (a, kind), (b, other) = place[i], place[j]
        if kind == other:
            groups[kind].append((a, b))
    for kind, centers, radii in ((0, parts.turning, parts.turning_radii), (1, parts.fixed, parts.fixed_radii)):
        if groups[kind]:
            first, second = np.array(groups[kind]).T
            off = centers[:, first] - centers[:, second]
            least = (radii[first] + radii[second]).reshape(-1, *(1,) * (off.ndim - 2))
            real = (radii[first] >= 0.0) & (radii[second] >= 0.0)
            meets = (vec3.dot(off, off) < least * least * (1.0 - slack)) & real.reshape(least.shape)
            blocked = blocked | jnp.any(meets, axis=0)
    return blocked


def _meets_world(center: Array, radius: Array, world: World, slack: float) -> Array:
    """Test whether a sphere ``(3, n)`` meets anything of a world, ``(n,)``."""
    off = jnp.moveaxis(world.centers, 1, 0) - center[:, None]
    least = world.radii + radius
    round_ = (vec3.dot(off, off) < least * least * (1.0 - slack)) & (world.radii >= 0.0)
    flat = world.offsets - vec3.dot(jnp.moveaxis(world.normals, 1, 0), center[:, None]) < radius * (1.0 - slack)
    return (jnp.any(round_, axis=0) | jnp.any(flat, axis=0)) & (radius >= 0.0)


def _all_free(blocked: Array, dtype: jnp.dtype) -> _Arcs:
    shape = (ARCS, *blocked.shape)
    place = np.arange(ARCS)[:, None, None]
    used = (place == 0) & ~blocked
    none = jnp.full(shape, -1, jnp.int32)
    # Unused places differ in width, so that one of them is the narrowest.
    start = jnp.where(used, -jnp.pi, _NOWHERE).astype(dtype)
    end = jnp.where(used, jnp.pi, -_NOWHERE - place).astype(dtype)
    return _Arcs(start, end, none, none)


def _subtract_all(arcs: _Arcs, turning: _Turning, items: _Items, allowed: np.ndarray) -> _Arcs:
    """Subtract the blocked intervals of all pairs from the free arcs."""
    count = len(items.along)
    size = min(_BLOCK, -(-count // _WORD) * _WORD)
    blocks = -(-count // size)
    pad = blocks * size - count

    def in_blocks(x: Array, axis: int, value: float | bool) -> Array:
        widths = [(0, pad if k == axis else 0) for k in range(x.ndim)]
        x = jnp.pad(x, widths, constant_values=value)
        return jnp.moveaxis(x.reshape(*x.shape[:axis], blocks, size, *x.shape[axis + 1 :]), axis, 0)

    padded = jax.tree.map(lambda x: in_blocks(x, 0, 0.0), items)._replace(room=in_blocks(items.room, 0, _FAR))
    masks = in_blocks(jnp.asarray(allowed), 1, False)
    begin = size * jnp.arange(blocks, dtype=jnp.int32)

    def over_block(arcs: _Arcs, block: tuple[_Items, Array, Array]) -> tuple[_Arcs, None]:
        some, mask, first = block
        sphere = jnp.arange(len(turning.along), dtype=jnp.int32)

        def over_sphere(arcs: _Arcs, one: tuple[_Turning, Array, Array]) -> tuple[_Arcs, None]:
            turned, own, index = one
            words = _blocking(turned, some, own)
            return _subtract(arcs, words, turned, some, index * count + first), None

        return lax.scan(over_sphere, arcs, (turning, mask, sphere))[0], None

    return lax.scan(over_block, arcs, (padded, masks, begin))[0]


@fused_separately
def _blocking(turning: _Turning, items: _Items, allowed: Array) -> Array:
    """Bits of the items that block some swivel of a sphere ``(elbow bit, n)``: ``(words, elbow bit, n)``."""
    height, across = items.along[:, None] * turning.along, items.across[:, None] * turning.across
    room = items.round[:, None] * turning.square + items.room[:, None] - items.size[:, None] * turning.radius
    blocks = (room - height < across) & allowed[:, None, None]
    blocks = blocks.reshape(len(blocks) // _WORD, _WORD, *blocks.shape[1:])
    bits = jnp.left_shift(jnp.uint32(1), jnp.arange(_WORD, dtype=jnp.uint32))[:, None, None]
    return jnp.sum(jnp.where(blocks, bits, jnp.uint32(0)), axis=1, dtype=jnp.uint32)


def _subtract(arcs: _Arcs, words: Array, turning: _Turning, items: _Items, first: Array) -> _Arcs:
    """Subtract the intervals of the items in ``words``, one per row and round."""

    def busy(state: tuple[_Arcs, Array]) -> Array:
        return jnp.any(state[1] != 0)

    def step(state: tuple[_Arcs, Array]) -> tuple[_Arcs, Array]:
        arcs, left = state
        item, left, live = _next(left, arcs.start, arcs.end)
        start, end, whole = _interval(turning, *_picked(items, item))
        return _without(arcs, start, end, first + item, live, whole), left

    return lax.while_loop(busy, step, (arcs, words))[0]


@fused_separately
def _next(words: Array, start: Array, end: Array) -> tuple[Array, Array, Array]:
    """The first item in ``words``, the words without it, and whether there is one; none where nothing is free."""
    words = jnp.where(jnp.any(start < end, axis=0), words, jnp.uint32(0))
    place = jnp.arange(len(words), dtype=jnp.int32)[:, None, None]
    word = jnp.min(jnp.where(words != 0, place, len(words)), axis=0)
    lowest = jnp.where(place == word, words & (~words + jnp.uint32(1)), jnp.uint32(0))
    bit = lax.population_count(jnp.sum(lowest, axis=0, dtype=jnp.uint32) - jnp.uint32(1))
    live = word < len(words)
    item = jnp.where(live, word * _WORD + bit.astype(jnp.int32), 0)
    return item, words & ~lowest, live


def _picked(items: _Items, item: Array) -> _Items:
    """One item per elbow bit and row, ``(..., n)``."""
    flat = item.reshape(-1, item.shape[-1])
    return jax.tree.map(lambda x: jnp.take_along_axis(x, flat, 0).reshape(item.shape), items)


def _interval(turning: _Turning, *item: Array) -> tuple[Array, Array, Array]:
    """Blocked swivels: where they start and end, within [-pi, pi], and whether they are all."""
    return _blocked_interval(*turning, *item)


@fused_separately
def _blocked_interval(*both: Array) -> tuple[Array, Array, Array]:
    turning, item = _Turning(*both[:5]), _Items(*both[5:])
    room, most = _room_and_most(turning, item)
    center, half = _center_and_half(turning, item, room, most)
    return principal(center - half), principal(center + half), room <= -most


def _room_and_most(turning: _Turning, item: _Items) -> tuple[Array, Array]:
    """Room of a pair but for the swivel, and the largest part of the swivel."""
    room = item.round * turning.square + item.room - item.size * turning.radius
    return room - item.along * turning.along, item.across * turning.across


def _center_and_half(turning: _Turning, item: _Items, room: Array, most: Array) -> tuple[Array, Array]:
    return item.angle - turning.angle, arctan2(clipped_sqrt((most - room) * (most + room)), room)


@fused_separately
def _without(arcs: _Arcs, start: Array, end: Array, pair: Array, live: Array, whole: Array) -> _Arcs:
    """Free arcs without a blocked interval; an arc that it divides takes a second place."""
    a, b, first, last = arcs
    across_seam = start > end
    before = (a < start) & ~across_seam  # a part is left before the interval
    behind = (b > end) & ~across_seam
    from_end = jnp.where(across_seam, a < end, ~before & (a < end))
    to_start = jnp.where(across_seam, b > start, before & (b > start))
    new_a, new_b = jnp.where(from_end, end, a), jnp.where(to_start, start, b)
    new_first, new_last = jnp.where(from_end, pair, first), jnp.where(to_start, pair, last)
    divided = before & behind & (a < b) & (b > start) & (a < end)
    beyond = jnp.max(jnp.where(divided, b, -jnp.inf), axis=0)
    bound = jnp.max(jnp.where(divided, last, -1), axis=0)
    place = jnp.arange(ARCS, dtype=a.dtype)[:, None, None]
    gone = (new_a >= new_b) | whole
    new_a, new_b = jnp.where(gone, _NOWHERE, new_a), jnp.where(gone, -_NOWHERE - place, new_b)
    width = new_b - new_a
    second = (width == jnp.min(width, axis=0)) & jnp.any(divided, axis=0) & ~whole & (width < beyond - end)
    new = (
        jnp.where(second, end, new_a),
        jnp.where(second, beyond, new_b),
        jnp.where(second, pair, new_first),
        jnp.where(second, bound, new_last),
    )
    return _Arcs(*(jnp.where(live, x, y) for x, y in zip(new, arcs, strict=True)))


def _with_derivative(value: Array, pair: Array, side: float, turning: _Turning, items: _Items) -> Array:
    """Ends of arcs ``(arc, elbow bit, n)`` with the derivative of the root of the pair that bounds each."""
    if not len(turning.along) or not len(items.along):
        return value
    known = pair >= 0
    sphere, item = jnp.where(known, pair, 0) // len(items.along), jnp.where(known, pair, 0) % len(items.along)
    turned = _Turning(*(jnp.take_along_axis(jnp.broadcast_to(x, turning.along.shape), sphere, 0) for x in turning))
    picked = _picked(items, item)
    center, half = _center_and_half(turned, picked, *_room_and_most(turned, picked))
    moved = jnp.where(known, center + side * half, 0.0)
    return with_value(moved, value)
