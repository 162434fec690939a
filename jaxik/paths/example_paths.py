"""Example paths, generated in code.

All are drawn as published end-effector paths are: in front of a robot that looks along x, with y to its left and z up,
in meters, beginning at the origin; :func:`jaxik.fit_path` puts them within an arm's reach.
"""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np

from jaxik.paths.path import Path
from jaxik.targets import Pose, matrix_from_rotation_vector

_STEP = 0.04  # two frames of a hobby servo [s]: a servo cannot follow anything finer

# The written word "arm" as control points (right, up) of a single stroke, in units of the x-height.
_WORD = (
    ((0.75, 0.85), (0.4, 1.0), (0.02, 0.5), (0.3, 0.0), (0.7, 0.4), (0.8, 1.0), (0.8, 0.35), (1.0, 0.0), (1.25, 0.3)),
    ((1.4, 1.0), (1.45, 1.15), (1.55, 0.95), (1.85, 0.92), (1.9, 0.6), (1.9, 0.2), (2.1, 0.0), (2.35, 0.4)),
    ((2.5, 0.95), (2.6, 0.95), (2.62, 0.5), (2.62, 0.0), (2.66, 0.5), (2.9, 1.0), (3.12, 0.8), (3.15, 0.0)),
    ((3.2, 0.5), (3.42, 1.0), (3.65, 0.8), (3.67, 0.3), (3.85, 0.0), (4.1, 0.2)),
)


def example_path(name: str = "word") -> Path:
    """Return an example path of poses.

    Args:
        name: One of :func:`example_path_names`.

    Returns:
        The path, beginning at the origin, in JAX's default float type.

    Raises:
        ValueError: No such path; the message lists the names.
    """
    if not isinstance(name, str) or name not in _MAKERS:
        raise ValueError(f"no example path {name!r}; there are {', '.join(_MAKERS)}")
    position, rotation, time = _MAKERS[name]()
    return Path(Pose(jnp.asarray(position - position[0]), jnp.asarray(rotation)), jnp.asarray(time))


def example_path_names() -> tuple[str, ...]:
    """Return the names that :func:`example_path` knows."""
    return tuple(_MAKERS)


Drawn = tuple[np.ndarray, np.ndarray, np.ndarray]


def _word() -> Drawn:
    """Write the word "arm" in one stroke, 0.8 m wide, at a steady 0.3 m/s."""
    curve = 0.2 * _smooth(np.array([point for piece in _WORD for point in piece]), 24)
    position = _evenly(np.stack([np.zeros(len(curve)), -curve[:, 0], curve[:, 1]], -1), speed=0.3)
    return position, _no_turn(len(position)), _times(len(position))


def _figure_eight() -> Drawn:
    """Draw a lying eight twice, 0.6 m wide, while the hand turns along by up to 20 degrees."""
    u = 2 * np.pi * _ease(2 * 6.0) * 2
    position = np.stack([np.zeros_like(u), 0.3 * np.sin(u), 0.15 * np.sin(2 * u)], -1)
    rotation = _turn(2, np.radians(20) * np.sin(u)) @ _turn(1, -np.radians(12) * np.sin(2 * u))
    return position, rotation, _times(len(u))


def _reach() -> Drawn:
    """Reach from beside the body up and out to a shelf in 4 s while the hand turns by 60 degrees."""
    s = _ease(4.0)
    start, knot, end = np.array([0, 0, 0]), np.array([0.05, 0.15, 0.35]), np.array([0.3, 0.25, 0.5])
    position = np.outer((1 - s) ** 2, start) + np.outer(2 * s * (1 - s), knot) + np.outer(s**2, end)
    return position, _turn(2, np.radians(25) * s) @ _turn(1, np.radians(30) - np.radians(60) * s), _times(len(s))


def _wave() -> Drawn:
    """Wave a raised hand three times in 8 s, turning it by 30 degrees about its pointing axis."""
    s = _ease(8.0)
    swing = np.sin(2 * np.pi * 3 * s) * np.sin(np.pi * s) ** 0.5
    position = np.stack([0.02 * np.cos(np.pi * swing), 0.18 * swing, 0.05 * (1 - swing**2)], -1)
    return position, _turn(0, -np.radians(30) * swing), _times(len(s))


def _spiral() -> Drawn:
    """Draw a spiral of three turns out to 0.25 m in 16 s while the hand tilts to point at the center."""
    s = _ease(16.0)
    angle, radius = 2 * np.pi * 3 * s, 0.25 * s
    position = np.stack([np.zeros_like(s), radius * np.cos(angle), radius * np.sin(angle)], -1)
    tilt = np.radians(25) * s
    return position, _turn(2, -tilt * np.cos(angle)) @ _turn(1, tilt * np.sin(angle)), _times(len(s))


_MAKERS: dict[str, Callable[[], Drawn]] = {
    "word": _word,
    "figure-eight": _figure_eight,
    "reach": _reach,
    "wave": _wave,
    "spiral": _spiral,
}


def _times(count: int) -> np.ndarray:
    return _STEP * np.arange(count)


def _ease(duration: float) -> np.ndarray:
    """Return the minimum-jerk motion from 0 to 1, which starts and ends at rest."""
    u = np.linspace(0, 1, round(duration / _STEP) + 1)
    return u**3 * (10 - 15 * u + 6 * u**2)


def _no_turn(count: int) -> np.ndarray:
    return np.broadcast_to(np.eye(3), (count, 3, 3)).copy()


def _turn(axis: int, angle: np.ndarray) -> np.ndarray:
    """Return rotations about a base axis, ``(K, 3, 3)``."""
    return matrix_from_rotation_vector(angle[:, None] * np.eye(3)[axis])


def _smooth(points: np.ndarray, per_piece: int) -> np.ndarray:
    """Return a Catmull-Rom curve through control points."""
    p = np.concatenate([2 * points[:1] - points[1:2], points, 2 * points[-1:] - points[-2:-1]])
    u = np.linspace(0, 1, per_piece, endpoint=False)[:, None]
    pieces = []
    for a, b, c, d in zip(p, p[1:], p[2:], p[3:], strict=False):
        pieces.append(b + u * (c - a) / 2 + u**2 * (2 * a - 5 * b + 4 * c - d) / 2 + u**3 * (3 * (b - c) + d - a) / 2)
    return np.concatenate([*pieces, points[-1:]])


def _evenly(points: np.ndarray, speed: float) -> np.ndarray:
    """Sample a curve at a steady speed [m/s] that rises and falls over the first and last half second."""
    length = np.append(0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=-1)))
    keep = np.append(True, np.diff(length) > 0)
    ramp = 0.5
    duration = length[-1] / speed + ramp
    t = np.linspace(0, duration, int(np.ceil(duration / _STEP)) + 1)
    rate = np.clip(np.minimum(t, duration - t) / ramp, 0, 1)
    done = np.append(0, np.cumsum((rate[1:] + rate[:-1]) / 2))
    done *= length[-1] / done[-1]
    return np.stack([np.interp(done, length[keep], column) for column in points[keep].T], -1)
