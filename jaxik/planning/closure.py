"""Closed paths: motions whose last posture is their first, whatever that is, so that they can be repeated for ever."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxik.arm import Arm
from jaxik.targets import Pose, Target

# Two targets count as the same within these, and so does a posture that is given as at a target.
AT_POSITION = 1e-4  # of the arm's length
AT_ROTATION = 1e-3  # rad


class Closed(NamedTuple):
    """The mark of a closed path. It holds no array: that a path is closed is a matter of compilation."""


class Ends(NamedTuple):
    """The ends of a motion.

    Attributes:
        start: Posture before the path, ``(joint,)`` [rad], or None.
        end: Posture after it, likewise.
        returns: True if the motion has to end as it begins.
    """

    start: ArrayLike | None
    end: ArrayLike | None
    returns: bool

    def closed(self, pinned: bool, end_pinned: bool) -> bool:
        """Test whether the path itself is closed: it begins with any posture, or both ends are pinned to one."""
        return self.returns and (self.start is None or (pinned and end_pinned))


def ends_of(start: ArrayLike | None, end: ArrayLike | str | None) -> Ends:
    """Return the ends that the options ``start`` and ``end`` of a plan ask for.

    Raises:
        ValueError: ``end`` is a word other than "start".
    """
    if not isinstance(end, str):
        return Ends(start, end, False)
    if end != "start":
        raise ValueError(f'end needs to be a posture, "start" for a motion that returns, or None; got {end!r}')
    return Ends(start, start, True)


def same_ends(target: Target) -> Target:
    """Return K targets with the first in the place of the last, as host arrays."""
    return jax.tree.map(lambda x: np.concatenate([x[:-1], x[:1]]), jax.tree.map(np.asarray, target))


def opening(target: Target) -> tuple[Array, Array]:
    """Return the distance [m] and the angle [rad] between the first and the last of K targets, ``()`` each."""
    if isinstance(target, Pose):
        turned, diameter = target.rotation[-1] - target.rotation[0], 8.0**0.5
    else:
        length = jnp.linalg.norm(target.direction, axis=-1, keepdims=True)
        direction = target.direction / length
        turned, diameter = direction[-1] - direction[0], 2.0
    away = jnp.linalg.norm(target.position[-1] - target.position[0])
    return away, 2 * jnp.arcsin(jnp.clip(jnp.linalg.norm(turned) / diameter, 0.0, 1.0))


def is_closed(arm: Arm, target: Target) -> Array:
    """Test whether the last of K targets is the first, ``()``."""
    away, angle = opening(jax.lax.stop_gradient(target))
    return (away <= AT_POSITION * arm.length) & (angle <= AT_ROTATION)
