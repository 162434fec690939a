"""From a motion found to the proof of how much better any other can be."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import numpy as np
from jax import Array

from jaxik.energy import node_weights
from jaxik.planning.certificate.bound import Task, lower_bound
from jaxik.planning.certificate.cells import Cells, Enclosure, cover
from jaxik.planning.certificate.quadratic import Parabola
from jaxik.planning.certificate.static_cost import Resting
from jaxik.planning.certificate.steps import Joints, Links, least_costs
from jaxik.planning.chart import Chart
from jaxik.planning.problem import Problem
from jaxik.redundancy import SwivelArcs, swivel_of

_LENGTH = 0.3  # rad; cells that the proof begins with. Halving what remains is cheaper than to begin with smaller ones
_STRIDES = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)
_SHARES = (0.8, 0.2, 0.0)  # of the gap that may go to straight chords between the waypoints looked at; tried in turn
_NEW = 0.1  # rad; a motion this far from the best one known is worth a polish
_ROUNDING = 1e-9  # of the energy


Better = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[float, np.ndarray] | None]


def certify(
    problem: Problem, chart: Chart, arcs: SwivelArcs, q: np.ndarray, energy: float, gap: float, better: Better
) -> float:
    """A lower bound of the energy over all motions that keep limits, keep-out and speeds, coming and going included.

    Joint motion between two waypoints further apart costs no less than the straight chord in joint space (Cauchy and
    Schwarz), so that not every waypoint needs to be looked at.

    Args:
        problem: What was planned, for an energy that is provable.
        chart: The arm's angles along the path.
        arcs: Feasible swivels along the path.
        q: The motion found, ``(K, joint)`` [rad]; says how far apart waypoints can be.
        energy: What it costs, coming and going included.
        gap: How far below the best energy known the bound may be, as a share.
        better: Told waypoints, swivels and branches where the bound leaves room for a better motion, finds one: its
            energy and postures, or None. ``gap`` is then counted from that.

    Returns:
        The bound, from 0 to the best energy known.
    """
    arm, time = problem.arm, problem.time
    if not energy > 0 or len(time) < 2:
        return 0.0
    weight = np.asarray(problem.energy.motion_weight(arm), float)
    upper, lower = (np.asarray(x, float) for x in (arm.upper, arm.lower))
    joints = Joints(weight, np.asarray(arm.velocity_limit, float), upper - lower >= 2 * np.pi * (1 - 1e-6))
    before, behind = (_Coming(joints, posture, problem.approach_time) for posture in (problem.start, problem.end))
    chart = jax.tree.map(np.asarray, chart)
    resting = Resting(arm, problem.energy, np.asarray(node_weights(problem.path.time), float))
    bound = 0.0
    for share in _SHARES:
        # What waypoints between those looked at cost by themselves would be lost.
        index = np.arange(len(time)) if problem.energy.at_rest else _index(q, time, weight, share * gap * energy)
        feasible = jax.tree.map(lambda x, index=index: np.array(x)[index], arcs)
        for row, posture, pinned in ((0, problem.start, problem.pinned), (-1, problem.end, problem.end_pinned)):
            if pinned and posture is not None:
                _pin(feasible, row, *swivel_of(arm, posture))
        enclose = Enclosure(arm, chart.at(index))
        task = Task(enclose, joints, np.diff(time[index]), before, behind, resting)
        hope = _Hope(better, index, q, energy, gap)
        proved = lower_bound(task, cover(enclose, feasible, _LENGTH), hope)
        if np.isfinite(proved):  # infinite would say that there is no motion, and there is one: nothing is proved then
            bound = max(bound, proved)
        q, energy = hope.q, hope.energy
        if bound >= energy * (1 - gap) or len(index) == len(time):
            break
    return float(np.clip(bound * (1 - _ROUNDING), 0.0, energy))


class _Hope:
    """What the bound should reach: a share below the best energy known, which sinks where the proof finds better."""

    def __init__(self, better: Better, index: np.ndarray, q: np.ndarray, energy: float, gap: float) -> None:
        self.q, self.energy = q, energy
        self._better, self._index, self._gap = better, index, gap

    @property
    def target(self) -> float:
        """The energy the bound should reach."""
        return self.energy * (1 - self._gap) * (1 + _ROUNDING)

    def look(self, cells: Cells) -> None:
        """Tries the motion through some cells, one a layer, unless it is the one known already."""
        away = np.abs(cells.center.T - self.q[self._index])
        away = np.minimum(away, np.abs(away - 2 * np.pi))
        if (away > _NEW).any() and (found := self._better(self._index, cells.middle, cells.branch)):
            self.energy, self.q = found


def _pin(arcs: SwivelArcs, row: int, swivel: Array, branch: Array) -> None:
    """Leaves a waypoint one swivel of one branch."""
    only = row, int(branch), 0
    arcs.valid[row] = False
    arcs.valid[only] = True
    arcs.start[only] = arcs.end[only] = float(swivel)


def _index(q: np.ndarray, time: np.ndarray, weight: np.ndarray, loss: float) -> np.ndarray:
    """As few waypoints as can be: chords between them, along the motion found, lose no more than ``loss``."""
    last = len(time) - 1
    best = np.arange(last + 1)
    whole = _spent(q, time, weight)
    for stride in _STRIDES:
        index = np.append(np.arange(0, last, stride), last)
        if whole - _spent(q[index], time[index], weight) > loss:
            break
        best = index
    return best


def _spent(q: np.ndarray, time: np.ndarray, weight: np.ndarray) -> float:
    return float((np.diff(q, axis=0) ** 2 @ weight / np.diff(time)).sum())


class _Coming(NamedTuple):
    """What the motion from a posture off the path to cells, or from them to it, costs at least."""

    joints: Joints
    posture: Array | None
    seconds: float

    def __call__(self, cells: Cells) -> Parabola:
        count = len(cells.layer)
        if self.posture is None:
            return Parabola(*(np.zeros(count) for _ in range(3)))
        q, still = np.asarray(self.posture, float)[:, None], np.zeros((len(cells.center), 1))
        rows = (np.hstack(pair) for pair in ((q, cells.center), (still, cells.slope), (still, cells.error)))
        both = Cells(*(np.append(x[:1], x) for x in cells[:4]), *rows)
        links = Links(np.zeros(count, int), 1 + np.arange(count))
        return least_costs(self.joints, both, links, self.seconds).along_w(0.0)
