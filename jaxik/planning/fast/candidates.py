"""The best candidate of every path: candidates from different basins, each after a few Gauss-Newton steps.

1. Candidates from the coarse search, interpolated at the knots.
2. Gauss-Newton steps in each, taken where they help; the cheapest candidate goes on.
3. One more step, and the next one as a proposal: what a learned correction adds to.
"""

from functools import reduce
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxik.planning.fast.branch_changes import interpolate
from jaxik.planning.fast.coarse_search import coarse_search, searched_knots
from jaxik.planning.fast.gauss_newton import gauss_newton_step
from jaxik.planning.fast.path_batch import PathBatch, SwivelPath
from jaxik.redundancy import BranchMotion

_TRIAL_STEPS = 2  # Gauss-Newton steps before candidates are compared: after one, some are still far from their minimum


class Candidate(NamedTuple):
    """The best candidate of every path at its knots; nothing of it depends on a network's weights.

    Attributes:
        motion: Self-motion in the branches chosen.
        branch: Branches, ``(K, B)``.
        begin: Swivels before the last Gauss-Newton steps, ``(K, B)`` [rad].
        swivel: The same after one step, where that helps.
        q: Joint angles there, ``(joint, K, B)`` [rad].
        slope: Their derivatives in the swivel, ``(joint, K, B)``.
        step: The next Gauss-Newton step, ``(K, B)`` [rad].
        excess: Mean excess over the limits of the beginning, ``(B,)`` [rad].
        one_branch: The best candidate that keeps one branch.
        all: All candidates, leading axis of both arrays.
    """

    motion: BranchMotion
    branch: Array
    begin: Array
    swivel: Array
    q: Array
    slope: Array
    step: Array
    excess: Array
    one_branch: SwivelPath
    all: SwivelPath

    @property
    def proposal(self) -> Array:
        """Swivels after the next step, ``(K, B)`` [rad]: the motion without a correction."""
        return self.swivel + self.step


class _Ranked(NamedTuple):
    """A motion of every path, ordered by rank first and cost second, ``(B,)`` each."""

    rank: Array
    cost: Array
    path: SwivelPath


def best_candidate(batch: PathBatch, count: int) -> Candidate:
    """Return the best of ``count`` candidates of every path, all waypoints of the batch taken for knots."""
    searched = searched_knots(len(batch.time))
    coarse = coarse_search(batch.waypoints(searched), count)

    def compare(best: tuple[_Ranked, _Ranked], at_searched: SwivelPath) -> tuple[tuple[_Ranked, _Ranked], SwivelPath]:
        """The best of all candidates so far, and of those that keep one branch."""
        begin = interpolate(batch.motion, searched, at_searched)
        motion = batch.motion.branch(begin.branch)
        cost, swivel = batch.cost(motion, motion.angles(begin.swivel), begin.swivel), begin.swivel
        for _ in range(_TRIAL_STEPS):
            cost, swivel = _descended(batch, motion, cost, swivel)
        path = SwivelPath(swivel, begin.branch)
        changes = jnp.any(begin.branch != begin.branch[:1], axis=0)
        mine = _Ranked(jnp.zeros_like(changes), cost, path), _Ranked(changes, cost, path)
        return (_better(mine[0], best[0]), _better(mine[1], best[1])), begin

    zeros = jnp.zeros_like(batch.time)
    nothing = SwivelPath(zeros, zeros.astype(coarse.branch.dtype))
    none = _Ranked(jnp.ones(zeros.shape[1:], bool), zeros[0] + jnp.inf, nothing)
    (best, one_branch), everything = jax.lax.scan(compare, (none, none), coarse)
    begin, branch = best.path
    motion = batch.motion.branch(branch)

    def evaluated(swivel: Array) -> tuple[tuple[Array, Array], Array, Array]:
        """Joints and slopes, the cost, and the Gauss-Newton step from there."""
        q, slope = motion.slopes(swivel)
        return (q, slope), batch.cost(motion, q, swivel), gauss_newton_step(batch, motion, swivel, q, slope)

    before, cost, step = evaluated(begin)
    after, lower, second = evaluated(begin + step)
    # A step may lead away where joints are not linear; a correction then goes on from the beginning.
    good = lower < cost
    swivel = jnp.where(good, begin + step, begin)
    q, slope = (jnp.where(good, x, y) for x, y in zip(after, before, strict=True))
    excess = jnp.mean(motion.excess(before[0], begin), axis=0)
    throughout = jnp.broadcast_to(one_branch.path.branch[:1], branch.shape)
    spare = SwivelPath(one_branch.path.swivel, throughout)
    return Candidate(motion, branch, begin, swivel, q, slope, jnp.where(good, second, 0.0), excess, spare, everything)


def best_of(batch: PathBatch, proposals: tuple[SwivelPath, ...]) -> SwivelPath:
    """Return the cheapest of some proposals for every path, after one Gauss-Newton step where that helps."""

    def ranked(path: SwivelPath) -> _Ranked:
        motion = batch.motion.branch(path.branch)
        cost = batch.cost(motion, motion.angles(path.swivel), path.swivel)
        return _Ranked(jnp.zeros(cost.shape, bool), cost, path)

    _, cost, path = reduce(_better, map(ranked, proposals))
    return SwivelPath(_descended(batch, batch.motion.branch(path.branch), cost, path.swivel)[1], path.branch)


def _descended(batch: PathBatch, motion: BranchMotion, cost: Array, swivel: Array) -> tuple[Array, Array]:
    """Costs and swivels after a Gauss-Newton step, where it helps."""
    moved = swivel + gauss_newton_step(batch, motion, swivel, *motion.slopes(swivel))
    after = batch.cost(motion, motion.angles(moved), moved)
    return jnp.minimum(cost, after), jnp.where(after < cost, moved, swivel)


def _better(a: _Ranked, b: _Ranked) -> _Ranked:
    """The better one of each path's two."""
    first = (a.rank < b.rank) | ((a.rank == b.rank) & (a.cost < b.cost))
    return jax.tree.map(lambda x, y: jnp.where(first, x, y), a, b)
