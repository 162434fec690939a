"""Global search over swivel and branch: dynamic programming on a lattice of a few waypoints.

Coarse in time on purpose: between neighboring waypoints of a fine path the joints move less than a cell of the swivel
lattice, and all a search would see is its own quantisation (measured: 2.48 found where the optimum is 0.378). Between
waypoints far apart the straight chord in joint space is a good price.

A step keeps its branch and moves the elbow by at most ``REACH``, or passes through one singular posture: an aligned
shoulder or wrist at about the same swivel, or a straight elbow, where the elbow's circle is a point and the swivel
jumps by half a turn. What such a step costs is the joints' motion, as everywhere: only near the singular posture is it
small.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxik.arcs import SwivelArcs
from jaxik.arm import Arm
from jaxik.planning.chart import Chart, postures
from jaxik.staging import stage

SWIVELS = 96  # 3.75 degrees: with steps of about 0.1 rad between the searched waypoints finer cells change no route
REACH = 10  # cells, 37 degrees: an elbow that moves faster pays more than it can win
BRANCHES = 3  # in which the cheapest routes may end; the best one polished was never in a later one
ROUTES = 2 * BRANCHES
# Kinds of step: changed branch bit, the jump of the swivel and how far about it the elbow may move, in cells.
KINDS = ((0, 0, REACH), (4, 0, 1), (1, 0, 1), (2, SWIVELS // 2, 1))
# Each step's kind, and how many cells on the swivel is that it comes from.
STEPS = np.array(
    [
        (kind, (jump + shift) % SWIVELS)
        for kind, (_, jump, reach) in enumerate(KINDS)
        for shift in range(-reach, reach + 1)
    ]
)


class Lattice(NamedTuple):
    """States of n waypoints: 8 branches times ``SWIVELS`` swivels.

    Attributes:
        swivel: ``(8, SWIVELS, n)`` [rad], evenly spaced but for arcs narrower than the spacing.
        q: ``(joint, 8, SWIVELS, n)`` [rad].
        allowed: Inside limits and keep-out, ``(8, SWIVELS, n)``.
    """

    swivel: Array
    q: Array
    allowed: Array


class Routes(NamedTuple):
    """The cheapest ways through the lattice: into each of a few last branches, by each of two prices.

    Attributes:
        swivel: ``(ROUTES, n)`` [rad].
        branch: ``(ROUTES, n)``.
        cost: ``(ROUTES,)``; infinite where there is no way.
        open: Whether any way leads from the first waypoint to each, ``(n,)``.
    """

    swivel: Array
    branch: Array
    cost: Array
    open: Array


def make_lattice(arm: Arm, chart: Chart, arcs: SwivelArcs) -> Lattice:
    """All postures at the chart's waypoints.

    Swivels just outside an arc are moved to its end: the best motion often keeps to a limit, and narrow arcs would have
    none.
    """
    swivel, allowed = _swivels(arcs)
    return Lattice(swivel, postures(arm, chart, swivel, jnp.arange(8)[:, None, None]), allowed)


@stage
def _swivels(arcs: SwivelArcs) -> tuple[Array, Array]:
    """The lattice's swivels and which are allowed, ``(8, SWIVELS, n)``."""
    dtype = arcs.start.dtype
    grid = jnp.linspace(-jnp.pi, jnp.pi, SWIVELS, endpoint=False, dtype=dtype)[None, :, None]
    start, width = (jnp.moveaxis(x, 0, -1) for x in (arcs.start, arcs.end - arcs.start))
    width = jnp.where(jnp.moveaxis(arcs.valid, 0, -1), width, -1.0)
    turn, spacing = 2 * jnp.pi, 2 * jnp.pi / SWIVELS

    def look(arc: Array, found: tuple[Array, Array]) -> tuple[Array, Array]:
        inside, moved = found
        first, length = start[:, arc, None], width[:, arc, None]
        offset = grid - first
        offset = offset - turn * jnp.floor(offset / turn)
        before = (length >= 0) & (turn - offset < spacing)
        behind = (length >= 0) & (offset > length) & (offset < length + spacing)
        return inside | (offset <= length), jnp.where(before, first, jnp.where(behind, first + length, moved))

    shape = (8, SWIVELS, width.shape[-1])
    found = jnp.zeros(shape, bool), jnp.full(shape, jnp.inf, dtype)
    inside, moved = lax.fori_loop(0, width.shape[1], look, found)
    return jnp.where(inside | jnp.isinf(moved), grid, moved), inside | jnp.isfinite(moved)


