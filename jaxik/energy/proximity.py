"""The energy of being near to obstacles, so that motions keep away where that costs little."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxik.arm import Arm, ArmModel
from jaxik.energy.energy import Energy
from jaxik.energy.term import Term, node_weights
from jaxik.numerics import at_hand
from jaxik.obstacles import Body, World, closeness, in_world


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Proximity(Term):
    """∫ Σ max(0, 1 - d / D)³ dt over the distances d of all that must not meet.

    Attributes:
        body: The body.
        world: The world, at rest.
        distance: Distance D from which on nothing costs, ``()`` [m].
    """

    body: Body
    world: World
    distance: Float[Array, ""]

    name = "proximity"
    unit = "s"
    formula = "Σ max(0, 1 - d / D)³ dt"
    separable = True
    paddable = True

    def total(self, arm: Arm, q: Array, time: Array) -> Array:
        """See :class:`jaxik.energy.Term`."""
        return jnp.sum(node_weights(time) * self.rest_rate(arm, q))

    def rest_rate(self, arm: Arm, q: Array) -> Array:
        """See :class:`jaxik.energy.Term`."""
        body, world, distance = jax.tree.map(lambda x: jnp.asarray(x, q.dtype), (self.body, self.world, self.distance))
        columns = jnp.moveaxis(q, -1, 0).reshape(q.shape[-1], -1)
        return closeness(arm, body, world, distance, columns).reshape(q.shape[:-1])


def proximity(arm: Arm | ArmModel, world: World | None = None, *, distance: Float[ArrayLike, ""] = 0.1) -> Energy:
    """∫ Σ max(0, 1 - d / D)³ dt [s] over the distances d of the body's spheres from obstacles and from each other.

    It adds to the energies of motion, with a weight that is the worth of a second in contact: plans then keep away from
    obstacles where that costs little. ``plan(..., world=)`` is what keeps them from meeting these.

    Args:
        arm: The arm with its body (:func:`jaxik.with_body`).
        world: Obstacles at rest; None for the body's own pairs alone.
        distance: Distance D from which on nothing costs [m].

    Returns:
        The energy, twice continuously differentiable in joint angles, centers, radii and half-spaces. It has no bound
        for certificates: plan with ``gap=None``, or without it in the energy.

    Raises:
        ValueError: An arm without a body; a world that moves; a distance that is not above 0 m.

    Example:
        >>> import jaxik
        >>> model = jaxik.with_body(jaxik.presets.iiwa14(), jaxik.Body.preset("iiwa14"))
        >>> ball = jaxik.World([[0.2, 0.4, 0.6]], 0.08)
        >>> str(jaxik.energy.joint_motion() + 0.5 * jaxik.energy.proximity(model, ball))
        'joint motion + 0.5 proximity'
    """
    carrying = arm.arm if isinstance(arm, ArmModel) else arm
    world = World() if world is None else world
    placed = in_world(carrying, world)
    if world.moving:
        raise ValueError(f"the energy of proximity is of a world at rest; got one with batch axes {world.batch}")
    if at_hand(distance) and not bool(np.asarray(distance) > 0):
        raise ValueError(f"distance is a length above 0 m; got {distance!r}")
    around = placed.surroundings
    return Energy((Proximity(around.body, around.world, jnp.asarray(distance, around.body.radii.dtype)),), (1.0,))
