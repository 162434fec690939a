"""A lower bound by dynamic programming on cells, made tight where the best motion can be.

The cost-to-go from a posture is bounded from below by one parabola per cell, and so is the cost up to it. With the cost
of a step between two cells they bound every motion through the pair. Steps that cannot belong to a motion below the
target are excluded for good, the remaining cells are halved, and so on, until none remains.

An approximate slope and curvature of a parabola serve as well as exact ones, since its height is chosen so that the
bound holds. They come from the values at both ends and in the middle of the cell: neighboring cells then agree at the
end they share. With slopes from the middles alone they would not agree, and the bound would lose about one cell's worth
of motion at every layer.

The motion of a closed path takes a round from a posture back to it. No m rounds cost less than V_m(s) if they end in
posture s; one more round of the motion through s makes m + 1, so that it costs no less than V_{m+1}(s) - V_m(s). The
bound is the least of these differences: that of an open path for m = 0, and growing with m to the cheapest round of an
endless repetition. Any function in the place of V_m serves as well: the cost so far is carried over to the first layer
and subtracted at the last one.
"""

from collections.abc import Callable
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from jaxik.planning.certificate.cells import Cells, Enclosure, split
from jaxik.planning.certificate.quadratic import Parabola, Quadratic2
from jaxik.planning.certificate.steps import Joints, Links, all_links, least_costs, possible

_MOST_LINKS = 4_000_000  # about 600 MB with everything made of them
_ROUNDS = 16
_REPETITIONS = 4  # of a closed path at most, for its cost so far
_SETTLED = 0.05  # of the distance to the target; a repetition that gains less is the last
_PROGRESS = 0.1  # of the distance to the target; a round that gains less shows that chords lose more than the gap


class Layers(NamedTuple):
    """Cells ordered by layer, and the possible steps from each layer to the next.

    Attributes:
        cells: The cells.
        begin: Index of each layer's first cell, and the number of cells, ``(layers + 1,)``.
        links: Steps out of each layer but the last, ordered by the cell they leave.
    """

    cells: Cells
    begin: np.ndarray
    links: list[Links]

    @property
    def size(self) -> int:
        """Number of steps."""
        return sum(len(links.a) for links in self.links)


class CostBounds(NamedTuple):
    """The lower bounds of the parts of a motion's cost.

    Attributes:
        enclose: Enclosure of the joint angles on cells.
        joints: The measure of steps.
        dt: Time between layers, ``(layers - 1,)`` [s].
        before: Least cost of the approach to cells of the first layer.
        after: Least cost of going on from cells of the last layer.
        static_cost: Least static cost of cells.
        closed: True if the last posture has to be the first. Cells of the last layer are then those of the first.
    """

    enclose: Enclosure
    joints: Joints
    dt: np.ndarray
    before: Callable[[Cells], Parabola]
    after: Callable[[Cells], Parabola]
    static_cost: Callable[[Cells], Parabola]
    closed: bool = False


@runtime_checkable
class Incumbent(Protocol):
    """The best motion known: it sets the bound to reach, and may be improved on the way."""

    @property
    def target(self) -> float:
        """Bound to reach."""
        ...

    def try_improve(self, cells: Cells) -> None:
        """Try the motion through some cells, one per layer, where the bound leaves most room; may lower the target."""
        ...


def lower_bound(costs: CostBounds, cells: Cells, incumbent: Incumbent) -> float:
    """Return a lower bound of every motion through the cells, at least the incumbent's target if that can be proved.

    Args:
        costs: Bounds of the parts of a motion's cost.
        cells: Cells that cover all feasible postures of every layer.
        incumbent: The best motion known.

    Returns:
        The bound; infinite where no motion keeps the speed limits.
    """
    excluded, reached = np.inf, 0.0
    layers = _linked(costs, cells)
    for rounds in range(_ROUNDS):
        if layers is None:
            return excluded
        if layers.size > _MOST_LINKS:
            break
        bounds = _through(costs, layers, incumbent.target)
        before, reached = reached, max(float(b.min()) for b in bounds)  # every motion takes a step from every layer
        if reached < incumbent.target and rounds > 1:
            incumbent.try_improve(layers.cells.at(_cheapest(layers, bounds)))
        stuck = reached - before < _PROGRESS * (incumbent.target - reached)
        if reached >= incumbent.target or (rounds > 3 and stuck):
            break
        kept = [b < incumbent.target for b in bounds]
        excluded = min(excluded, *(float(b[~k].min(initial=np.inf)) for b, k in zip(bounds, kept, strict=True)))
        layers = _halved(costs, layers, kept)
    return min(excluded, reached)


def _cheapest(layers: Layers, bounds: list[np.ndarray]) -> np.ndarray:
    """A path through the cells along the steps of least bound: indices of cells, one per layer."""
    path = [layers.links[0].a[np.argmin(bounds[0])]]
    for link, bound in zip(layers.links, bounds, strict=True):
        first, last = np.searchsorted(link.a, [path[-1], path[-1] + 1])
        path.append(link.b[first + np.argmin(bound[first:last])])
    return np.array(path)


