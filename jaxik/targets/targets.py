"""What the tool is asked to do: a full pose, or a point and a direction."""

from dataclasses import dataclass

import jax
from jaxtyping import Array, Float


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Pose:
    """Position and rotation of the tool in the arm's base frame: six task freedoms.

    Attributes:
        position: Tool point, ``(*batch, 3)`` [m].
        rotation: Rotation matrix whose columns are the tool's axes, ``(*batch, 3, 3)``.
    """

    position: Float[Array, "*batch 3"]
    rotation: Float[Array, "*batch 3 3"]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Pointing:
    """Tool point and the direction the hand points in, roll about it left free: five task freedoms.

    Attributes:
        position: Tool point, ``(*batch, 3)`` [m].
        direction: Direction of the tool's z axis, ``(*batch, 3)``; any length but zero.
    """

    position: Float[Array, "*batch 3"]
    direction: Float[Array, "*batch 3"]


Target = Pose | Pointing
