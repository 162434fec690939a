"""Joint motion at and between a few waypoints, for an elbow in each of some wide cells of swivel."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxik.numerics import fused_separately, principal, shortest
from jaxik.planning.fast.branch_changes import best_aligned
from jaxik.planning.fast.path_batch import PathBatch
from jaxik.redundancy import SelfMotion

CELLS = 16  # 22.5 degrees
SHIFTS = (-1, 0, 1)  # cells that a step may move
ELBOWS = np.array([0, 2])[:, None, None]  # branches of the elbow's two sides, beside (CELLS, B)


class SphericalCosts(NamedTuple):
    """Costs of the three joints of a shoulder or wrist; every array ends in (elbow bit, CELLS, B).

    Attributes:
        motion: Σ w Δq² / dt of the steps that keep the solution or change it, ``[change][solution entered][shift]`` of
            ``(n - 1, ...)``.
        approach: Σ w Δq² / dt of the approach from the start, for every solution.
        excess: Violation of the joints' ranges, for every solution, ``(n, ...)`` [rad].
    """

    motion: tuple[tuple[tuple[Array, ...], ...], ...]
    approach: tuple[Array, ...]
    excess: tuple[Array, ...]


def cell_swivels(motion: SelfMotion) -> Array:
    """Return the swivels of the cells at every waypoint, ``(n, elbow bit, CELLS, B)`` [rad].

    They are evenly spaced, except that a cell in which the shoulder or wrist is best aligned has its swivel there.
    """
    grid = (jnp.arange(CELLS, dtype=motion.elbow.dtype) * (2 * jnp.pi / CELLS) - jnp.pi)[:, None]
    off = jnp.zeros((), motion.elbow.dtype)
    for entries in (motion.wrist, motion.shoulder):
        aligned = principal(jnp.moveaxis(best_aligned(entries), 0, 1)[:, :, None] - grid)
        off = jnp.where(jnp.abs(aligned) <= jnp.pi / CELLS, aligned, off)
    return grid + off


def beside_cells(motion: SelfMotion) -> SelfMotion:
    """Return a self-motion of rows ``(n, B)`` with axes for elbow bit and cell between them."""
    return motion.map_rows(lambda x: x[..., :, None, None, :])


def spherical_costs(batch: PathBatch, swivels: Array) -> tuple[SphericalCosts, SphericalCosts]:
    """Return the costs of shoulder and wrist at swivels ``(n, elbow bit, CELLS, B)`` [rad]."""
    motion = beside_cells(batch.motion)
    q = motion.branch(ELBOWS).angles(swivels)
    center = ((batch.arm.upper + batch.arm.lower) / 2)[:, None, None, None, None]
    solutions = q - center, motion.other_solution(q) - center
    rate = (1.0 / jnp.abs(jnp.diff(batch.time, axis=0)))[:, None, None]
    costs = []
    for joint in motion.spherical_joints():
        joints = slice(joint.first, joint.first + (len(joint.entries) + 1) // 2)
        offsets = [tuple(solution[joints]) for solution in solutions]
        weights, turning = batch.weights[joints], batch.arm.turning[joints]
        half = ((batch.arm.upper - batch.arm.lower) / 2)[joints]
        came = batch.start.q[joints] - center[joints, :, 0, 0, 0]
        moved = tuple(
            tuple(_step_costs(offsets[to ^ change], offsets[to], turning, weights, rate) for to in (0, 1))
            for change in (0, 1)
        )
        at = [_approach_and_excess(each, half, turning, weights, came, batch.start.rate) for each in offsets]
        costs.append(SphericalCosts(moved, *zip(*at, strict=True)))  # pyright: ignore
    return costs[0], costs[1]


@fused_separately
def _step_costs(
    before: tuple[Array, ...], after: tuple[Array, ...], turning: Array, weights: Array, rate: Array
) -> tuple[Array, ...]:
    """Costs of the steps from one solution to one, for every shift."""
    cost = [jnp.zeros((), rate.dtype)] * len(SHIFTS)
    for joint, (a, b) in enumerate(zip(before, after, strict=True)):
        for i, shift in enumerate(SHIFTS):
            # A joint without a way round has to come back the way it went.
            step = shortest(b[1:] - jnp.roll(a[:-1], -shift, axis=2), turning[joint])
            cost[i] = cost[i] + weights[joint] * step * step
    return tuple(c * rate for c in cost)


@fused_separately
def _approach_and_excess(
    offsets: tuple[Array, ...], half: Array, turning: Array, weights: Array, came: Array, rate: Array
) -> tuple[Array, Array]:
    """Approach and excess of one solution, see :class:`SphericalCosts`."""
    approach, excess = jnp.zeros((), rate.dtype), jnp.zeros((), rate.dtype)
    for joint, off in enumerate(offsets):
        approach = approach + weights[joint] * shortest(off[0] - came[joint], turning[joint]) ** 2
        excess = excess + jnp.maximum(jnp.abs(off) - half[joint], 0.0)
    return approach * rate, excess
