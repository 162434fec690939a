"""Joint ranges of one turn and more: which turn a motion is in, and where it may not pass.

1. A range of one turn, such as [-pi, pi], ends where it begins, and the joint must not jump from one end to the other.
   It is planned :data:`_APART` short of both ends, so that these are two postures and lie in different arcs.
2. A joint of a larger range is searched as if it could turn for ever: no motion is lost, and the best one is best of
   all if it fits the range once the right number of turns is added.
3. Where it does not fit, the joint gets a window of one turn within its range, which it treats as (1). A joint that
   stays within one turn fits into some window: of the windows at both ends and in the middle of the range the best is
   moved to the middle of the motion found in it, as long as that lowers the energy.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice, product

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxik.arm import Arm

_TURN = 2 * np.pi
_APART = 30.0  # times the root of eps: 4.5e-7 rad in float64, 0.01 rad in float32, where arcs end as exactly as that
_MOST = 27  # windows, or combinations of those of several joints, that are tried


def apart(arm: Arm) -> Arm:
    """Return the arm with ranges of about one turn so narrow that their ends are two postures."""
    widest = _TURN - 2 * _gap(arm)
    middle, width = (arm.lower + arm.upper) / 2, arm.upper - arm.lower
    one_turn = (width > widest) & ~arm.turning
    lower, upper = middle - widest / 2, middle + widest / 2
    return replace(arm, lower=jnp.where(one_turn, lower, arm.lower), upper=jnp.where(one_turn, upper, arm.upper))


def into_ranges(arm: Arm, q: Array, near: Array | None = None) -> Array:
    """Add to each turning joint of a motion the turns that bring all of it into the joint's range.

    Args:
        arm: The arm.
        q: Joint angles without jumps of a full turn, ``(waypoint, joint)`` [rad].
        near: Posture ``(joint,)`` to begin near to where several turns fit [rad]; None for the middles of the ranges.

    Returns:
        The motion; partly outside where no turn fits.

    **Differentiability**: derivative one in q.
    """
    lowest, highest = jnp.min(q, axis=0), jnp.max(q, axis=0)
    slack = _rounding(arm)
    least = jnp.ceil((arm.lower - slack - lowest) / _TURN)
    most = jnp.floor((arm.upper + slack - highest) / _TURN)
    away = (arm.lower + arm.upper - lowest - highest) / 2 if near is None else near - q[0]
    wanted = jnp.round(away / _TURN)
    turns = jnp.where(least <= most, jnp.clip(wanted, least, most), wanted)
    return q + _TURN * jnp.where(arm.turning, turns, 0.0)


def outside(arm: Arm, q: ArrayLike) -> Array:
    """Return which joints of a motion ``(waypoint, joint)`` leave their ranges, ``(joint,)``."""
    q = jnp.asarray(q)
    return jnp.any(jnp.maximum(arm.lower - q, q - arm.upper) > _rounding(arm), axis=0)


def windows(arm: Arm, joints: np.ndarray, through: np.ndarray | None = None) -> Iterator[Arm]:
    """Yield arms in which some turning joints have a window of one turn in the place of their range.

    Args:
        arm: The arm.
        joints: Indices of the joints.
        through: A posture ``(joint,)`` [rad] that has to be in every window, or None.
    """
    lower, upper = np.asarray(arm.lower, float), np.asarray(arm.upper, float)
    half = np.pi - float(_gap(arm))
    choices = []
    for joint in joints:
        low, high = lower[joint] + half, upper[joint] - half
        if through is not None:
            low, high = max(low, through[joint] - half), min(high, through[joint] + half)
        middle = (low + high) / 2 if through is None else float(np.clip(through[joint], low, high))
        choices.append(dict.fromkeys((middle, low, high)))
    for centers in islice(product(*choices), _MOST):
        yield window(arm, joints, np.asarray(centers))


def window(arm: Arm, joints: np.ndarray, centers: np.ndarray) -> Arm:
    """Return the arm in which some joints have one turn about a center in the place of their range."""
    half = np.pi - float(_gap(arm))
    middle = jnp.clip(jnp.asarray(centers, arm.lower.dtype), arm.lower[joints] + half, arm.upper[joints] - half)
    return replace(arm, lower=arm.lower.at[joints].set(middle - half), upper=arm.upper.at[joints].set(middle + half))


def _gap(arm: Arm) -> Array:
    return jnp.asarray(_APART * float(jnp.finfo(arm.lower.dtype).eps) ** 0.5, arm.lower.dtype)


def _rounding(arm: Arm) -> float:
    """Rounding at a limit [rad]."""
    return max(1e-6, 4096 * float(jnp.finfo(arm.lower.dtype).eps))
