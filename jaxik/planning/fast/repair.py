"""Repair: swivels moved into the exact feasible arcs, and whole paths refined there where that is not enough.

1. Nearly all waypoints are inside their limits as they are, and their joint angles show it. Arcs are computed for the
   others, some at a time, each of which moves into the nearest arc of its branch.
2. Waypoints moved one by one make a kink. Where that costs energy, or leaves no motion, the whole path takes a few
   Newton steps of :mod:`jaxik.planning.refinement` in its arcs; while it costs much more than without limits, so do the
   other candidates.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxik import energy as energies
from jaxik.arm import Arm
from jaxik.ik import BRANCHES
from jaxik.numerics import principal
from jaxik.planning.fast.path_batch import PathBatch, SwivelPath
from jaxik.planning.initial_guess import into_arcs
from jaxik.planning.problem import EndPosture, PlanningProblem
from jaxik.planning.refinement import refine
from jaxik.redundancy import feasible_arcs

STEPS = 3  # Newton steps: where nine waypoints had been moved, one reaches 0.02 %
_WAYPOINTS = 128  # whose arcs are computed at once
_INSIDE = 1e-5  # distance from a limit below which the arcs decide [rad, arm lengths]
_KINK = 1.005  # times the motion's energy: beyond, the path is refined
_ENOUGH = 1.05  # times the energy without limits: no other candidate is tried
_POOR = 100.0  # times the energy without limits: every branch is tried
_LEAST_RATE = 1e-6  # of an approach that does not count [1/s]

Others = Callable[[Array, Array], SwivelPath]
"""Function of a path and a number that returns one more motion of the path, ``(K,)``; the first keeps one branch."""


class Repaired(NamedTuple):
    """Motions within the feasible arcs.

    Attributes:
        path: Swivels and branches, ``(K, B)``; where there is no motion, swivels are nan at the waypoints without an
            arc in the branch that has most.
        q: Joint angles, ``(joint, K, B)`` [rad]; nan where the swivel is.
        feasible: True where every waypoint has a swivel, ``(B,)``.
    """

    path: SwivelPath
    q: Array
    feasible: Array


class _Ranked(NamedTuple):
    """A motion of one path and what it is ranked by: waypoints without an arc, then joints too fast, then energy."""

    missing: Array
    fast: Array
    energy: Array
    path: SwivelPath


def repair(batch: PathBatch, path: SwivelPath, others: Others, count: int, steps: int = STEPS) -> Repaired:
    """Return motions in the feasible arcs near to motions that may leave them.

    Args:
        batch: The paths.
        path: Their motions, ``(K, B)``.
        others: Gives other motions of a path.
        count: Number of other motions of each path.
        steps: Newton steps of a path that is refined; 0 where the energy is another, and kinks stay as they are.
    """
    motion = batch.motion.branch(path.branch)
    before = motion.angles(path.swivel)
    smooth = batch.energy(before)
    roomy = jnp.all(motion.keep_out_distance(path.swivel) >= _INSIDE * batch.arm.length, axis=0)
    if motion.free is not None:
        roomy = roomy & motion.free.contain(principal(path.swivel), -_INSIDE)
    outside = ~(_inside(batch.arm, before) & roomy & batch.motion.solvable)
    swivel, q = _each_into_its_arc(batch, path, before, outside)

    moved = jnp.any(outside, axis=0)
    # An interpolated swivel may miss the alignment at which the branch changes.
    changes = jnp.any(path.branch != path.branch[:1], axis=0)
    broken = jnp.any(jnp.isnan(swivel), axis=0) | ((moved | changes) & batch.too_fast(q))
    if steps:
        broken = broken | (moved & (batch.energy(q) > _KINK * smooth))
    broken = broken & jnp.all(batch.motion.solvable, axis=0)  # a target out of reach stays without a swivel

    def one_path(state: tuple[Array, ...]) -> tuple[Array, ...]:
        broken, swivel, branch, q = state
        row = jnp.argmax(broken)
        first = SwivelPath(path.swivel[:, row], path.branch[:, row])
        best = _refined(batch.path(row), first, partial(others, row), count, smooth[row], steps)
        joints = batch.motion.at(row).branch(best.branch).angles(best.swivel)
        return (
            broken.at[row].set(False),
            swivel.at[:, row].set(best.swivel),
            branch.at[:, row].set(best.branch),
            q.at[..., row].set(joints),
        )

    state = broken, swivel, path.branch, q
    _, swivel, branch, q = lax.while_loop(lambda state: jnp.any(state[0]), one_path, state)
    q = jnp.where(jnp.isnan(swivel), jnp.nan, q)  # joint 4 would have an angle
    return Repaired(SwivelPath(swivel, branch), q, jnp.all(jnp.isfinite(swivel), axis=0))


def _each_into_its_arc(batch: PathBatch, path: SwivelPath, q: Array, outside: Array) -> tuple[Array, Array]:
    """Swivels and joint angles with the waypoints outside in the nearest arc, each by itself."""
    count = outside.shape[1]

    def some_waypoints(state: tuple[Array, ...]) -> tuple[Array, ...]:
        left, swivel, q = state
        (places,) = jnp.nonzero(left.reshape(-1), size=min(_WAYPOINTS, left.size), fill_value=left.size)
        at = jnp.minimum(places, left.size - 1)
        rows = at // count, at % count
        motion, branch = batch.motion.at(*rows), path.branch[rows]
        moved = into_arcs(feasible_arcs(motion), swivel[rows], branch).swivel
        angles = motion.branch(branch).angles(moved)
        flat = lambda x: x.reshape(*x.shape[:-2], -1)  # noqa: E731
        return (
            flat(left).at[places].set(False, mode="drop").reshape(left.shape),
            flat(swivel).at[places].set(moved, mode="drop").reshape(swivel.shape),
            flat(q).at[:, places].set(angles, mode="drop").reshape(q.shape),
        )

    state = outside, path.swivel, q
    _, swivel, q = lax.while_loop(lambda state: jnp.any(state[0]), some_waypoints, state)
    return swivel, q


def _refined(
    batch: PathBatch, first: SwivelPath, others: Callable[[Array], SwivelPath], count: int, smooth: Array, steps: int
) -> SwivelPath:
    """The best motion in the arcs of a batch of one path, from one given and, while that is poor, from others."""
    motion = batch.motion.at(0)
    energy = energies.joint_motion(batch.weights)
    start = EndPosture(batch.start.q[:, 0], 1.0 / jnp.maximum(batch.start.rate[0], _LEAST_RATE))
    problem = PlanningProblem(motion, feasible_arcs(motion), batch.time[:, 0], energy, start)

    def ranked(path: SwivelPath) -> _Ranked:
        q = motion.branch(path.branch).angles(path.swivel)[..., None]
        return _Ranked(jnp.sum(jnp.isnan(path.swivel)), batch.too_fast(q)[0], batch.energy(q)[0], path)

    def in_arcs(path: SwivelPath) -> _Ranked:
        if not steps:
            return ranked(SwivelPath(into_arcs(problem.arcs, *path).swivel, path.branch))
        return ranked(SwivelPath(refine(problem, *path, steps).newton.x, path.branch))

    def in_every_branch(best: _Ranked) -> _Ranked:
        swivel, _ = others(jnp.zeros((), jnp.int32))

        def try_branch(best: _Ranked, branch: Array) -> tuple[_Ranked, None]:
            guess = into_arcs(problem.arcs, swivel, jnp.full(swivel.shape, branch))
            return _better(ranked(SwivelPath(guess.swivel, guess.branch)), best), None

        return lax.scan(try_branch, best, jnp.arange(BRANCHES, dtype=first.branch.dtype))[0]

    def within(best: _Ranked, factor: float) -> Array:
        return (best.missing == 0) & ~best.fast & (best.energy <= factor * smooth)

    def next_one(state: tuple[Array, _Ranked]) -> tuple[Array, _Ranked]:
        number, best = state
        path = lax.cond(number == 0, lambda: first, lambda: others(number - 1))
        return number + 1, _better(in_arcs(path), best)

    nothing = SwivelPath(jnp.full_like(first.swivel, jnp.nan), first.branch)
    none = ranked(nothing)._replace(missing=jnp.asarray(len(first.swivel) + 1))
    poor = lambda state: (state[0] <= count) & ~within(state[1], _ENOUGH)  # noqa: E731
    _, best = lax.while_loop(poor, next_one, (jnp.zeros((), jnp.int32), none))
    return lax.cond(within(best, _POOR), lambda best: best, in_every_branch, best).path


def _better(a: _Ranked, b: _Ranked) -> _Ranked:
    """The better of two motions, the second of equal ones; an energy that is nan is above every other."""
    slower = ~a.fast & b.fast
    cheaper = (a.fast == b.fast) & ((a.energy < b.energy) | (jnp.isnan(b.energy) & ~jnp.isnan(a.energy)))
    fewer = (a.missing < b.missing) | ((a.missing == b.missing) & (slower | cheaper))
    return jax.tree.map(lambda x, y: jnp.where(fewer, x, y), a, b)


def _inside(arm: Arm, q: Array) -> Array:
    """Test that every joint is in its range with a little to spare, ``(K, B)``."""
    lower, upper = arm.lower[:, None, None] + _INSIDE, arm.upper[:, None, None] - _INSIDE
    return jnp.all((q >= lower) & (q <= upper), axis=0)
