"""Steps from a cell to a cell of the next layer: the possible ones, and the least cost of each."""

from typing import NamedTuple

import numpy as np

from jaxik.planning.certificate.cells import Cells
from jaxik.planning.certificate.quadratic import Quadratic2

_TURN = 2 * np.pi
_WIDE = 0.5  # rad; cells wider than this in the joint that sorts them are paired with all


class Joints(NamedTuple):
    """The measure of steps.

    Attributes:
        weight: Weights w of the cost Σ w Δq² / dt of a step, ``(joint,)``.
        speed: Speed limits, ``(joint,)`` [rad/s].
        turning: Joints whose range exceeds a turn, ``(joint,)``.
    """

    weight: np.ndarray
    speed: np.ndarray
    turning: np.ndarray

    def apart(self, joint: int, difference: np.ndarray) -> np.ndarray:
        """Return differences of a joint's angles, the short way round where its range exceeds a turn."""
        if not self.turning[joint]:
            return difference
        return difference - _TURN * np.round(difference / _TURN)

    def reach(self, dt: float) -> np.ndarray:
        """Return how far the joints get, ``(joint,)`` [rad]; slightly too far, so that rounding excludes nothing."""
        return self.speed * dt * (1 + 1e-6) + 1e-9


class Links(NamedTuple):
    """The steps from one layer to the next, as pairs of cells."""

    a: np.ndarray
    b: np.ndarray

    def at(self, index: np.ndarray) -> "Links":
        """Pick some of the steps."""
        return Links(self.a[index], self.b[index])


def possible(joints: Joints, cells: Cells, radius: np.ndarray, links: Links, dt: float) -> Links:
    """Return the steps for which no joint is too slow."""
    reach = joints.reach(dt)
    for joint in range(len(reach)):
        apart = np.abs(joints.apart(joint, cells.center[joint, links.b] - cells.center[joint, links.a]))
        links = links.at(apart - radius[joint, links.a] - radius[joint, links.b] <= reach[joint])
    return links


def all_links(joints: Joints, cells: Cells, radius: np.ndarray, a: np.ndarray, b: np.ndarray, dt: float) -> Links:
    """Return all possible steps from the cells ``a`` to the cells ``b``.

    Candidates come from the intervals of one joint, sorted.
    """
    joint = _telling_joint(joints, cells, radius, a)
    wide = (radius[joint, b] > _WIDE) | joints.turning[joint]
    found = [_each_with_each(a, b[wide])]
    b = b[~wide]
    if len(b):
        b = b[np.argsort(cells.center[joint, b])]
        center = cells.center[joint, b]
        window = radius[joint, a] + radius[joint, b].max() + joints.reach(dt)[joint]
        begin = np.searchsorted(center, cells.center[joint, a] - window)
        count = np.searchsorted(center, cells.center[joint, a] + window, side="right") - begin
        offset = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        found.append(Links(np.repeat(a, count), b[np.repeat(begin, count) + offset]))
    links = Links(*(np.concatenate(x) for x in zip(*found, strict=True)))
    return possible(joints, cells, radius, links, dt)


def least_costs(joints: Joints, cells: Cells, links: Links, dt: float) -> Quadratic2:
    """Return functions of the places in both cells below the cost of a step between them.

    With Δ the difference of the straight lines and e both errors together, (|Δ| - e)² ≥ (1 - θ) Δ² - (1/θ - 1) e² for
    every θ in (0, 1): a parabola that touches where |Δ| = e/θ. It is made to touch between the middles of the cells.
    """
    constant, a, b, aa, bb, ab = (np.zeros(len(links.a)) for _ in range(6))
    for joint, weight in enumerate(joints.weight / dt):
        if weight == 0.0:
            continue
        da, db = cells.slope[joint, links.a], cells.slope[joint, links.b]
        error = cells.error[joint, links.a] + cells.error[joint, links.b]
        delta = joints.apart(joint, cells.center[joint, links.b] - cells.center[joint, links.a])
        gap = np.abs(delta)
        unknown = error >= gap
        if joints.turning[joint]:  # where the short way round may be another one within the pair, nothing is known
            unknown |= gap + np.abs(da) + np.abs(db) + error >= np.pi
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(unknown, 0.0, weight * (1.0 - error / gap))
            constant += np.where(unknown, 0.0, weight * (gap - error) ** 2)
        a -= 2 * share * delta * da
        b += 2 * share * delta * db
        aa += share * da * da
        bb += share * db * db
        ab -= share * da * db
    return Quadratic2(constant, a, b, aa, bb, ab)


def _telling_joint(joints: Joints, cells: Cells, radius: np.ndarray, index: np.ndarray) -> int:
    """The joint whose intervals tell the cells apart best."""
    spread = np.std(cells.center[:, index], axis=1) / (np.median(radius[:, index], axis=1) + 1e-3)
    return int(np.argmax(np.where(joints.turning | ~np.isfinite(spread), 0.0, spread)))


def _each_with_each(a: np.ndarray, b: np.ndarray) -> Links:
    return Links(np.repeat(a, len(b)), np.tile(b, len(a)))