def _through(costs: CostBounds, layers: Layers, target: float) -> list[np.ndarray]:
    """Least cost of a motion that takes a step, for every step; on a closed path as far as the target asks for."""
    cells, begin, links = layers.cells, layers.begin, layers.links
    static = costs.static_cost(cells)
    steps = [
        least_costs(costs.joints, cells, link, dt).plus_w(static.at(link.b))
        for link, dt in zip(links, costs.dt, strict=True)
    ]
    local = [Links(link.a - begin[k], link.b - begin[k + 1]) for k, link in enumerate(links)]
    first, last = np.arange(begin[1]), np.arange(begin[-2], begin[-1])
    before, after = costs.before(cells.at(first)), costs.after(cells.at(last))
    cost_so_far = _forward(steps, local, before.plus(static.at(first)))
    least = -np.inf
    for _ in range(_REPETITIONS if costs.closed else 0):
        reached, least = least, float(cost_so_far[-1].plus(after).minimum().min())
        if least >= target or least - reached < _SETTLED * (target - least):
            break
        before, after = cost_so_far[-1], cost_so_far[-1].negated()
        cost_so_far = _forward(steps, local, before.plus(static.at(first)))
    cost_to_go = [after]
    for cost, link in zip(reversed(steps), reversed(local), strict=True):
        cost_to_go.append(_below(link.a, cost.plus_w(cost_to_go[-1].at(link.b))))
    cost_to_go.reverse()
    return [
        cost.plus_u(cost_so_far[k].at(link.a)).plus_w(cost_to_go[k + 1].at(link.b)).minimum()
        for k, (cost, link) in enumerate(zip(steps, local, strict=True))
    ]


def _forward(steps: list[Quadratic2], links: list[Links], begin: Parabola) -> list[Parabola]:
    """Least cost so far of each layer's cells, from that of the first layer's; links within the layers."""
    cost_so_far = [begin]
    for cost, link in zip(steps, links, strict=True):
        order = np.argsort(link.b, kind="stable")
        cost_so_far.append(_below(link.b[order], cost.at(order).swapped().plus_w(cost_so_far[-1].at(link.a[order]))))
    return cost_so_far


def _below(group: np.ndarray, costs: Quadratic2) -> Parabola:
    """One parabola in u per group, below all of the group's functions whatever w is.

    Args:
        group: Number of each function's group, ascending and without gaps from 0.
        costs: The functions.
    """
    first = np.flatnonzero(np.diff(group, prepend=-1))
    left, middle, right = (np.minimum.reduceat(costs.along_w(u).minimum(), first) for u in (-1.0, 0.0, 1.0))
    shape = Parabola(np.zeros_like(middle), (left - right) / 2, middle - (left + right) / 2)
    value = np.minimum.reduceat(costs.plus_u(shape.at(group)).minimum(), first)
    return Parabola(value, -shape.slope, -shape.curve)


def _linked(costs: CostBounds, cells: Cells) -> Layers | None:
    """The cells with all possible steps between them; None where none lead through."""
    radius = cells.radius
    begin = np.searchsorted(cells.layer, np.arange(len(costs.dt) + 2))
    here, links = np.arange(begin[1]), []
    for k, dt in enumerate(costs.dt):
        link = all_links(costs.joints, cells, radius, here, np.arange(begin[k + 1], begin[k + 2]), dt)
        if not len(link.a):
            return None
        links.append(link)
        here = np.unique(link.b)
    return _trimmed(costs, cells, links)


def _halved(costs: CostBounds, layers: Layers, kept: list[np.ndarray]) -> Layers | None:
    """The steps that are kept, with every cell of theirs in two."""
    trimmed = _trimmed(costs, layers.cells, [link.at(keep) for link, keep in zip(layers.links, kept, strict=True)])
    if trimmed is None:
        return None
    cells = split(costs.enclose, trimmed.cells)
    radius = cells.radius
    from_half, to_half = np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1])
    links = []
    for link, dt in zip(trimmed.links, costs.dt, strict=True):
        halves = Links((2 * link.a[:, None] + from_half).ravel(), (2 * link.b[:, None] + to_half).ravel())
        links.append(possible(costs.joints, cells, radius, halves, dt))
    return _trimmed(costs, cells, links)


def _trimmed(costs: CostBounds, cells: Cells, links: list[Links]) -> Layers | None:
    """Without steps that no motion takes from the first to the last layer, and without cells that none passes."""
    connected = _connected(links, len(cells.layer))
    while costs.closed and connected is not None:
        # Cells in which a motion begins, and those in which one ends: it can return to both only.
        place = cells.middle + 1j * cells.branch
        both = np.intersect1d(place[connected[0].a], place[connected[-1].b])
        before = connected[0].at(np.isin(place[connected[0].a], both))
        after = connected[-1].at(np.isin(place[connected[-1].b], both))
        if len(before.a) == len(connected[0].a) and len(after.a) == len(connected[-1].a):
            break
        connected = _connected([before, *connected[1:-1], after], len(cells.layer))
    if connected is None:
        return None
    used = np.zeros(len(cells.layer), bool)
    for link in connected:
        used[link.a] = used[link.b] = True
    number = np.cumsum(used) - 1
    links = [link.at(np.argsort(link.a, kind="stable")) for link in connected]
    cells = cells.at(used)
    begin = np.searchsorted(cells.layer, np.arange(len(links) + 2))
    return Layers(cells, begin, [Links(number[link.a], number[link.b]) for link in links])


def _connected(links: list[Links], count: int) -> list[Links] | None:
    """The steps that lead on from the first layer and on to the last, of ``count`` cells; None for none."""
    links = list(links)
    passed = np.zeros(count, bool)
    for k in range(len(links)):
        if k:
            links[k] = links[k].at(passed[links[k].a])
        passed[links[k].b] = True
    passed = np.zeros(count, bool)
    passed[links[-1].b] = True
    for k in reversed(range(len(links))):
        links[k] = links[k].at(passed[links[k].b])
        passed[links[k].a] = True
        if not len(links[k].a):
            return None
    return links