def best_ways(
    lattice: Lattice,
    node: Array,
    torque: Array | None,
    dt: Array,
    motion_weight: Array,
    velocity_limit: Array,
    turning: Array,
) -> Routes:
    """Least Σ node + Σ_j w_j Δq_j² / dt + Σ_j max(τ_j Δq_j, 0), no joint faster than its limit.

    A step is priced from the lattice's own swivels, and once more from the best place between them. Neither price is
    the better one everywhere, and valleys within a hundredth of each other are told apart by a polish only: whence many
    routes.

    Args:
        lattice: The states.
        node: Cost of being in each, ``(8, SWIVELS, n)``.
        torque: τ, the joints' torques at rest whose work is paid, ``(joint, 8, SWIVELS, n)``; None for none.
        dt: Time between waypoints, ``(n - 1,)`` [s].
        motion_weight: w, ``(joint,)``.
        velocity_limit: ``(joint,)`` [rad/s].
        turning: Which joints turn without end, ``(joint,)``.
    """
    rows = lattice.q if torque is None else jnp.concatenate([lattice.q, torque])
    rows = jnp.moveaxis(rows, -1, 0)  # swivels last: a step's source is a slice of them
    before, after = _doubled(rows[:-1]), rows[1:]
    shape = (1, *after.shape)

    @stage  # by itself: loops over a slice that moves are not vectorized
    def source_of(before: Array, step: Array) -> Array:
        return lax.dynamic_slice(before, (step[0], 0, 0, 0, step[1]), shape)[0]

    limits = motion_weight, velocity_limit, turning
    prices = lax.map(lambda step: _price(source_of(before, step), after, dt, *limits), jnp.asarray(STEPS))
    flat = jnp.swapaxes(prices, 0, 1).reshape(-1, len(STEPS), 8 * SWIVELS)
    nodes = jnp.moveaxis(jnp.where(lattice.allowed, node, jnp.inf), -1, 0).reshape(-1, 8 * SWIVELS)

    # Forward the values only: a minimum over rows is plain vector code, an argmin is not.
    def forward(value: Array, layer: tuple[Array, Array]) -> tuple[Array, Array]:
        price, node = layer
        reached = _at_sources(value) + price
        value = jnp.stack([reached[0].min(axis=0), _between_sources(reached[1]).min(axis=0)]) + node
        return value, value

    first = jnp.stack([nodes[0]] * 2)
    _, values = lax.scan(forward, first, (flat, nodes[1:]))
    values = jnp.concatenate([first[None], values])
    sources = jnp.asarray(_sources())

    def backward(state: Array, layer: tuple[Array, Array]) -> tuple[Array, Array]:
        value, price = layer
        origins = sources[:, state]  # (step, table, route)
        reached = jnp.stack([value[table][origins[:, table]] + price[:, state[table]] for table in range(2)])
        choice = jnp.stack([jnp.argmin(reached[0], axis=0), jnp.argmin(_between_sources(reached[1]), axis=0)])
        previous = jnp.take_along_axis(origins, choice[None], 0)[0]
        return previous, previous

    ends = values[-1].reshape(2, 8, SWIVELS)
    branch = jnp.argsort(ends.min(axis=-1), axis=-1)[:, :BRANCHES]
    last = jnp.take_along_axis(jnp.argmin(ends, axis=-1), branch, 1) + SWIVELS * branch
    _, states = lax.scan(backward, last, (values[:-1], flat), reverse=True)
    states = jnp.concatenate([states, last[None]]).reshape(-1, ROUTES)
    swivel = jnp.take_along_axis(lattice.swivel.reshape(8 * SWIVELS, -1), states.T, 0)
    cost = jnp.take_along_axis(ends.min(axis=-1), branch, 1).reshape(ROUTES)
    return Routes(swivel, states.T // SWIVELS, cost, jnp.isfinite(values).any(axis=(1, 2)))


@stage
def _price(
    source: Array, state: Array, dt: Array, motion_weight: Array, velocity_limit: Array, turning: Array
) -> Array:
    """Cost of steps between rows of joint angles, and of torques if any, ``(step, joint, 8, SWIVELS)``."""
    joints, dt = len(turning), dt[:, None, None]
    turn = jnp.where(turning, 2 * jnp.pi, 0.0).astype(dt.dtype)
    cost, work, fast = jnp.zeros((), dt.dtype), jnp.zeros((), dt.dtype), jnp.zeros((), bool)
    for j in range(joints):
        d = state[:, j] - source[:, j]
        d = d - turn[j] * jnp.round(d / (2 * jnp.pi))
        cost = cost + motion_weight[j] * d * d
        if state.shape[1] > joints:
            work = work + jnp.maximum(0.5 * (source[:, joints + j] + state[:, joints + j]) * d, 0.0)
        fast = fast | (jnp.abs(d) > velocity_limit[j] * dt)
    return jnp.where(fast, jnp.inf, cost / dt + work)


def _doubled(x: Array) -> Array:
    """States ``(..., 8, SWIVELS)`` by kind of step, twice round the circle, ``(kind, ..., 8, 2 * SWIVELS)``.

    The source of every state by a step of ``STEPS`` is a slice of it.
    """
    bits = x.reshape(*x.shape[:-2], 2, 2, 2, SWIVELS)
    kinds = [jnp.flip(bits, -1 - bit.bit_length()) if bit else bits for bit, *_ in KINDS]
    kinds = jnp.stack([kind.reshape(x.shape) for kind in kinds])
    return jnp.concatenate([kinds, kinds], axis=-1)


def _at_sources(value: Array) -> Array:
    """Values ``(*batch, states)`` where each step comes from, ``(*batch, step, states)``."""
    doubled = _doubled(value.reshape(*value.shape[:-1], 8, SWIVELS))
    slices = [doubled[kind, ..., start : start + SWIVELS] for kind, start in STEPS]
    return jnp.stack(slices, axis=-3).reshape(*value.shape[:-1], len(STEPS), 8 * SWIVELS)


@stage
def _between_sources(reached: Array) -> Array:
    """Least cost of coming from anywhere about each swivel of the lattice: ``(step, *batch)``.

    The bottom of the parabola through a source and its neighbours, where it is the lowest of them. A motion that had
    to keep to the lattice would pay a tenth or so for zigzags, in some branches more than in others.
    """
    left, best, right = reached[: 2 * REACH - 1], reached[1 : 2 * REACH], reached[2 : 2 * REACH + 1]
    lowest = (best <= left) & (best <= right) & jnp.isfinite(left + right)
    bend, slope = left + right - 2 * best, right - left
    lowest = lowest & (bend > 0)
    lower = slope * slope / (8 * jnp.where(lowest, bend, 1.0))
    return jnp.concatenate([reached[:1], jnp.where(lowest, best - lower, best), reached[2 * REACH :]])


def _sources() -> np.ndarray:
    """State that each step comes from, ``(step, 8 * SWIVELS)``."""
    branch, cell = np.divmod(np.arange(8 * SWIVELS), SWIVELS)
    return np.array([(branch ^ KINDS[kind][0]) * SWIVELS + (cell + start) % SWIVELS for kind, start in STEPS])
