"""The eight branches and the bits of their numbers."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

BRANCHES = 8


class BranchBits(NamedTuple):
    """Bits of branch numbers, each a boolean array of their shape.

    Attributes:
        shoulder: True where sin(q2 + delta) is negative, the shoulder's other solution.
        elbow: True where joint 4 is on the negative side of full stretch.
        wrist: True where sin(q6 + delta) is negative, the wrist's other solution.
    """

    shoulder: Array | np.ndarray
    elbow: Array | np.ndarray
    wrist: Array | np.ndarray


def branch_bits(branch: ArrayLike) -> BranchBits:
    """Unpack branch numbers ``4 * shoulder + 2 * elbow + wrist``; those of the host stay on the host."""
    number = branch if isinstance(branch, jax.Array) else np.asarray(branch)
    return BranchBits(*((number >> place & 1) == 1 for place in (2, 1, 0)))


def branch_number(shoulder: ArrayLike, elbow: ArrayLike, wrist: ArrayLike) -> Array:
    """Pack bits into branch numbers."""
    return 4 * jnp.asarray(shoulder, int) + 2 * jnp.asarray(elbow, int) + jnp.asarray(wrist, int)
