"""Spheres over the convex hull of points: the meshes of links.

A piece of the hull is inside the ball about a center that holds the piece's corners, and the ball reaches beyond the
hull by its radius less the depth of its center at most. A piece whose best ball reaches too far is cut in two; pieces
near each other are joined again where one ball does for both.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from jaxik.obstacles.covers import LARGEST, Cover

_MOST = 2048  # spheres of one hull
_CUBE = 2.7  # edge of the largest cube whose ball reaches one overhang beyond it, in overhangs
_STEPS = 40  # of the search for the center of a ball
_NEAR = 8  # pieces that a piece may be joined with
_THIN = 1e-6  # half the thickness that a flat shape is given [m]


def hull_cover(points: np.ndarray, overhang: float) -> Cover:
    """Return spheres over the convex hull of points ``(n, 3)`` [m].

    Args:
        points: The points, such as the vertices of a mesh.
        overhang: Largest distance from the hull that a sphere may reach [m].

    Raises:
        ValueError: The overhang is below 2 µm, points are not finite, or more than 2048 spheres are needed.
    """
    points = np.asarray(points, float).reshape(-1, 3)
    if not overhang > 2 * _THIN:
        raise ValueError(f"expected an overhang above {1e3 * 2 * _THIN:g} mm for a mesh; got {1e3 * overhang:.3g} mm")
    if not len(points) or not (np.abs(points) <= LARGEST).all():
        raise ValueError(f"expected a mesh with finite vertices, within {LARGEST:.0e} m")
    hull = _hull(points)
    planes = np.unique(hull.equations.round(12), axis=0)  # triangles of one face share theirs
    pieces = _joined(_pieces(hull.points[hull.vertices], planes, overhang), planes, overhang)
    centers, radii = (np.array(x) for x in zip(*((p.center, p.radius) for p in pieces), strict=True))
    return Cover(centers, radii, max(p.beyond for p in pieces) + 2 * _THIN)


class _Piece(NamedTuple):
    """A convex piece, by points it is the hull of, and a ball about it."""

    corners: np.ndarray
    center: np.ndarray
    radius: float
    beyond: float


def _hull(points: np.ndarray) -> ConvexHull:
    """The convex hull; of points in a plane, that of a thin plate about them."""
    try:
        return ConvexHull(points)
    except QhullError:
        corners = _THIN * np.stack(np.meshgrid(*([-1.0, 1.0],) * 3), axis=-1).reshape(-1, 3)
        return ConvexHull((points[:, None] + corners).reshape(-1, 3))


def _pieces(corners: np.ndarray, planes: np.ndarray, overhang: float) -> list[_Piece]:
    """Pieces whose balls reach beyond the hull no farther than the overhang, and that are the hull together."""
    todo, pieces = [corners], []
    while todo:
        piece = _in_ball(todo.pop(), planes, overhang)
        if piece.beyond <= overhang - 2 * _THIN:
            pieces.append(piece)
            continue
        todo += _halves(piece.corners, overhang)
        if len(todo) + len(pieces) > _MOST:
            size = " x ".join(f"{x:.3g}" for x in np.ptp(corners, axis=0))
            raise ValueError(
                f"a mesh of {size} m takes more than {_MOST} spheres for an overhang of {1e3 * overhang:.3g} mm; give "
                "a larger overhang"
            )
    return pieces


def _joined(pieces: list[_Piece], planes: np.ndarray, overhang: float) -> list[_Piece]:
    """The same with fewer pieces: small ones are joined with one of those nearest, where a ball does for both."""
    pieces, done = sorted(pieces, key=lambda piece: piece.radius), []
    while pieces:
        piece = pieces.pop(0)
        away = [float(np.linalg.norm(other.center - piece.center)) for other in pieces]
        for near in np.argsort(away, kind="stable")[:_NEAR]:
            both = _in_ball(np.concatenate([piece.corners, pieces[near].corners]), planes, overhang)
            if both.beyond <= overhang - 2 * _THIN:
                del pieces[near]
                pieces.append(both)
                break
        else:
            done.append(piece)
    return done


def _in_ball(corners: np.ndarray, planes: np.ndarray, overhang: float) -> _Piece:
    """The piece with these corners, in a ball that reaches beyond the planes as little as may be.

    That distance, the radius less the depth of the center, is convex in the center: descents with ever smaller steps.
    """
    center = (corners.min(axis=0) + corners.max(axis=0)) / 2
    step, best = np.ptp(corners, axis=0).max() / 4, _Piece(corners, center, np.inf, np.inf)
    for _ in range(_STEPS):
        away = center - corners
        apart = np.linalg.norm(away, axis=1)
        far = int(np.argmax(apart))
        height = planes[:, :3] @ center + planes[:, 3]
        face = int(np.argmax(height))
        beyond = apart[far] + height[face]
        if beyond < best.beyond:
            best = _Piece(corners, center, float(apart[far]), float(beyond))
        slope = away[far] / max(apart[far], _THIN) + planes[face, :3]
        size = np.linalg.norm(slope)
        if beyond <= overhang / 2 or size < 1e-9:
            break
        center = center - step / size * slope
        step *= 0.85
    return best


def _halves(corners: np.ndarray, overhang: float) -> list[np.ndarray]:
    """Corners of two parts of a convex piece, cut across its longest side."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    axis = int(np.argmax(high - low))
    parts = max(int(np.ceil((high - low)[axis] / (_CUBE * overhang) - 1e-9)), 2)
    at = low[axis] + (parts // 2) / parts * (high - low)[axis]
    try:
        hull = ConvexHull(corners)
        corners, triangles = hull.points, hull.simplices
        edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
        used = corners[hull.vertices]
    except QhullError:  # thinner than rounding: every two corners, whose lines are in the piece all the same
        edges, used = np.stack(np.triu_indices(len(corners), 1), axis=-1), corners
    start, end = corners[edges[:, 0]], corners[edges[:, 1]]
    crosses = (start[:, axis] - at) * (end[:, axis] - at) < 0
    start, end = start[crosses], end[crosses]
    share = (at - start[:, axis]) / (end[:, axis] - start[:, axis])
    cut = start + share[:, None] * (end - start)
    cut[:, axis] = at
    cut = np.unique(cut, axis=0)
    return [np.concatenate([used[side], cut]) for side in (used[:, axis] <= at, used[:, axis] >= at)]
