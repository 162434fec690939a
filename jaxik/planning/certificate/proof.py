"""From a motion found to a certified bound on how much better any other motion can be."""

import heapq
from collections.abc import Callable
from itertools import count
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxik.energy import node_weights
from jaxik.planning.certificate.bound import CostBounds, lower_bound
from jaxik.planning.certificate.cells import Cells, Enclosure, cover, same_ends
from jaxik.planning.certificate.quadratic import Parabola
from jaxik.planning.certificate.static_cost import StaticCost
from jaxik.planning.certificate.steps import Joints, Links, least_costs
from jaxik.planning.problem import EndPosture, PlanningProblem
from jaxik.redundancy import SelfMotion, SwivelArcs, SwivelBranch

_LENGTH = 0.3  # rad; cells that the proof begins with. Halving what remains is cheaper than starting with smaller ones
_SHARES = (0.8, 0.2, 0.0)  # of the gap that straight chords between the proof's waypoints may use; tried in turn
_NEW = 0.1  # rad; a motion this far from the incumbent is worth a refinement
_ROUNDING = 1e-9  # of the energy


Improve = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[float, np.ndarray] | None]


def certify(problem: PlanningProblem, q: np.ndarray, energy: float, gap: float, improve: Improve) -> float:
    """Return a lower bound on the energy of all motions within limits, keep-out and speeds, approaches included.

    Joint motion between two waypoints further apart costs no less than the straight chord in joint space (Cauchy and
    Schwarz), so that the bound needs only some of the waypoints.

    Args:
        problem: The planning problem, with an energy that is provable.
        q: The motion found, ``(K, joint)`` [rad]; says how far apart waypoints can be.
        energy: Its energy, approaches included.
        gap: Largest distance of the bound below the best energy known, as a fraction.
        improve: Given waypoints, swivels and branches where the bound leaves room for a better motion, returns one: its
            energy and postures, or None. ``gap`` is then counted from that.

    Returns:
        The bound, from 0 to the best energy known.
    """
    arm, time = problem.arm, np.asarray(problem.time, float)[: len(q)]
    if not energy > 0 or len(time) < 2:
        return 0.0
    weight = np.asarray(problem.energy.motion_weights(arm), float)
    joints = Joints(weight, np.asarray(arm.velocity_limit, float), np.asarray(arm.turning))
    before, after = (ApproachCost(joints, end) for end in (problem.start, problem.end))
    table = np.minimum(np.arange(_table_size(len(time))), len(time) - 1)  # on the device, looked up by every call
    if not isinstance(problem.motion, SelfMotion):
        return 0.0  # no bounds on its cells are known
    motion = problem.motion.map_rows(lambda x: jnp.asarray(np.asarray(x)[..., table]))
    static_cost = StaticCost(arm, problem.energy, np.asarray(node_weights(problem.time), float)[: len(q)])
    bound = 0.0
    for share in _SHARES:
        # An energy with static costs needs every waypoint: those left out would not be bounded.
        index = np.arange(len(time)) if problem.energy.at_rest else _index(q, time, weight, share * gap * energy)
        feasible = jax.tree.map(lambda x, index=index: np.array(x)[index], problem.arcs)
        for row, end in ((0, problem.start), (-1, problem.end)):
            if end is not None and end.pin is not None:
                _pin(feasible, row, end.pin)
        enclose = Enclosure(motion, index)
        cells = cover(enclose, feasible, _LENGTH)
        cells = cells if problem.closed is None else same_ends(cells)
        bounds = CostBounds(
            enclose, joints, np.diff(time[index]), before, after, static_cost, problem.closed is not None
        )
        incumbent = _Incumbent(improve, index, q, energy, gap)
        proved = lower_bound(bounds, cells, incumbent)
        if np.isfinite(proved):  # infinite would say that there is no motion, and there is one: nothing is proved then
            bound = max(bound, proved)
        q, energy = incumbent.q, incumbent.energy
        if bound >= energy * (1 - gap) or len(index) == len(time):
            break
    return float(np.clip(bound * (1 - _ROUNDING), 0.0, energy))


