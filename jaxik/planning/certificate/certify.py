"""From a motion found to the proof of how much better any other can be."""

from typing import NamedTuple

import jax
import numpy as np

from jaxik.arcs import SwivelArcs
from jaxik.arm import Arm
from jaxik.planning.certificate.bound import Problem, lower_bound
from jaxik.planning.certificate.cells import Cells, Enclosure, cover
from jaxik.planning.certificate.quadratic import Parabola
from jaxik.planning.certificate.steps import Joints, Links, least_costs
from jaxik.planning.chart import Chart

_LENGTH = 0.3  # rad; cells that the proof begins with. Halving what remains is cheaper than to begin with smaller ones
_STRIDES = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)
_SHARE = 0.6  # of the gap that may go to straight chords between the waypoints looked at
_ROUNDING = 1e-9  # of the energy


class Coming(NamedTuple):
    """A posture before the first waypoint or behind the last, and the time for the motion between.

    Attributes:
        q: ``(joint,)`` [rad].
        seconds: The time [s].
    """

    q: np.ndarray
    seconds: float


def certify(
    arm: Arm,
    chart: Chart,
    arcs: SwivelArcs,
    time_s: np.ndarray,
    weight: np.ndarray,
    q: np.ndarray,
    energy: float,
    gap: float,
    start: Coming | None = None,
) -> float:
    """A lower bound of Σ_k Σ_j W_j (q_{k+1,j} - q_{k,j})² / dt_k over all motions that keep limits, arcs and speeds.

    A motion between two waypoints further apart costs no less than the straight chord in joint space (Cauchy and
    Schwarz), so that not every waypoint needs to be looked at.

    Args:
        arm: The arm.
        chart: Its angles along the path.
        arcs: Feasible swivels along the path.
        time_s: ``(K,)`` [s].
        weight: W, ``(joint,)``.
        q: The motion found, ``(K, joint)`` [rad]; says how far apart waypoints can be.
        energy: What it costs, the start included.
        gap: How far below that the bound may be, as a share.
        start: What the arm comes from; its cost is included.

    Returns:
        The bound, at most ``energy``.
    """
    target = energy * (1 - gap)
    if not target > 0 or len(time_s) < 2:
        return min(energy, 0.0)
    index = _index(q, time_s, weight, _SHARE * gap * energy)
    chart, arcs = jax.tree.map(np.asarray, chart), jax.tree.map(lambda x: np.asarray(x)[index], arcs)
    upper, lower = (np.asarray(x, float) for x in (arm.upper, arm.lower))
    joints = Joints(weight, np.asarray(arm.velocity_limit, float), upper - lower >= 2 * np.pi * (1 - 1e-6))
    enclose = Enclosure(arm, chart.at(index))

    def coming(cells: Cells) -> Parabola:
        return _nothing(cells) if start is None else _approach(joints, cells, start)

    problem = Problem(enclose, joints, np.diff(time_s[index]), coming, _nothing)
    found = lower_bound(problem, cover(enclose, arcs, _LENGTH), target * (1 + _ROUNDING))
    return float(np.clip(found.value * (1 - _ROUNDING), 0.0, energy))


def _index(q: np.ndarray, time_s: np.ndarray, weight: np.ndarray, loss: float) -> np.ndarray:
    """As few waypoints as can be: chords between them, along the motion found, lose no more than ``loss``."""
    last = len(time_s) - 1
    best = np.arange(last + 1)
    whole = _spent(q, time_s, weight)
    for stride in _STRIDES:
        index = np.append(np.arange(0, last, stride), last)
        if whole - _spent(q[index], time_s[index], weight) > loss:
            break
        best = index
    return best


def _spent(q: np.ndarray, time_s: np.ndarray, weight: np.ndarray) -> float:
    return float((np.diff(q, axis=0) ** 2 @ weight / np.diff(time_s)).sum())


def _approach(joints: Joints, cells: Cells, start: Coming) -> Parabola:
    """What the step from the start costs at least."""
    point = np.zeros((len(start.q), 1))
    both = Cells(
        *(np.append(x[:1], x) for x in cells[:4]),
        np.hstack([start.q[:, None], cells.center]),
        np.hstack([point, cells.slope]),
        np.hstack([point, cells.error]),
    )
    count = len(cells.layer)
    return least_costs(joints, both, Links(np.zeros(count, int), 1 + np.arange(count)), start.seconds).along_w(0.0)


def _nothing(cells: Cells) -> Parabola:
    return Parabola(*(np.zeros(len(cells.layer)) for _ in range(3)))
