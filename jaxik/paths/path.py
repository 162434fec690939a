"""Paths: targets of the tool with the times at which they are due."""

from dataclasses import dataclass, field, replace

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike, DTypeLike
from jaxtyping import Array, Float

from jaxik.targets import Pose, Target, TargetLike, as_array, as_target

_SHORTEST = 1e-3  # paced step in which the tool rests [s], so that times increase
_STEP_TOLERANCE = 1e-5  # of a step: an hour at 1 kHz in float64, a second in float32, stay as they are
_UNIT_TOLERANCE = 1e-4  # files often carry six decimals; anything worse is a mistake, not rounding


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Placement:
    """Map of a path into an arm's workspace: ``p' = translation + scale * rotation @ p``.

    Rotations of the tool follow as ``R' = rotation @ R @ tool``.

    Attributes:
        scale: Factor on lengths, ``()``.
        rotation: Rotation of the path in the base frame, ``(3, 3)``.
        translation: Translation, ``(3,)`` [m].
        tool: Rotation of the tool where the path asks for the identity, before ``rotation``, ``(3, 3)``.
        clock: Factor on times, ``()``: above 1 where the arm's joints are too slow for the path's own.
    """

    scale: Float[Array, ""]
    rotation: Float[Array, "3 3"]
    translation: Float[Array, "3"]
    tool: Float[Array, "3 3"]
    clock: Float[ArrayLike, ""] = 1.0

    def describe(self) -> str:
        """Describe the placement.

        Returns:
            A sentence with scale, rotation angle, translation, pointing direction and, if it is slower, the clock.
        """
        t = ", ".join(f"{x:.3f}" for x in np.asarray(self.translation))
        turn = np.degrees(np.arccos(np.clip((np.trace(np.asarray(self.rotation)) - 1) / 2, -1, 1)))
        z = ", ".join(f"{x:.2f}" for x in np.asarray(self.rotation @ self.tool)[:, 2])
        slower = "" if np.all(np.asarray(self.clock) == 1) else f", {float(np.asarray(self.clock)):.2f} times slower"
        where = f"scaled by {float(self.scale):.3f}, turned by {turn:.0f}°, moved by ({t}) m"
        return f"{where}, hand pointing along ({z}){slower}"


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Path:
    """K targets and the times at which the tool is to reach them.

    Attributes:
        target: :class:`jaxik.Pose` or :class:`jaxik.Pointing` with leading axis K.
        time: Strictly increasing times, ``(K,)`` [s].
        placement: Map by which :func:`jaxik.fit_path` moved the path; None for a path in its original place.
    """

    target: Target
    time: Float[Array, "waypoint"]
    placement: Placement | None = field(default=None)

    def __len__(self) -> int:
        """Number of waypoints K."""
        return self.time.shape[-1]

    def __getitem__(self, part: slice) -> "Path":
        """Return a part of the path, such as ``path[:100]``, with its own times."""
        if not isinstance(part, slice):
            raise TypeError(f"expected a slice of the path, such as path[:100]; got {part!r}")
        return replace(self, target=jax.tree.map(lambda x: x[part], self.target), time=self.time[part])

    @classmethod
    def paced(cls, target: TargetLike, *, speed: float = 0.1, turn_speed: float = 0.5) -> "Path":
        """Return the path through targets at the times at which the tool moves steadily.

        Plan it, then let :meth:`jaxik.Plan.retimed` find the times that suit the arm.

        Args:
            target: K targets.
            speed: Speed of the tool point [m/s]; this default and the next are slow enough for the joints of any arm
                away from singular postures.
            turn_speed: Speed of the tool's rotation [rad/s]. A step takes as long as the slower of the two needs, and
                at least a millisecond.

        Returns:
            The path, beginning at time 0.

        Raises:
            ValueError: If it is not a target, or a speed is not positive.

        Example:
            >>> import jaxik
            >>> target = jaxik.Pointing(jnp.array([[0.0, 0, 0], [0.2, 0, 0]]), jnp.array([[1.0, 0, 0], [1.0, 0, 0]]))
            >>> Path.paced(target, speed=0.1).time.tolist()
            [0.0, 2.0]
        """
        if not (speed > 0 and turn_speed > 0):
            raise ValueError(f"expected positive speeds; got speed={speed} and turn_speed={turn_speed}")
        target = as_target(target)
        distance = jnp.linalg.norm(jnp.diff(target.position, axis=-2), axis=-1)
        duration = jnp.maximum(jnp.maximum(distance / speed, _turns(target) / turn_speed), _SHORTEST)
        return cls(target, jnp.cumsum(jnp.pad(duration, (1, 0))))

    @property
    def length(self) -> Float[Array, ""]:
        """Length of the line through the tool points [m]."""
        return jnp.sum(jnp.linalg.norm(jnp.diff(self.target.position, axis=-2), axis=-1), axis=-1)

    def checked(self) -> "Path":
        """Return the path if its values are valid; for use outside ``jit``.

        Returns:
            The path itself; one whose target is given as matrices ``(K, 4, 4)`` or lists comes back with arrays.

        Raises:
            ValueError: Wrong shapes, fewer than two waypoints, values that are not finite, times that do not increase,
                matrices that are no rotations or directions without length; with the first waypoint concerned.
        """
        target, given = as_target(self.target), as_array("times of shape (K,)", self.time)
        if target is not self.target or given is not self.time:
            return replace(self, target=target, time=given).checked()
        kind = "Pose" if isinstance(self.target, Pose) else "Pointing"
        time, position = np.asarray(self.time), np.asarray(self.target.position)
        if time.ndim != 1 or position.shape != (*time.shape, 3):
            raise ValueError(
                f"a path needs time (K,) and a target with position (K, 3); got {time.shape} and {position.shape}"
            )
        if len(time) < 2:
            raise ValueError(f"a path needs at least 2 waypoints; got {len(time)}")
        turn = np.asarray(self.target.rotation if isinstance(self.target, Pose) else self.target.direction)
        expected = (len(time), 3, 3) if isinstance(self.target, Pose) else (len(time), 3)
        if turn.shape != expected:
            raise ValueError(f"a {kind} path of {len(time)} waypoints needs shape {expected}; got {turn.shape}")
        for name, values in (("time", time), ("position", position), ("rotation or direction", turn)):
            _first(np.asarray(~np.isfinite(values.reshape(len(time), -1)).all(-1)), f"{name} is not finite")
        _first(np.append(False, np.diff(time) <= 0), "time does not increase")
        if isinstance(self.target, Pose):
            off = np.abs(turn.swapaxes(-1, -2) @ turn - np.eye(3)).max((-1, -2))
            _first(np.asarray((off > _UNIT_TOLERANCE) | (np.linalg.det(turn) < 0)), "rotation is not a rotation matrix")
        else:
            _first(np.linalg.norm(turn, axis=-1) < _UNIT_TOLERANCE, "direction has no length")
        return self

    def astype(self, dtype: DTypeLike) -> "Path":
        """Return the same path with other floats.

        Times that the type cannot tell apart well, such as time stamps since 1970 in float32, are counted from the
        first waypoint.

        Args:
            dtype: Float type of every array.
        """
        path = replace(self, time=_distinct(self.time, dtype))
        return jax.tree.map(lambda x: jnp.asarray(x, dtype), path)


