"""Other ways to a motion, to be no better than a plan: random local restarts, and brute force on a much finer grid."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

import jaxik
from jaxik.numerics import fused_separately
from jaxik.planning import swivel_grid
from jaxik.planning.initial_guess import interpolate
from jaxik.planning.lattice import KINDS, SWIVELS
from jaxik.planning.motion import from_guess, refine_best
from jaxik.planning.problem import PlanningProblem, make_problem

FINER = 20  # swivels of the brute-force grid for each of the search's own
_WAVES = 6  # of a random swivel
_ROUNDING = 1 + 1e-6


def refiner(arm: jaxik.Arm, path: jaxik.Path) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Function of swivels and branches ``(N, K)``: energies of joint motion ``(N,)``, infinite if infeasible.

    Every waypoint is refined, and a motion counts only if it keeps its arcs and all speeds.
    """
    problem = make_problem(arm, path.target, path.time)
    return lambda swivel, branch: np.asarray(_energies(problem, jnp.asarray(swivel), jnp.asarray(branch)))


@jax.jit
def _energies(problem: PlanningProblem, swivel: Array, branch: Array) -> Array:
    def energy(start: tuple[Array, Array]) -> Array:
        guess = from_guess(problem, *start)
        motion = refine_best(problem, guess._replace(swivel=guess.swivel[:1], branch=guess.branch[:1]))
        speed = jnp.abs(jnp.diff(motion.q, axis=0)) / jnp.diff(problem.time)[:, None]
        slow = jnp.all(speed <= problem.arm.velocity_limit * _ROUNDING)
        return jnp.where(slow & jnp.isfinite(motion.energy), motion.energy, jnp.inf)

    return lax.map(energy, (swivel, branch))


