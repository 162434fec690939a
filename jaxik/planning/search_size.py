"""The tool's travel along paths, and the number of waypoints that the global search sees for it."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxik.arm import Arm, ArmModel, as_arm
from jaxik.numerics import compiled_sooner
from jaxik.planning.padding import padded_size
from jaxik.targets import Pose, Target, TargetLike, as_target

_STEP = 0.16  # tool motion between searched waypoints, in arm lengths and radians: several cells of the lattice
_COUNTS = (12, 24, 32, 48, 64, 96, 128, 256)  # few sizes, so that few programs are compiled
_FEWEST, _MOST = 24, 128  # in a first search


def searched_waypoints(arm: Arm | ArmModel, target: TargetLike, *, density: float = 1.0) -> int:
    """Return how many waypoints of a path the global search should see; for use outside ``jit``.

    Args:
        arm: The arm.
        target: K targets, ``(K, ...)``, or many paths, ``(*batch, K, ...)``, of which the longest counts.
        density: Multiple of the usual number: more find narrow passages, fewer hide the lattice's coarseness.

    Returns:
        A number from a short list, at most K.
    """
    return searched_counts(arm, target, (density,))[0]


def searched_counts(arm: Arm | ArmModel, target: TargetLike, densities: Sequence[float]) -> tuple[int, ...]:
    """Return :func:`searched_waypoints` for several densities, of which the tool's travel is computed once."""
    target = as_target(target)
    length, axis = target.position.shape[-2], target.position.ndim - 2
    rows = np.minimum(np.arange(padded_size(length)), length - 1)  # repetitions are no travel
    travel = float(
        np.max(
            tool_travel(
                as_arm(arm, any_class=True),
                jax.tree.map(lambda x: np.take(np.asarray(x), rows, axis), target),
            )
        )
    )
    usual = np.clip(travel / _STEP, _FEWEST, _MOST)
    return tuple(min(length, searched_size(density * usual)) for density in densities)


def searched_size(wanted: float | int) -> int:
    """Return the smallest number of the list that holds so many waypoints, or the largest."""
    return min((size for size in _COUNTS if size >= wanted), default=_COUNTS[-1])


@compiled_sooner
def tool_travel(arm: Arm, target: Target) -> Float[Array, "*batch"]:
    """Return the tool's travel along paths ``(*batch, K)``: way in arm lengths plus turns in radians, ``(*batch,)``."""
    length = arm.length.astype(target.position.dtype)
    if isinstance(target, Pose):
        axes, moving = target.rotation, 2.0  # a turn moves two of three axes by its chord
    else:
        direction = target.direction
        axes, moving = (direction / jnp.linalg.norm(direction, axis=-1, keepdims=True))[..., None], 1.0
    way = jnp.sqrt(jnp.sum(jnp.diff(target.position, axis=-2) ** 2, axis=-1)) / length
    chord = jnp.sqrt(jnp.sum(jnp.diff(axes, axis=-3) ** 2, axis=(-2, -1)) / moving)
    return jnp.sum(way + 2.0 * jnp.arcsin(jnp.clip(chord / 2.0, 0.0, 1.0)), axis=-1)