def _distinct(time: Array | np.ndarray, dtype: DTypeLike) -> Array | np.ndarray:
    """Return times from the first waypoint on if rounding to the type would change their steps noticeably."""
    if isinstance(time, Tracer) or np.ndim(time) != 1 or np.size(time) < 2:
        return time
    exact = np.asarray(time, np.float64)
    step = np.diff(exact)
    error = np.abs(np.diff(np.asarray(exact, dtype).astype(np.float64)) - step).max()
    return exact - exact[0] if error > _STEP_TOLERANCE * np.abs(step).min() else time


def _turns(target: Target) -> Array:
    """Return the angle by which the tool turns in every step, ``(K - 1,)`` [rad]."""
    if isinstance(target, Pose):
        axes, moving = target.rotation, 2.0  # a rotation moves two of three axes by its chord
    else:
        axes, moving = target.direction / jnp.linalg.norm(target.direction, axis=-1, keepdims=True), 1.0
    change = jnp.diff(axes, axis=0).reshape(axes.shape[0] - 1, -1)
    return 2 * jnp.arcsin(jnp.clip(jnp.linalg.norm(change, axis=-1) / (2 * moving**0.5), 0, 1))


def _first(bad: np.ndarray, problem: str) -> None:
    """Raise for the first waypoint marked bad."""
    if bad.any():
        raise ValueError(f"waypoint {int(np.argmax(bad))} of {len(bad)}: {problem}")
