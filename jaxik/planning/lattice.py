"""Global search over swivel and branch: dynamic programming on a lattice of a few waypoints.

Coarse in time on purpose: between neighboring waypoints of a fine path the joints move less than a cell of the swivel
lattice, and a search would see nothing but its own quantization (measured: 2.48 found where the optimum is 0.378).
Between waypoints far apart the straight chord in joint space is a good estimate of the cost.

A step keeps its branch and moves the elbow by at most ``REACH``, or passes through one singular posture: an aligned
shoulder or wrist at about the same swivel, or a straight elbow, where the elbow's circle is a point and the swivel
jumps by half a turn. Such a step costs its joint motion, as every step does: only near the singular posture is that
small.

The lattice may be narrowed about a motion. Cells are counted from a center of their own for each side to which the
elbow can be bent, so that no kind of step jumps.

The route of a closed path ends in the state in which it begins. It is searched from a few of the states of each branch,
evenly spread over the circle: the best of their neighborhoods by the cheapest open route that ends there, which no
closed one undercuts. Where between two lattice states the best first posture lies is left to the refinement.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxik.arm import Arm
from jaxik.ik import BRANCHES, branch_bits
from jaxik.numerics import fused_separately, shortest
from jaxik.redundancy import ParameterMotion, SelfMotion, SwivelArcs, has_swivel

SWIVELS = 72  # 5 degrees: fine enough to find the right basin, within which a finer lattice is laid
REACH = 8  # cells, 40 degrees: an elbow that moves faster costs more than it can gain
LAST_BRANCHES, SECTORS = 4, 6  # of the last waypoint's states; the cheapest path into each is a route
ROUTES = LAST_BRANCHES + SECTORS
STARTS = 12  # per branch, from which closed routes are searched: one in 30 degrees
# Kinds of step: changed branch bit, and how far the elbow may move relative to the centers, in cells.
KINDS = ((0, REACH), (4, 1), (1, 1), (2, 1))
# Kind of each step, and the cells between the swivel it starts from and its own.
STEPS = np.array(
    [(kind, shift % SWIVELS) for kind, (_, reach) in enumerate(KINDS) for shift in range(-reach, reach + 1)]
)
_TOO_FAST = 1e15  # above every energy, and small enough to be added up in single precision


class Lattice(NamedTuple):
    """States of n waypoints: 8 branches times ``SWIVELS`` swivels.

    Attributes:
        swivel: ``(8, SWIVELS, n)`` [rad], evenly spaced but at the ends of arcs.
        q: ``(joint, 8, SWIVELS, n)`` [rad].
        allowed: True inside limits and keep-out, ``(8, SWIVELS, n)``.
    """

    swivel: Array
    q: Array
    allowed: Array


class Routes(NamedTuple):
    """The cheapest paths through the lattice, into a few last branches and into each sector of the circle.

    Attributes:
        swivel: Swivels of each route, ``(ROUTES, n)`` [rad].
        branch: Branches of each route, ``(ROUTES, n)``.
        cost: Cost of each route, ``(ROUTES,)``; infinite where there is none.
        reached: True where a path leads from the first waypoint, ``(n,)``.
    """

    swivel: Array
    branch: Array
    cost: Array
    reached: Array


def whole_circle(arm: Arm, time: Array) -> Array:
    """Return centers of lattices that leave out nothing, ``(2, K)`` [rad].

    Through a straight elbow the arm plane is continuous: half a turn of swivel between the elbow's two sides. An outer
    joint stays where it is.
    """
    turn = jnp.pi if has_swivel(arm) else 0.0
    return jnp.broadcast_to(jnp.asarray([[0.0], [turn]], time.dtype), (2, len(time)))


def make_lattice(motion: SelfMotion | ParameterMotion, arcs: SwivelArcs, center: Array, width: Array) -> Lattice:
    """Return the states of n waypoints: ``width`` of swivels about a center for each elbow bit, ``(2, n)`` [rad].

    Swivels just outside an arc are moved to its end: the best motion often keeps to a limit, and narrow arcs would hold
    no state.
    """
    swivel, allowed = _swivels(arcs, center, width)
    return Lattice(swivel, motion.branch(np.arange(BRANCHES)[:, None, None]).angles(swivel), allowed)


@fused_separately
def _swivels(arcs: SwivelArcs, center: Array, width: Array) -> tuple[Array, Array]:
    """Swivels of the lattice and which are allowed, ``(8, SWIVELS, n)``."""
    dtype = arcs.start.dtype
    turn, spacing = 2 * jnp.pi, width / SWIVELS
    centers = jnp.where(branch_bits(np.arange(BRANCHES)).elbow[:, None, None], center[1], center[0])
    grid = centers + spacing * (jnp.arange(SWIVELS, dtype=dtype) - (SWIVELS - 1) / 2)[:, None]
    start, span = (jnp.moveaxis(x, 0, -1) for x in (arcs.start, arcs.end - arcs.start))
    span = jnp.where(jnp.moveaxis(arcs.valid, 0, -1), span, -1.0)

    def move_into(arc: Array, found: tuple[Array, Array]) -> tuple[Array, Array]:
        inside, moved = found
        first, length = start[:, arc, None], span[:, arc, None]
        offset = grid - first
        offset = offset - turn * jnp.floor(offset / turn)
        before = (length >= 0) & (turn - offset < spacing)
        behind = (length >= 0) & (offset > length) & (offset < length + spacing)
        return inside | (offset <= length), jnp.where(before, first, jnp.where(behind, first + length, moved))

    shape = (8, SWIVELS, span.shape[-1])
    found = jnp.zeros(shape, bool), jnp.full(shape, jnp.inf, dtype)
    inside, moved = lax.fori_loop(0, span.shape[1], move_into, found)
    return jnp.where(inside | jnp.isinf(moved), grid, moved), inside | jnp.isfinite(moved)


def best_routes(
    lattice: Lattice,
    node: Array,
    torque: Array | None,
    dt: Array,
    motion_weights: Array,
    velocity_limit: Array,
    turning: Array,
    *,
    closed: bool = False,
) -> Routes:
    """Minimize Σ node + Σ_j w_j Δq_j² / dt + Σ_j max(τ_j Δq_j, 0), no joint faster than its limit.

    Lattice costs are too coarse to rank nearby local minima, so several routes are returned for refinement.

    Args:
        lattice: The states.
        node: Static cost of each state, ``(8, SWIVELS, n)``.
        torque: Static torques τ whose work counts, ``(joint, 8, SWIVELS, n)``; None for none.
        dt: Time between waypoints, ``(n - 1,)`` [s]; infinite for no step, where waypoints pad a path.
        motion_weights: Weights w, ``(joint,)``.
        velocity_limit: Speed limits, ``(joint,)`` [rad/s].
        turning: Joints whose range exceeds a turn, ``(joint,)``.
        closed: True for routes that end in the state in which they begin.

    Returns:
        The routes; ``reached`` is that of open ones.
    """
    rows = lattice.q if torque is None else jnp.concatenate([lattice.q, torque])
    rows = jnp.moveaxis(rows, -1, 0)  # swivels last: a step's source is a slice of them
    before, after = _doubled(rows[:-1]), rows[1:]
    shape = (1, *after.shape)

    @fused_separately  # by itself: loops over a slice that moves are not vectorized
    def source_of(before: Array, step: Array) -> Array:
        return lax.dynamic_slice(before, (step[0], 0, 0, 0, step[1]), shape)[0]

    limits = motion_weights, velocity_limit, turning
    costs = lax.map(lambda step: _step_costs(source_of(before, step), after, dt, *limits), jnp.asarray(STEPS))
    flat = jnp.swapaxes(costs, 0, 1).reshape(-1, len(STEPS), 8 * SWIVELS)
    nodes = jnp.moveaxis(jnp.where(lattice.allowed, node, jnp.inf), -1, 0).reshape(-1, 8 * SWIVELS)

    # Forward the values only: a minimum over rows is plain vector code, an argmin is not.
    def forward(value: Array, layer: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        cost, node, moves = layer
        value = jnp.where(moves, _least(value, cost) + node, value)
        return value, value

    moves = ~jnp.isinf(dt)

    def values_from(first: Array) -> Array:
        """Cost of the cheapest route into each state, ``(n, ..., states)``."""
        return jnp.concatenate([first[None], lax.scan(forward, first, (flat, nodes[1:], moves))[1]])

    values = values_from(nodes[0])
    reached = jnp.isfinite(jnp.where(values < _TOO_FAST, values, jnp.inf)).any(axis=1)
    sources = jnp.asarray(_sources())
    if closed:
        starts = _starts(values[-1])
        alone = jnp.where(jnp.arange(8 * SWIVELS) == starts[:, None], nodes[0], jnp.inf)
        values = values_from(alone)  # (n, start, states)
        returned = values[-1, jnp.arange(len(starts)), starts]
        last_values = jnp.full(8 * SWIVELS, jnp.inf, returned.dtype).at[starts].set(returned)
    else:
        starts, values, last_values = None, values[:, None], values[-1]

    ends = last_values.reshape(8, SWIVELS)
    branch = jnp.argsort(ends.min(axis=-1))[:LAST_BRANCHES]
    by_branch = jnp.argmin(ends, axis=-1)[branch] + SWIVELS * branch
    # For an arm whose branches mirror each other they cost the same: there the swivel makes the difference.
    sector = ends.reshape(8, SECTORS, -1).swapaxes(0, 1).reshape(SECTORS, -1).argmin(axis=-1)
    inside, size = jnp.arange(SECTORS), SWIVELS // SECTORS
    last = jnp.concatenate([by_branch, sector // size * SWIVELS + inside * size + sector % size])
    # The values that each route's costs were added up in: one for all, or those of its start.
    own = jnp.zeros_like(last) if starts is None else jnp.argmax(starts[:, None] == last, axis=0)

    def backward(state: Array, layer: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        value, cost, moves = layer
        origins = sources[:, state]  # (step, route)
        choice = jnp.argmin(value[own, origins] + cost[:, state], axis=0)
        previous = jnp.where(moves, jnp.take_along_axis(origins, choice[None], 0)[0], state)
        return previous, previous

    _, states = lax.scan(backward, last, (values[:-1], flat, moves), reverse=True)
    states = jnp.concatenate([states, last[None]])
    swivel = jnp.take_along_axis(lattice.swivel.reshape(8 * SWIVELS, -1), states.T, 0)
    # Steps that are too fast are no steps; but where there are no others, the routes with the fewest are told.
    costs = last_values[last]
    return Routes(swivel, states.T // SWIVELS, jnp.where(costs < _TOO_FAST, costs, jnp.inf), reached)


def _starts(values: Array) -> Array:
    """The cheapest state of each neighborhood, of values ``(states,)`` at the last waypoint: ``(8 * STARTS,)``."""
    cheapest = jnp.argmin(values.reshape(8 * STARTS, -1), axis=1)
    return cheapest + SWIVELS // STARTS * jnp.arange(8 * STARTS)


@fused_separately
def _step_costs(
    source: Array, state: Array, dt: Array, motion_weights: Array, velocity_limit: Array, turning: Array
) -> Array:
    """Costs of steps between rows of joint angles, and of torques if any, ``(step, joint, 8, SWIVELS)``."""
    joints, dt = len(turning), dt[:, None, None]
    cost, work, fast = jnp.zeros((), dt.dtype), jnp.zeros((), dt.dtype), jnp.zeros((), bool)
    for j in range(joints):
        d = shortest(state[:, j] - source[:, j], turning[j])
        cost = cost + motion_weights[j] * d * d
        if state.shape[1] > joints:
            work = work + jnp.maximum(0.5 * (source[:, joints + j] + state[:, joints + j]) * d, 0.0)
        fast = fast | (jnp.abs(d) > velocity_limit[j] * dt)
    return jnp.where(fast, _TOO_FAST, cost / dt + work)


def _doubled(x: Array) -> Array:
    """Arrange states ``(..., 8, SWIVELS)`` by kind of step, twice round the circle: ``(kind, ..., 8, 2 * SWIVELS)``.

    The source of every state by a step of ``STEPS`` is a slice of it.
    """
    bits = x.reshape(*x.shape[:-2], 2, 2, 2, SWIVELS)
    kinds = [jnp.flip(bits, -1 - bit.bit_length()) if bit else bits for bit, *_ in KINDS]
    kinds = jnp.stack([kind.reshape(x.shape) for kind in kinds])
    return jnp.concatenate([kinds, kinds], axis=-1)


def _least(value: Array, cost: Array) -> Array:
    """Least sum of the value ``(..., states)`` at a step's source and the step's cost ``(step, states)``."""
    doubled = _doubled(value.reshape(*value.shape[:-1], 8, SWIVELS))
    least = jnp.full((), jnp.inf, value.dtype)
    for (kind, start), into in zip(STEPS, cost.reshape(-1, 8, SWIVELS), strict=True):
        least = jnp.minimum(least, doubled[kind, ..., start : start + SWIVELS] + into)
    return least.reshape(value.shape)


def _sources() -> np.ndarray:
    """Source of each step, ``(step, 8 * SWIVELS)``."""
    branch, cell = np.divmod(np.arange(8 * SWIVELS), SWIVELS)
    return np.array([(branch ^ KINDS[kind][0]) * SWIVELS + (cell + start) % SWIVELS for kind, start in STEPS])
