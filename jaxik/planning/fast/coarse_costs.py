"""What joints cost at and between a few waypoints, for an elbow in every one of some wide cells of swivel."""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxik.arm import Arm
from jaxik.numerics import arctan2, clipped_sqrt, fused_separately
from jaxik.planning.fast.branch_changes import ridge
from jaxik.planning.fast.path_batch import ElbowCharts, near

CELLS = 16  # 22.5 degrees
SHIFTS = (-1, 0, 1)  # cells that a step may move


class Start(NamedTuple):
    """The postures that arms come from.

    Attributes:
        q: ``(joint, B)`` [rad].
        rate: One over the time they have to the first waypoint, ``(B,)`` [1/s]; zero for arms that come from nowhere.
    """

    q: Array
    rate: Array


class Triple(NamedTuple):
    """What three joints cost; every array ends in (elbow bit, CELLS, B).

    Attributes:
        motion: Σ w Δq² / dt of the steps that keep the solution or change it, ``[change][solution come to][shift]`` of
            ``(n - 1, ...)``.
        coming: The same of the way from the start, for every solution.
        excess: Beyond the joints' ranges, for every solution, ``(n, ...)`` [rad].
    """

    motion: tuple[tuple[tuple[Array, ...], ...], ...]
    coming: tuple[Array, ...]
    excess: tuple[Array, ...]


def cell_swivels(charts: ElbowCharts) -> Array:
    """Swivels of the cells at every waypoint, ``(n, elbow bit, CELLS, B)`` [rad].

    They are evenly spaced, but that a cell in which the shoulder or wrist is best aligned has its swivel there.
    """
    grid = (jnp.arange(CELLS, dtype=charts.elbow.dtype) * (2 * jnp.pi / CELLS) - jnp.pi)[:, None]
    off = jnp.zeros((), charts.elbow.dtype)
    for entries in (charts.wrist, charts.shoulder):
        top = near(jnp.moveaxis(ridge(entries), 0, 1)[:, :, None] - grid)
        off = jnp.where(jnp.abs(top) <= jnp.pi / CELLS, top, off)
    return grid + off


def triple(
    arm: Arm,
    entries: Array,
    delta: Array,
    first: int,
    trig: tuple[Array, Array],
    rate: Array,
    weight: Array,
    start: Start,
) -> Triple:
    """Prices of a triple.

    Args:
        arm: The arm.
        entries: ``(5 or 3, 3, elbow bit, n, B)``.
        delta: What its middle angle is more than the joint, ``()`` [rad].
        first: Number of its first joint.
        trig: Sines and cosines of the cells' swivels.
        rate: One over the steps' times, ``(n - 1, 1, 1, B)`` [1/s].
        weight: Of Δq² / dt in the energy, ``(joint,)``.
        start: Where the arms come from.
    """
    center, half = ((arm.upper + arm.lower) / 2)[first:], ((arm.upper - arm.lower) / 2)[first:]
    entries = jnp.moveaxis(entries, 3, 2)[..., None, :]  # (5 or 3, 3, n, elbow bit, 1, B)
    solutions = _offsets(entries, delta, center, *trig)
    # A joint that does not turn without end has to come back the way it went.
    turn = jnp.where(half >= jnp.pi * (1 - 1e-6), 2 * jnp.pi, 0.0).astype(rate.dtype)
    came = near(start.q[first:] - center[:, None])
    motion = tuple(
        tuple(_motion(solutions[to ^ change], solutions[to], turn, weight[first:], rate) for to in (0, 1))
        for change in (0, 1)
    )
    at = [_at(solution, half, weight[first:], came, start.rate) for solution in solutions]
    return Triple(motion, *zip(*at, strict=True))  # pyright: ignore


@fused_separately
def _offsets(
    entries: Array, delta: Array, center: Array, sin: Array, cos: Array
) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """Angles of a triple in both solutions, from the middles of the joints' ranges, ``(n, elbow bit, CELLS, B)``."""
    values = [e[0] + e[1] * cos + e[2] * sin for e in entries]
    outer = [arctan2(values[1], values[0])] + ([arctan2(values[4], values[3])] if len(values) == 5 else [])
    middle = arctan2(clipped_sqrt(1.0 - values[2] ** 2), values[2])
    # The other solution: outer joints half a turn on, the middle one with the other sign.
    solutions = (
        (outer[0], middle - delta, *outer[1:]),
        (outer[0] + jnp.pi, -middle - delta, *(a + jnp.pi for a in outer[1:])),
    )
    return tuple(tuple(near(a - c) for a, c in zip(s, center, strict=False)) for s in solutions)  # pyright: ignore


@fused_separately
def _motion(
    before: tuple[Array, ...], after: tuple[Array, ...], turn: Array, weight: Array, rate: Array
) -> tuple[Array, ...]:
    """Price of the steps from one solution to one, for every shift."""
    motion = [jnp.zeros((), rate.dtype)] * len(SHIFTS)
    for joint, (a, b) in enumerate(zip(before, after, strict=True)):
        for i, shift in enumerate(SHIFTS):
            step = b[1:] - jnp.roll(a[:-1], -shift, axis=2)
            step = step - turn[joint] * jnp.round(step * (0.5 / jnp.pi))
            motion[i] = motion[i] + weight[joint] * step * step
    return tuple(m * rate for m in motion)


@fused_separately
def _at(offsets: tuple[Array, ...], half: Array, weight: Array, came: Array, come_rate: Array) -> tuple[Array, Array]:
    """Coming and excess of one solution, see :class:`Triple`."""
    coming, excess = jnp.zeros((), come_rate.dtype), jnp.zeros((), come_rate.dtype)
    for joint, off in enumerate(offsets):
        coming = coming + weight[joint] * near(off[0] - came[joint]) ** 2
        excess = excess + jnp.maximum(jnp.abs(off) - half[joint], 0.0)
    return coming * come_rate, excess
