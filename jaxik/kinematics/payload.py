"""Loads in the hand."""

import dataclasses
from typing import Any, TypeVar

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike, DTypeLike
from jaxtyping import Float

from jaxik.arm import Arm, ArmModel, LinkInertia, as_arm
from jaxik.targets import as_array, compose, rotate

AnyArm = TypeVar("AnyArm", Arm, ArmModel)


def with_payload(
    arm: AnyArm,
    mass: Float[ArrayLike, ""],
    center_of_mass: Float[ArrayLike, "3"] | None = None,
    inertia: Float[ArrayLike, "3 3"] | None = None,
) -> AnyArm:
    """Return the arm with a load fixed to its hand.

    Args:
        arm: The arm, or the model that also knows its names.
        mass: Mass of the load [kg]. Its sign is not checked: a negative one takes a load off again.
        center_of_mass: Center of mass in the tool frame, ``(3,)`` [m]; None for the tool point.
        inertia: Inertia about the load's center of mass along the tool's axes, ``(3, 3)`` [kg m²]; None for a point
            mass.

    Returns:
        The same kind of arm, whose last link is the hand and the load as one body. A model also gets a note.

    Raises:
        ValueError: If a shape is wrong, or ``arm`` is not an arm.

    **Differentiability**: smooth in all arguments for a positive total mass.

    Example:
        >>> import jaxik
        >>> arm = with_payload(jaxik.presets.iiwa14(), 2.0).arm
        >>> round(float(arm.links.mass[-1]), 3)
        3.2
    """
    if isinstance(arm, ArmModel):
        loaded = with_payload(arm.arm, mass, center_of_mass, inertia)
        note = f"Carries a load of {float(jnp.asarray(mass)):g} kg in the hand."
        return dataclasses.replace(arm, arm=loaded, notes=(*arm.notes, note))
    arm = as_arm(arm, any_class=True)
    links, dtype = arm.links, arm.axes.dtype
    load = _checked("mass", mass, (), dtype)
    center = _checked("center_of_mass", jnp.zeros(3) if center_of_mass is None else center_of_mass, (3,), dtype)
    own = _checked("inertia", jnp.zeros((3, 3)) if inertia is None else inertia, (3, 3), dtype)
    center = arm.tool_position + rotate(arm.tool_rotation, center)
    own = compose(compose(arm.tool_rotation, own), arm.tool_rotation.T)
    total = links.mass[-1] + load
    # Nothing added to nothing weighs nothing, wherever its center is.
    share = jnp.where(total > 0, load / jnp.where(total > 0, total, 1.0), 0.0)
    apart = center - links.center_of_mass[-1]
    # Two bodies turn about their common center like one of this mass at their distance.
    reduced = links.mass[-1] * share
    spread = jnp.sum(apart**2) * jnp.eye(3, dtype=dtype) - jnp.outer(apart, apart)
    return dataclasses.replace(
        arm,
        links=LinkInertia(
            links.mass.at[-1].set(total),
            links.center_of_mass.at[-1].add(share * apart),
            links.inertia.at[-1].add(own + reduced * spread),
        ),
    )


def _checked(name: str, value: Any, shape: tuple[int, ...], dtype: DTypeLike) -> Array:
    array = jnp.asarray(as_array(f"numbers for the load's {name}", value), dtype)
    if array.shape != shape:
        raise ValueError(f"expected the load's {name} of shape {shape}, got {array.shape}")
    return array
