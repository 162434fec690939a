"""The eight branches: what the bits of a branch number say."""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

BRANCHES = 8


class BranchBits(NamedTuple):
    """Bits of branch numbers, each a boolean array of their shape.

    Attributes:
        shoulder: Whether sin(q2 + delta) is negative: the shoulder's other solution.
        elbow: Whether joint 4 is on the negative side of full stretch.
        wrist: Whether sin(q6 + delta) is negative: the wrist's other solution.
    """

    shoulder: Array
    elbow: Array
    wrist: Array


def branch_bits(branch: ArrayLike) -> BranchBits:
    """Unpack branch numbers ``4 * shoulder + 2 * elbow + wrist``."""
    number = jnp.asarray(branch)
    return BranchBits(*((number >> place & 1) == 1 for place in (2, 1, 0)))


def branch_number(shoulder: ArrayLike, elbow: ArrayLike, wrist: ArrayLike) -> Array:
    """Pack bits into branch numbers."""
    return 4 * jnp.asarray(shoulder, int) + 2 * jnp.asarray(elbow, int) + jnp.asarray(wrist, int)
