"""A lower bound by dynamic programming on cells, made tight where the best motion can be.

What is still to be paid from a posture on is bounded from below by one parabola a cell, and so is what has been paid up
to it. With the cost of a step between them that bounds every motion through a pair of cells. Steps that cannot belong
to a motion cheaper than asked are left out for good, the cells that remain are halved, and so on, until none remains.

An approximate value serves as well as a true one for a parabola's slope and curve, since its height is taken so that
the bound holds. They come from its values at both ends and in the middle of the cell: neighbouring cells then agree at
the end they share. Slopes from the middles alone would be drawn to the joints between cells that do not agree, and the
bound would lose about one cell's worth of motion at every layer.
"""

from collections.abc import Callable
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from jaxik.planning.certificate.cells import Cells, Enclosure, split
from jaxik.planning.certificate.quadratic import Bowl, Parabola
from jaxik.planning.certificate.steps import Joints, Links, all_links, least_costs, possible

_MOST_LINKS = 4_000_000  # about 600 MB with everything made of them
_ROUNDS = 16
_PROGRESS = 0.1  # of what is missing; a round that brings less shows that chords lose more than there is room for


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


class Task(NamedTuple):
    """What is bounded.

    Attributes:
        enclose: What holds on cells.
        joints: How steps are measured.
        dt: Time between layers, ``(layers - 1,)`` [s].
        before: Least cost of coming to cells of the first layer.
        behind: Least cost of going on from cells of the last layer.
        resting: Least cost of being in cells.
    """

    enclose: Enclosure
    joints: Joints
    dt: np.ndarray
    before: Callable[[Cells], Parabola]
    behind: Callable[[Cells], Parabola]
    resting: Callable[[Cells], Parabola]


@runtime_checkable
class Hope(Protocol):
    """What the bound should reach, and where to look for better motions on the way."""

    @property
    def target(self) -> float:
        """The bound to reach."""
        ...

    def look(self, cells: Cells) -> None:
        """Told the cells, one a layer, where the bound leaves most room; may lower the target."""
        ...


def lower_bound(task: Task, cells: Cells, hope: Hope) -> float:
    """A bound of every motion through the cells, at least what is hoped for if that can be proved.

    Args:
        task: What is bounded.
        cells: Cells that cover all feasible postures of every layer.
        hope: What the bound should reach.

    Returns:
        The bound; infinite where no motion keeps the speed limits.
    """
    excluded, reached = np.inf, 0.0
    layers = _linked(task, cells)
    for rounds in range(_ROUNDS):
        if layers is None:
            return excluded
        if layers.size > _MOST_LINKS:
            break
        bounds = _through(task, layers)
        before, reached = reached, max(float(b.min()) for b in bounds)  # every motion takes a step from every layer
        if reached < hope.target and rounds > 1:
            hope.look(layers.cells.at(_cheapest(layers, bounds)))
        stuck = reached - before < _PROGRESS * (hope.target - reached)
        if reached >= hope.target or (rounds > 3 and stuck):
            break
        kept = [b < hope.target for b in bounds]
        excluded = min(excluded, *(float(b[~k].min(initial=np.inf)) for b, k in zip(bounds, kept, strict=True)))
        layers = _halved(task, layers, kept)
    return min(excluded, reached)


def _cheapest(layers: Layers, bounds: list[np.ndarray]) -> np.ndarray:
    """A way through the cells, always on by the step of the least bound: indices of cells, one a layer."""
    way = [layers.links[0].a[np.argmin(bounds[0])]]
    for link, bound in zip(layers.links, bounds, strict=True):
        first, last = np.searchsorted(link.a, [way[-1], way[-1] + 1])
        way.append(link.b[first + np.argmin(bound[first:last])])
    return np.array(way)


def _through(task: Task, layers: Layers) -> list[np.ndarray]:
    """What a motion costs at least that takes a step, for every step."""
    cells, begin, links = layers.cells, layers.begin, layers.links
    resting = task.resting(cells)
    costs = [
        least_costs(task.joints, cells, link, dt).plus_w(resting.at(link.b))
        for link, dt in zip(links, task.dt, strict=True)
    ]
    local = [Links(link.a - begin[k], link.b - begin[k + 1]) for k, link in enumerate(links)]
    to_pay = [task.behind(cells.at(np.arange(begin[-2], begin[-1])))]
    for cost, link in zip(reversed(costs), reversed(local), strict=True):
        to_pay.append(_below(link.a, cost.plus_w(to_pay[-1].at(link.b))))
    to_pay.reverse()
    first = np.arange(begin[1])
    paid = [task.before(cells.at(first)).plus(resting.at(first))]
    for cost, link in zip(costs, local, strict=True):
        order = np.argsort(link.b, kind="stable")
        paid.append(_below(link.b[order], cost.at(order).swapped().plus_w(paid[-1].at(link.a[order]))))
    return [
        cost.plus_u(paid[k].at(link.a)).plus_w(to_pay[k + 1].at(link.b)).minimum()
        for k, (cost, link) in enumerate(zip(costs, local, strict=True))
    ]


def _below(group: np.ndarray, costs: Bowl) -> Parabola:
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


def _linked(task: Task, cells: Cells) -> Layers | None:
    """The cells with all possible steps between them; None where none lead through."""
    radius = cells.radius
    begin = np.searchsorted(cells.layer, np.arange(len(task.dt) + 2))
    here, links = np.arange(begin[1]), []
    for k, dt in enumerate(task.dt):
        link = all_links(task.joints, cells, radius, here, np.arange(begin[k + 1], begin[k + 2]), dt)
        if not len(link.a):
            return None
        links.append(link)
        here = np.unique(link.b)
    return _trimmed(cells, links)


def _halved(task: Task, layers: Layers, kept: list[np.ndarray]) -> Layers | None:
    """The steps that are kept, with every cell of theirs in two."""
    trimmed = _trimmed(layers.cells, [link.at(keep) for link, keep in zip(layers.links, kept, strict=True)])
    if trimmed is None:
        return None
    cells = split(task.enclose, trimmed.cells)
    radius = cells.radius
    from_half, to_half = np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1])
    links = []
    for link, dt in zip(trimmed.links, task.dt, strict=True):
        halves = Links((2 * link.a[:, None] + from_half).ravel(), (2 * link.b[:, None] + to_half).ravel())
        links.append(possible(task.joints, cells, radius, halves, dt))
    return _trimmed(cells, links)


def _trimmed(cells: Cells, links: list[Links]) -> Layers | None:
    """Without steps that no motion takes from the first to the last layer, and without cells that none passes."""
    links = list(links)
    count = len(cells.layer)
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
    used = np.zeros(count, bool)
    for link in links:
        used[link.a] = used[link.b] = True
    number = np.cumsum(used) - 1
    links = [link.at(np.argsort(link.a, kind="stable")) for link in links]
    cells = cells.at(used)
    begin = np.searchsorted(cells.layer, np.arange(len(links) + 2))
    return Layers(cells, begin, [Links(number[link.a], number[link.b]) for link in links])
