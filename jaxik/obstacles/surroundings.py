"""A body and the world about it, carried by an arm through the solvers."""

import dataclasses
from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxik.arm import Arm, ArmModel
from jaxik.numerics import at_hand
from jaxik.obstacles.body import Body
from jaxik.obstacles.world import World

A = TypeVar("A", Arm, ArmModel)
AnyArm = TypeVar("AnyArm", bound=Arm)


@jax.tree_util.register_pytree_node_class
@dataclasses.dataclass(frozen=True, eq=False)
class Surroundings:
    """The body of an arm and the world about it.

    Attributes:
        body: The body.
        world: The world.
    """

    body: Body
    world: World

    def tree_flatten(self) -> tuple[tuple[Any, ...], None]:
        """Return body and world."""
        return (self.body, self.world), None

    @classmethod
    def tree_unflatten(cls, _: None, leaves: tuple[Any, ...]) -> "Surroundings":
        """Return body and world together."""
        return cls(*leaves)

    def grown(self, margin: ArrayLike) -> "Surroundings":
        """Return both with a margin [m] between any two that must not meet."""
        half = 0.5 * jnp.asarray(margin, self.body.radii.dtype)
        return Surroundings(self.body.grown(half), self.world.grown(half))

    def rows(self, index: Any) -> "Surroundings":
        """Return the body with the worlds of some rows."""
        return Surroundings(self.body, self.world.rows(index))

    def describe(self, sphere: int, other: int) -> str:
        """Return two that meet as text: a sphere, and what :class:`jaxik.Clearance` says of the other."""
        first, count, spheres = self.body.name(sphere), len(self.body.link), self.world.radii.shape[-1]
        if other < count:
            return f"{first} and {self.body.name(other)}"
        item = other - count
        return f"{first} and " + (f"obstacle {item}" if item < spheres else f"half-space {item - spheres}")


def with_body(model: A, body: Body) -> A:
    """Return an arm with a body, so that the solvers keep it from itself and, given a world, from obstacles.

    Upper arm (links 2, 3), forearm (links 4, 5) and hand (links 6, 7) of an S-R-S arm are rigid to its closed form.
    Spheres of links that a joint turns within these parts, 1, 2, 5 and 6, are moved to that joint's axis and grow by
    the distance moved, so that they cover the same room whatever the joint does. A note of the model says by how much
    at most: cover such links by spheres on their axes, which stay as they are. Those of other arms stay as they are.

    Args:
        model: An :class:`jaxik.Arm` or :class:`jaxik.ArmModel`.
        body: The body.

    Returns:
        The same with the body; a body that it had is replaced.

    Raises:
        ValueError: A sphere is on a link that the arm does not have.

    **Differentiability**: in centers and radii of the body.

    Example:
        >>> import jax.numpy as jnp
        >>> import jaxik
        >>> body = jaxik.Body([3, 4, 7], [[0, 0, 0.6], [0, 0, 1.0], [0, 0, 1.3]], 0.08)
        >>> model = jaxik.with_body(jaxik.presets.iiwa14(), body)
        >>> round(float(jaxik.clearance(model, jnp.zeros(7)).distance), 3)
        0.54
    """
    arm = model.arm if isinstance(model, ArmModel) else model
    if max(body.link) > arm.n_joints:
        raise ValueError(f"Body.link {max(body.link)} is no link of an arm with {arm.n_joints} joints")
    exact = type(arm) is Arm  # S-R-S
    centered, moved = _centered(arm, body) if exact else (body, jnp.zeros(len(body.link)))
    bodied = dataclasses.replace(arm, surroundings=Surroundings(centered, World()))
    bodied = bodied.astype(arm.axes.dtype)
    if not isinstance(model, ArmModel):
        return bodied
    notes = (*(note for note in model.notes if not note.startswith("Body:")), *body.notes)
    if at_hand(moved) and float(jnp.max(moved)) > 1e-9 * float(arm.length):
        notes = (
            *notes,
            f"Body: spheres of links 1, 2, 5 and 6 were moved to their axes and grew by up to "
            f"{1e3 * float(jnp.max(moved)):.1f} mm.",
        )
    return dataclasses.replace(model, arm=bodied, notes=notes)


def in_world(arm: Arm, world: World | None) -> Arm:
    """Return an arm with its body in a world; None leaves the arm as it is.

    Raises:
        ValueError: The arm has no body, or it is no world.
    """
    if world is None:
        return arm
    if not isinstance(world, World):
        raise ValueError(f"expected world to be a jaxik.World, got {type(world).__name__}")
    if arm.surroundings is None:
        raise ValueError("a world needs the arm's body: model = jaxik.with_body(model, body)")
    return dataclasses.replace(arm, surroundings=Surroundings(arm.surroundings.body, world.padded()))


def in_columns(arm: AnyArm, world: World) -> AnyArm:
    """Return an arm with its body in a world whose rows come last (:func:`jaxik.obstacles.columns_of`)."""
    return dataclasses.replace(arm, surroundings=Surroundings(arm.surroundings.body, world))


def in_rows(arm: AnyArm, rows: Callable[[Array], Array]) -> AnyArm:
    """Return an arm whose world has its rows last with other rows, where each has a world of its own."""
    if arm.surroundings is None:
        return arm
    leaves = arm.surroundings.world.tree_flatten()[0]
    return in_columns(arm, World.tree_unflatten(None, tuple(x if x.shape[-1] == 1 else rows(x) for x in leaves)))


def moves(arm: Arm) -> bool:
    """Return True if the world about an arm is one per target."""
    return arm.surroundings is not None and arm.surroundings.world.moving


def _centered(arm: Arm, body: Body) -> tuple[Body, Array]:
    """The body with spheres of links 1, 2, 5 and 6 on their axes, and the distances by which they moved, ``(M,)``."""
    last = arm.n_joints
    tool = arm.tool_rotation[:, 2] if last == 6 else arm.axes[6]
    lines = {
        1: (arm.shoulder, arm.axes[0], 1),
        2: (arm.shoulder, arm.axes[2], 3),
        5: (arm.wrist, arm.axes[4], 4),
        6: (arm.wrist, tool, last),
    }
    still = np.array([link not in lines for link in body.link])
    points, along = (
        jnp.stack([lines[link][k] if link in lines else jnp.zeros(3, arm.axes.dtype) for link in body.link])
        for k in (0, 1)
    )
    centers = body.centers.astype(points.dtype)
    on_axis = points + jnp.sum((centers - points) * along, axis=-1, keepdims=True) * along
    off = centers - on_axis
    square = jnp.where(still, 1.0, jnp.sum(off * off, axis=-1))
    positive = square > 0.0
    moved = jnp.where(still | ~positive, 0.0, jnp.sqrt(jnp.where(positive, square, 1.0)))
    link = [lines[number][2] if number in lines else number for number in body.link]
    radii = body.radii.astype(points.dtype)
    radii = jnp.where(radii < 0.0, radii, radii + moved)
    return body.with_spheres(link, jnp.where(still[:, None], centers, on_axis), radii), moved
