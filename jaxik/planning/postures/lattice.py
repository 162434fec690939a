"""Global search over postures: dynamic programming on a lattice of a few waypoints, whatever the arm's branches are.

States are the postures at 64 redundancy parameters, in every slot of the arm's solver. A step may lead from any state
to any other and costs its joint motion, so that nothing has to be known of how branches meet: only where they do is
that small. As for arms with a swivel (:mod:`jaxik.planning.lattice`), the waypoints are few on purpose.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxik import energy as energies
from jaxik.numerics import shortest
from jaxik.planning.cost import approach_energy
from jaxik.planning.feasible_targets import STATES
from jaxik.planning.problem import PlanningProblem

ROUTES = 16  # and starts of closed routes: the best of as many groups of neighbors
_TOO_FAST = 1e15  # above every energy, and small enough to be added up in single precision
_BLOCKED = 1e2  # rad²; cost of a violation of limits by one radian, where one of some size cannot be helped
_TIE_BREAK = 1e-6  # share of plain joint motion added in the search, for energies that no single step shows


class PostureRoutes(NamedTuple):
    """The cheapest paths through the lattice into groups of last states.

    Attributes:
        q: Joint angles, ``(ROUTES, n, joint)`` [rad], without jumps of a full turn.
        cost: Cost of each route, ``(ROUTES,)``; infinite where there is none.
        reached: True where a path leads from the first waypoint, ``(n,)``.
    """

    q: Array
    cost: Array
    reached: Array


class _Layer(NamedTuple):
    """States of a waypoint, and the step that leads to it.

    Attributes:
        q: Joint angles and, if their work counts, static torques, ``(row, STATES)``.
        node: Static cost, infinite where it is forbidden, ``(STATES,)``.
        dt: Duration of the step [s]; infinite for none.
    """

    q: Array
    node: Array
    dt: Array


def posture_routes(problem: PlanningProblem) -> PostureRoutes:
    """Return the cheapest routes through a problem of a few waypoints, in single precision."""
    layers = _layers(problem)
    first, rest = _at(layers, 0), _at(layers, slice(1, None))
    weights, limit = _single((_weights(problem), problem.arm.velocity_limit))
    turning = problem.arm.turning

    def costs(before: _Layer, after: _Layer, states: Array | slice = slice(None)) -> Array:
        """Costs of the steps ``(from, to)``."""
        return _step_costs(before.q, after.q[:, states], after.dt, weights, limit, turning)

    def forward(state: tuple[Array, _Layer], after: _Layer) -> tuple[tuple[Array, _Layer], Array]:
        value, before = state
        best = jnp.min(value[:, :, None] + costs(before, after), axis=1) + after.node
        value = jnp.where(jnp.isinf(after.dt), value, best)
        return (value, after), value

    def values_from(start: Array) -> Array:
        return jnp.concatenate([start[None], lax.scan(forward, (start, first), rest)[1]])  # (n, start, state)

    values = values_from(first.node[None])
    reached = jnp.any(jnp.where(values < _TOO_FAST, values, jnp.inf) < jnp.inf, axis=(1, 2))
    last = _best_of_groups(values[-1, 0])
    own, ends = jnp.zeros_like(last), values[-1, 0, last]
    if problem.closed is not None:
        alone = jnp.where(jnp.arange(STATES) == last[:, None], first.node, jnp.inf)
        values, own = values_from(alone), jnp.arange(ROUTES)
        ends = values[-1, own, last]

    def backward(state: Array, layers: tuple[Array, _Layer, _Layer]) -> tuple[Array, Array]:
        value, before, after = layers
        choice = jnp.argmin(value[own].T + costs(before, after, state), axis=0)
        previous = jnp.where(jnp.isinf(after.dt), state, choice.astype(state.dtype))
        return previous, previous

    _, states = lax.scan(backward, last, (values[:-1], _at(layers, slice(-1)), rest), reverse=True)
    states = jnp.concatenate([states, last[None]])
    q = jnp.take_along_axis(layers.q[:, : problem.arm.n_joints], states[:, None], axis=2)  # (n, joint, route)
    q = jnp.moveaxis(q, -1, 0).astype(problem.time.dtype)
    return PostureRoutes(q, jnp.where(ends < _TOO_FAST, ends, jnp.inf), reached)


def _at(layers: _Layer, index: Any) -> _Layer:
    return _Layer(*(x[index] for x in layers))


def _layers(problem: PlanningProblem) -> _Layer:
    """States of all waypoints."""
    arm, energy, time = problem.arm, problem.energy, problem.time
    nodes: Any = problem.arcs
    blocked, on_target = ~nodes.ok, nodes.on_target.T
    near = jnp.where(jnp.any(on_target, axis=0), on_target, True)
    allowed = jnp.where(blocked, near, nodes.allowed.T)
    q = jnp.transpose(nodes.q, (1, 2, 0)).astype(time.dtype)  # (joint, state, n)
    if problem.closed is not None:  # nothing but the first postures, in order
        end = problem.from_last()
        q, allowed = jnp.where(end, q[..., :1], q), jnp.where(end, allowed[..., :1], allowed)
    for pin in problem.pins:
        here = (jnp.arange(q.shape[-1]) == pin.row) & (jnp.arange(STATES) == 0)[:, None]
        q = jnp.where(here, pin.q[:, None, None], q)
        allowed = jnp.where(jnp.arange(q.shape[-1]) == pin.row, here, allowed)
    weights = energy.motion_weights(arm)
    rows = jnp.moveaxis(q, 0, -1)
    node = energies.node_weights(time) * energy.rest_rate(arm, rows)
    lower, upper = arm.lower[:, None, None], arm.upper[:, None, None]
    outside = jnp.where(arm.turning[:, None, None], 0.0, jnp.maximum(jnp.maximum(lower - q, q - upper), 0.0))
    per_excess = _BLOCKED * jnp.max(_weights(problem)) / jnp.min(problem.durations, initial=jnp.inf)
    node = node + jnp.where(blocked, per_excess, 0.0) * jnp.sum(outside, axis=0)
    for row, end in problem.end_postures:
        node = node.at[:, row].add(approach_energy(end, rows[:, row], weights, problem))
    rows = q if energy.separable else jnp.concatenate([q, jnp.moveaxis(energy.rest_torque(arm, rows), -1, 0)])
    node = jnp.where(allowed, node, jnp.inf)
    durations = jnp.concatenate([jnp.full_like(time[:1], jnp.inf), problem.durations])
    return _Layer(*_single((jnp.moveaxis(rows, -1, 0), node.T, durations)))


def _weights(problem: PlanningProblem) -> Array:
    weights = problem.energy.motion_weights(problem.arm)
    return weights + _TIE_BREAK * jnp.where(jnp.max(weights) == 0, 1.0, jnp.max(weights))


def _best_of_groups(value: Array) -> Array:
    """The cheapest state of each group of neighbors, ``(ROUTES,)``."""
    size = STATES // ROUTES
    return jnp.argmin(value.reshape(ROUTES, size), axis=1) + size * jnp.arange(ROUTES)


def _step_costs(before: Array, after: Array, dt: Array, weights: Array, velocity_limit: Array, turning: Array) -> Array:
    """Costs of steps between states ``(row, from)`` and ``(row, to)``: ``(from, to)``."""
    joints = len(turning)
    cost, work, fast = jnp.zeros((), dt.dtype), jnp.zeros((), dt.dtype), jnp.zeros((), bool)
    for j in range(joints):
        d = shortest(after[j] - before[j][:, None], turning[j])
        cost = cost + weights[j] * d * d
        if len(after) > joints:
            work = work + jnp.maximum(0.5 * (before[joints + j][:, None] + after[joints + j]) * d, 0.0)
        fast = fast | (jnp.abs(d) > velocity_limit[j] * dt)
    return jnp.where(fast, _TOO_FAST, cost / dt + work)


def _single(tree: Any) -> Any:
    return jax.tree.map(lambda x: x.astype(jnp.float32) if jnp.issubdtype(x.dtype, jnp.floating) else x, tree)