def _table_size(length: int) -> int:
    """Size of arrays of which only some rows are looked up: 256, 2048, ..., so that few programs do."""
    return next(size for size in (256 << 3 * k for k in count()) if size >= length)


class _Incumbent:
    """The best motion known. The bound to reach lies a fraction below its energy and sinks with it."""

    def __init__(self, improve: Improve, index: np.ndarray, q: np.ndarray, energy: float, gap: float) -> None:
        self.q, self.energy = q, energy
        self._improve, self._index, self._gap = improve, index, gap

    @property
    def target(self) -> float:
        """Bound to reach."""
        return self.energy * (1 - self._gap) * (1 + _ROUNDING)

    def try_improve(self, cells: Cells) -> None:
        """Refine the motion through some cells, one per layer, unless it is the incumbent."""
        away = np.abs(cells.center.T - self.q[self._index])
        away = np.minimum(away, np.abs(away - 2 * np.pi))
        if (away > _NEW).any() and (found := self._improve(self._index, cells.middle, cells.branch)):
            self.energy, self.q = found


def _pin(arcs: SwivelArcs, row: int, pin: SwivelBranch) -> None:
    """Leave a waypoint one swivel of one branch."""
    only = row, int(pin.branch), 0
    arcs.valid[row] = False
    arcs.valid[only] = True
    arcs.start[only] = arcs.end[only] = float(pin.swivel)


def _index(q: np.ndarray, time: np.ndarray, weight: np.ndarray, loss: float) -> np.ndarray:
    """Few waypoints: chords between them, along the motion found, lose no more than ``loss``.

    They are close where the motion bends and far apart where it is straight: the chord that loses most is divided where
    its parts lose least, until all together lose little enough.
    """
    way = np.append(0.0, np.cumsum(np.diff(q, axis=0) ** 2 @ weight / np.diff(time)))

    def lost(a: np.ndarray | int, b: np.ndarray | int) -> np.ndarray | float:
        return way[b] - way[a] - (q[b] - q[a]) ** 2 @ weight / (time[b] - time[a])

    chords = [(-float(lost(0, len(time) - 1)), 0, len(time) - 1)]
    total = -chords[0][0]
    while total > loss and chords[0][2] - chords[0][1] > 1:
        whole, a, b = heapq.heappop(chords)
        inner = np.arange(a + 1, b)
        middle = int(inner[np.argmin(lost(a, inner) + lost(inner, b))])
        parts = [(-float(lost(x, y)) if y - x > 1 else 0.0, x, y) for x, y in ((a, middle), (middle, b))]
        total += whole - parts[0][0] - parts[1][0]
        for part in parts:
            heapq.heappush(chords, part)
    return np.append(np.sort([a for _, a, _ in chords]), len(time) - 1)


class ApproachCost(NamedTuple):
    """Least cost of the motion between an end posture and cells.

    Attributes:
        joints: The measure of steps.
        end: The end posture; None costs nothing.
    """

    joints: Joints
    end: EndPosture | None

    def __call__(self, cells: Cells) -> Parabola:
        """Parabolas below the cost, one per cell."""
        count = len(cells.layer)
        if self.end is None:
            return Parabola(*(np.zeros(count) for _ in range(3)))
        q, still = np.asarray(self.end.q, float)[:, None], np.zeros((len(cells.center), 1))
        rows = (np.hstack(pair) for pair in ((q, cells.center), (still, cells.slope), (still, cells.error)))
        both = Cells(*(np.append(x[:1], x) for x in cells[:4]), *rows)
        links = Links(np.zeros(count, int), 1 + np.arange(count))
        return least_costs(self.joints, both, links, float(self.end.time)).along_w(0.0)
