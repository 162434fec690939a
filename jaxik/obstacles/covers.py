"""Shapes covered by spheres, to a stated overhang."""

from typing import NamedTuple

import numpy as np

_MOST = 4096  # spheres of one shape
LARGEST = 1e6
"""Largest number in a file of shapes [m]; squares and sixth powers of it are finite in float32."""
_FINER = 0.9
_CUBE = (np.sqrt(3.0) - 1.0) / 2.0  # overhang of a sphere about a cube, in edges


class Cover(NamedTuple):
    """Spheres that cover a shape.

    Attributes:
        centers: Their centers, ``(n, 3)`` [m].
        radii: Their radii, ``(n,)`` [m].
        overhang: Largest distance from the shape that a sphere reaches [m].
    """

    centers: np.ndarray
    radii: np.ndarray
    overhang: float

    def placed(self, frame: np.ndarray) -> "Cover":
        """Return the cover in a frame ``(4, 4)``."""
        return self._replace(centers=self.centers @ frame[:3, :3].T + frame[:3, 3])


def sphere_cover(radius: float) -> Cover:
    """Return a sphere about the origin."""
    return Cover(np.zeros((1, 3)), np.array([radius]), 0.0)


def box_cover(size: np.ndarray, overhang: float) -> Cover:
    """Return spheres over a box about the origin: one about each of the cells into which it is divided.

    Args:
        size: Lengths along x, y and z, ``(3,)`` [m].
        overhang: Largest distance from the box that a sphere may reach [m].

    Raises:
        ValueError: That takes more than 4096 spheres.
    """
    size, edge = np.asarray(size, float), overhang / _CUBE
    while True:
        counts = np.maximum(np.ceil(size / edge - 1e-9), 1)  # not yet integers, whose product could overflow
        edges = size / counts
        radius = float(np.linalg.norm(edges)) / 2
        beyond = radius - float(edges.min()) / 2
        if beyond <= overhang or counts.prod() > _MOST:
            break
        edge *= _FINER  # cells that are no cubes reach farther
    if counts.prod() > _MOST:
        raise ValueError(
            f"a box of {' x '.join(f'{x:.3g}' for x in size)} m takes {counts.prod():.0f} spheres for an overhang of "
            f"{1e3 * overhang:.3g} mm; give a larger overhang"
        )
    places = [(np.arange(int(n)) + 0.5) * e - s / 2 for n, e, s in zip(counts, edges, size, strict=True)]
    centers = np.stack(np.meshgrid(*places, indexing="ij"), axis=-1).reshape(-1, 3)
    return Cover(centers, np.full(len(centers), radius), beyond)


def capsule_cover(start: np.ndarray, end: np.ndarray, radius: float, overhang: float) -> Cover:
    """Return spheres over all points within a radius of a segment.

    Args:
        start: First end of the segment, ``(3,)`` [m].
        end: Second end, ``(3,)`` [m].
        radius: The radius [m].
        overhang: Largest distance from the capsule that a sphere may reach [m].

    Raises:
        ValueError: That takes more than 4096 spheres.
    """
    start, end = np.asarray(start, float), np.asarray(end, float)
    length = float(np.linalg.norm(end - start))
    # Spheres a distance d apart cover the radius where theirs is sqrt(radius² + d² / 4).
    steps = int(np.ceil(length / _spacing(radius, overhang) - 1e-9)) if length else 0
    if steps > _MOST:
        raise ValueError(f"a capsule {length:.3g} m long takes {steps:.0f} spheres; give a larger overhang")
    share = np.linspace(0.0, 1.0, steps + 1)[:, None]
    grown = np.hypot(radius, length / steps / 2) if steps else radius
    return Cover(start + share * (end - start), np.full(steps + 1, grown), float(grown - radius))


def cylinder_cover(radius: float, length: float, overhang: float) -> Cover:
    """Return spheres over a cylinder about z, in the middle: on its axis where it is slender, else as over a box.

    Along the side no sphere reaches beyond the overhang asked for. Spheres on the axis reach farther beyond the ends,
    which is in the overhang returned: ends of links meet the next link.

    Args:
        radius: Radius [m].
        length: Length along z [m].
        overhang: Largest distance from the side that a sphere may reach [m].

    Raises:
        ValueError: That takes more than 4096 spheres.
    """
    if length < radius:
        return box_cover(np.array([2 * radius, 2 * radius, length]), overhang)
    count = max(int(np.ceil(length / _spacing(radius, overhang) - 1e-9)), 1)
    if count > _MOST:
        raise ValueError(f"a cylinder {length:.3g} m long takes {count:.0f} spheres; give a larger overhang")
    half = length / count / 2
    height = (2 * np.arange(count) + 1) * half - length / 2
    grown = float(np.hypot(radius, half))
    centers = np.stack([np.zeros(count), np.zeros(count), height], axis=-1)
    return Cover(centers, np.full(count, grown), max(grown - half, grown - radius))


def _spacing(radius: float, overhang: float) -> float:
    """Distance of spheres on a line that reach that far beyond a radius between them."""
    return 2.0 * float(np.sqrt(overhang * (2.0 * radius + overhang)))


def joined(covers: list[Cover]) -> Cover:
    """Return several covers as one."""
    if not covers:
        return Cover(np.zeros((0, 3)), np.zeros(0), 0.0)
    centers, radii, overhangs = zip(*covers, strict=True)
    return Cover(np.concatenate(centers), np.concatenate(radii), max(overhangs))