def random_starts(arm: jaxik.Arm, path: jaxik.Path, count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Smooth random swivels in random branches, kept in feasible arcs, ``(count, K)`` each.

    Of the branches that are feasible all along, if any are. Every fourth start changes one branch bit at a random
    waypoint, with the half turn that a change of the elbow's side takes. Where a swivel would leave its arc it stays
    at its end, so that it does not jump to another.
    """
    rng = np.random.default_rng(seed)
    waypoints = len(path)
    arcs = jax.tree.map(np.asarray, jaxik.swivel_arcs(arm, path.target))
    possible = np.flatnonzero(arcs.valid.any(axis=-1).all(axis=0))
    branch = rng.choice(possible if len(possible) else np.arange(8), (count, 1)).repeat(waypoints, axis=1)
    along = np.cos(np.outer(np.arange(1, _WAVES + 1), np.linspace(0, np.pi, waypoints)))
    swing = rng.normal(size=(count, _WAVES)) / np.arange(1, _WAVES + 1) * rng.uniform(0, 1.5, (count, 1))
    wished = rng.uniform(-np.pi, np.pi, (count, 1)) + swing @ along
    bit = np.where(np.arange(count) % 4 == 0, rng.choice([1, 2, 4], count), 0)[:, None]
    behind = np.arange(waypoints) >= rng.integers(1, waypoints, (count, 1))
    wished, branch = wished + np.pi * (behind & (bit == 2)), np.where(behind, branch ^ bit, branch)
    swivel, here = np.empty_like(wished), wished[:, 0]
    for k in range(waypoints):
        turned = here + (wished[:, k] - wished[:, max(k - 1, 0)]) * (branch[:, k] != branch[:, max(k - 1, 0)])
        start, end, valid = (x[k, branch[:, k]] for x in (arcs.start, arcs.end, arcs.valid))
        middle = (start + end) / 2
        middle = middle + 2 * np.pi * np.round((turned[:, None] - middle) / (2 * np.pi))
        half = np.where(end - start > 2 * np.pi - 1e-9, np.inf, (end - start) / 2)
        away = np.where(valid, np.maximum(np.abs(turned[:, None] - middle) - half, 0.0), np.inf)
        arc = np.argmin(away, axis=1)[:, None]
        middle, half = (np.take_along_axis(x, arc, 1)[:, 0] for x in (middle, half))
        here = swivel[:, k] = np.clip(wished[:, k], middle - half, middle + half)
    return swivel, branch


def finer_routes(arm: jaxik.Arm, path: jaxik.Path, searched: int, finer: int = FINER) -> tuple[np.ndarray, np.ndarray]:
    """Swivels and branches ``(N, K)``: the cheapest way into each last branch, through a grid so much finer.

    Dynamic programming on ``searched`` waypoints with the planner's kinds of step and its reach, rated by chords of
    joint motion; straight between them.
    """
    index = np.unique(np.linspace(0, len(path) - 1, min(searched, len(path))).round().astype(int))
    few = jax.tree.map(lambda x: x[index], path.target)
    count = SWIVELS * finer
    grid = swivel_grid(arm, few, count)
    q = np.moveaxis(grid.q, (1, 2, 3), (3, 2, 1)).astype(np.float32)  # (n, joint, 8, swivels)
    ok = np.swapaxes(grid.ok, 1, 2)
    steps = [
        (kind, shift % count)
        for kind, (_, reach) in enumerate(KINDS)
        for shift in range(-finer * reach, finer * reach + 1)
    ]
    dt = np.diff(np.asarray(path.time, np.float32)[index])
    turning = np.array(arm.turning)
    args = q, ok, dt, np.asarray(arm.velocity_limit, np.float32), turning, np.array(steps)
    value, origins = (np.asarray(x) for x in _cheapest(*map(jnp.asarray, args)))
    branches = np.flatnonzero(np.isfinite(value.min(axis=-1)))
    state = branches * count + value.argmin(axis=-1)[branches]
    states = [state]
    for origin in origins[::-1]:
        state = origin.ravel()[state]
        states.append(state)
    branch, cell = np.divmod(np.array(states[::-1]).T, count)
    problem = make_problem(arm, path.target, path.time)
    rows = [
        interpolate(problem, index, jnp.asarray(s), jnp.asarray(b))
        for s, b in zip(grid.swivel[cell], branch, strict=True)
    ]
    return tuple(np.array(x).reshape(len(branches), len(path)) for x in zip(*rows, strict=True)) if rows else ()


@jax.jit
def _cheapest(q: Array, ok: Array, dt: Array, speed: Array, turning: Array, steps: Array) -> tuple[Array, Array]:
    """Least cost of every last state ``(8, swivels)``, and where each state came from ``(n - 1, 8, swivels)``."""
    joints, _, count = q.shape[1:]
    turn = jnp.where(turning, 2 * jnp.pi, 0.0).astype(q.dtype)
    number = jnp.arange(8 * count, dtype=jnp.int32).reshape(1, 8, count)

    def doubled(x: Array) -> Array:
        kinds = jnp.stack([x[:, np.arange(8) ^ bit] for bit, *_ in KINDS])
        return jnp.concatenate([kinds, kinds], axis=-1)

    @fused_separately  # by itself: loops over a slice that moves are not vectorized
    def source_of(before: Array, step: Array) -> Array:
        return lax.dynamic_slice(before, (step[0], 0, 0, step[1]), (1, before.shape[1], 8, count))[0]

    @fused_separately
    def tried(source: Array, after: Array, dt: Array) -> Array:
        cost, fast = jnp.zeros((), q.dtype), jnp.zeros((), bool)
        for j in range(joints):
            d = after[j] - source[j]
            d = d - turn[j] * jnp.round(d / (2 * jnp.pi))
            cost, fast = cost + d * d, fast | (jnp.abs(d) > speed[j] * dt)
        return source[joints] + jnp.where(fast, jnp.inf, cost / dt)

    def forward(value: Array, layer: tuple[Array, ...]) -> tuple[Array, Array]:
        before, after, allowed, dt = layer
        sources = doubled(jnp.concatenate([before, value[None]]))
        origins = doubled(number)

        def step(carry: tuple[Array, Array], step: Array) -> tuple[tuple[Array, Array], None]:
            least, origin = carry
            cost = tried(source_of(sources, step), after, dt)
            better = cost < least
            return (jnp.where(better, cost, least), jnp.where(better, source_of(origins, step)[0], origin)), None

        none = jnp.full((8, count), jnp.inf, q.dtype), jnp.zeros((8, count), jnp.int32)
        (least, origin), _ = lax.scan(step, none, steps)
        return jnp.where(allowed, least, jnp.inf), origin

    first = jnp.where(ok[0], jnp.zeros((), q.dtype), jnp.inf)
    return lax.scan(forward, first, (q[:-1], q[1:], ok[1:], dt))
