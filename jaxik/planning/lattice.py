"""Global search over swivel and branch: dynamic programming on a lattice of a few waypoints.

Coarse in time on purpose: between neighboring waypoints of a fine path the joints move less than a cell of the swivel
lattice, and all a search would see is its own quantisation (measured: 2.48 found where the optimum is 0.378). Between
waypoints far apart the straight chord in joint space is a good price.

A step keeps its branch and moves the elbow by at most ``REACH``, or passes through one singular posture: an aligned
shoulder or wrist at about the same swivel, or a straight elbow, where the elbow's circle is a point and the swivel
jumps by half a turn. What such a step costs is the joints' motion, as everywhere: only near the singular posture is it
small.

The lattice may be drawn together about a motion. Cells are counted from a center of their own for each side to which
the elbow can be bent, so that no kind of step jumps.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxik.arm import Arm
from jaxik.numerics import fused_separately
from jaxik.planning.chart import Chart, postures
from jaxik.redundancy import SwivelArcs

SWIVELS = 72  # 5 degrees: prices on them lead into the right valley; what is within it is left to a finer lattice
REACH = 8  # cells, 40 degrees: an elbow that moves faster pays more than it can win
BRANCHES, SECTORS = 4, 6  # of the last waypoint's states; the cheapest way into each is a route
ROUTES = BRANCHES + SECTORS
# Kinds of step: changed branch bit, and how far the elbow may move against the centers, in cells.
KINDS = ((0, REACH), (4, 1), (1, 1), (2, 1))
# Each step's kind, and how many cells on the swivel is that it comes from.
STEPS = np.array(
    [(kind, shift % SWIVELS) for kind, (_, reach) in enumerate(KINDS) for shift in range(-reach, reach + 1)]
)


class Lattice(NamedTuple):
    """States of n waypoints: 8 branches times ``SWIVELS`` swivels.

    Attributes:
        swivel: ``(8, SWIVELS, n)`` [rad], evenly spaced but at the ends of arcs.
        q: ``(joint, 8, SWIVELS, n)`` [rad].
        allowed: Inside limits and keep-out, ``(8, SWIVELS, n)``.
    """

    swivel: Array
    q: Array
    allowed: Array


class Routes(NamedTuple):
    """The cheapest ways through the lattice, into a few last branches and into each sector of the circle.

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


def make_lattice(arm: Arm, chart: Chart, arcs: SwivelArcs, center: Array, width: Array) -> Lattice:
    """Postures at the chart's waypoints, ``width`` of swivels about a center for each elbow bit, ``(2, n)`` [rad].

    Swivels just outside an arc are moved to its end: the best motion often keeps to a limit, and narrow arcs would have
    none.
    """
    swivel, allowed = _swivels(arcs, center, width)
    return Lattice(swivel, postures(arm, chart, swivel, jnp.arange(8)[:, None, None]), allowed)


@fused_separately
def _swivels(arcs: SwivelArcs, center: Array, width: Array) -> tuple[Array, Array]:
    """The lattice's swivels and which are allowed, ``(8, SWIVELS, n)``."""
    dtype = arcs.start.dtype
    turn, spacing = 2 * jnp.pi, width / SWIVELS
    grid = (
        center[np.arange(8) >> 1 & 1, None] + spacing * (jnp.arange(SWIVELS, dtype=dtype) - (SWIVELS - 1) / 2)[:, None]
    )
    start, span = (jnp.moveaxis(x, 0, -1) for x in (arcs.start, arcs.end - arcs.start))
    span = jnp.where(jnp.moveaxis(arcs.valid, 0, -1), span, -1.0)

    def look(arc: Array, found: tuple[Array, Array]) -> tuple[Array, Array]:
        inside, moved = found
        first, length = start[:, arc, None], span[:, arc, None]
        offset = grid - first
        offset = offset - turn * jnp.floor(offset / turn)
        before = (length >= 0) & (turn - offset < spacing)
        behind = (length >= 0) & (offset > length) & (offset < length + spacing)
        return inside | (offset <= length), jnp.where(before, first, jnp.where(behind, first + length, moved))

    shape = (8, SWIVELS, span.shape[-1])
    found = jnp.zeros(shape, bool), jnp.full(shape, jnp.inf, dtype)
    inside, moved = lax.fori_loop(0, span.shape[1], look, found)
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

    Prices carry the lattice's own coarseness, and valleys that are close are told apart by a polish only: whence many
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

    @fused_separately  # by itself: loops over a slice that moves are not vectorized
    def source_of(before: Array, step: Array) -> Array:
        return lax.dynamic_slice(before, (step[0], 0, 0, 0, step[1]), shape)[0]

    limits = motion_weight, velocity_limit, turning
    prices = lax.map(lambda step: _price(source_of(before, step), after, dt, *limits), jnp.asarray(STEPS))
    flat = jnp.swapaxes(prices, 0, 1).reshape(-1, len(STEPS), 8 * SWIVELS)
    nodes = jnp.moveaxis(jnp.where(lattice.allowed, node, jnp.inf), -1, 0).reshape(-1, 8 * SWIVELS)

    # Forward the values only: a minimum over rows is plain vector code, an argmin is not.
    def forward(value: Array, layer: tuple[Array, Array]) -> tuple[Array, Array]:
        price, node = layer
        value = (_at_sources(value) + price).min(axis=0) + node
        return value, value

    _, values = lax.scan(forward, nodes[0], (flat, nodes[1:]))
    values = jnp.concatenate([nodes[:1], values])
    sources = jnp.asarray(_sources())

    def backward(state: Array, layer: tuple[Array, Array]) -> tuple[Array, Array]:
        value, price = layer
        origins = sources[:, state]  # (step, route)
        choice = jnp.argmin(value[origins] + price[:, state], axis=0)
        previous = jnp.take_along_axis(origins, choice[None], 0)[0]
        return previous, previous

    ends = values[-1].reshape(8, SWIVELS)
    branch = jnp.argsort(ends.min(axis=-1))[:BRANCHES]
    by_branch = jnp.argmin(ends, axis=-1)[branch] + SWIVELS * branch
    # Arms that bend in mirrored ways pay the same in all branches: there the swivel is what makes a difference.
    sector = ends.reshape(8, SECTORS, -1).swapaxes(0, 1).reshape(SECTORS, -1).argmin(axis=-1)
    inside, size = jnp.arange(SECTORS), SWIVELS // SECTORS
    last = jnp.concatenate([by_branch, sector // size * SWIVELS + inside * size + sector % size])
    _, states = lax.scan(backward, last, (values[:-1], flat), reverse=True)
    states = jnp.concatenate([states, last[None]])
    swivel = jnp.take_along_axis(lattice.swivel.reshape(8 * SWIVELS, -1), states.T, 0)
    return Routes(swivel, states.T // SWIVELS, values[-1, last], jnp.isfinite(values).any(axis=1))


@fused_separately
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
    """Values ``(states,)`` where each step comes from, ``(step, states)``."""
    doubled = _doubled(value.reshape(8, SWIVELS))
    return jnp.stack([doubled[kind, :, start : start + SWIVELS].ravel() for kind, start in STEPS])


def _sources() -> np.ndarray:
    """State that each step comes from, ``(step, 8 * SWIVELS)``."""
    branch, cell = np.divmod(np.arange(8 * SWIVELS), SWIVELS)
    return np.array([(branch ^ KINDS[kind][0]) * SWIVELS + (cell + start) % SWIVELS for kind, start in STEPS])
