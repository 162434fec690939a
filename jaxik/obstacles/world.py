"""Obstacles about an arm: spheres and half-spaces as arrays."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxik.numerics import at_hand
from jaxik.targets import as_array, as_floats

_UNIT = 1e-6  # of a normal's length; rounding of float32 and of six decimals
_SMALLEST = 16  # spheres; sizes double from here on, so that few programs serve worlds of any size


@jax.tree_util.register_pytree_node_class
@dataclass(frozen=True, init=False, eq=False)
class World:
    """Spheres that the arm must stay out of, and half-spaces that it must stay in, in the arm's base frame.

    A sphere with a negative radius is padding: it is nowhere. Leading batch axes are one world per target or waypoint.
    Worlds of few sizes are compiled for: a size is padded to the next power of two.

    Attributes:
        centers: Centers of the spheres, ``(*batch, N, 3)`` [m].
        radii: Their radii, ``(*batch, N)`` [m].
        normals: Unit normals of the half-spaces ``normal · x <= offset`` that are free, ``(*batch, H, 3)``; they point
            into the obstacle.
        offsets: Distances of their borders from the origin along the normals, ``(*batch, H)`` [m].

    Example:
        >>> import jaxik
        >>> post_and_table = jaxik.World([[0.4, 0.0, 0.5]], 0.1, normals=[[0.0, 0.0, -1.0]], offsets=[0.0])
        >>> post_and_table.radii.shape
        (1,)
    """

    centers: Float[Array, "*batch sphere 3"]
    radii: Float[Array, "*batch sphere"]
    normals: Float[Array, "*batch half_space 3"]
    offsets: Float[Array, "*batch half_space"]

    def __init__(
        self,
        centers: ArrayLike | Sequence | None = None,
        radii: ArrayLike | Sequence | None = None,
        normals: ArrayLike | Sequence | None = None,
        offsets: ArrayLike | Sequence | None = None,
    ) -> None:
        """Check shapes, and values where they are at hand.

        Args:
            centers: Centers, ``(*batch, N, 3)`` [m]; None for no spheres.
            radii: Radii, ``(*batch, N)`` or one for all [m].
            normals: Unit normals, ``(*batch, H, 3)``; None for no half-spaces.
            offsets: Offsets, ``(*batch, H)`` or one for all [m].

        Raises:
            ValueError: Wrong shapes; a number that is not finite; a normal that is no unit vector.
        """
        given = [*_pair("centers", centers, "radii", radii), *_pair("normals", normals, "offsets", offsets)]
        centers, radii, normals, offsets = as_floats(*given)
        _check_points("centers", centers)
        _check_points("normals", normals)
        batch = _batch(centers, radii, normals, offsets)
        names = ("centers", "radii", "normals", "offsets")
        shapes = (centers.shape[-2:], centers.shape[-2:-1], normals.shape[-2:], normals.shape[-2:-1])
        for name, value, shape in zip(names, (centers, radii, normals, offsets), shapes, strict=True):
            if at_hand(value) and not bool(np.isfinite(np.asarray(value)).all()):
                raise ValueError(f"World.{name} has a number that is not finite; pad with negative radii")
            try:
                spread = jnp.broadcast_to(value, (*batch, *shape))
            except ValueError:
                raise ValueError(
                    f"World.{name} of shape {value.shape} does not fit {'centers' if name == 'radii' else 'normals'}: "
                    f"expected {(*batch, *shape)}"
                ) from None
            object.__setattr__(self, name, spread)
        if at_hand(normals):
            length = np.linalg.norm(np.asarray(normals, float), axis=-1)
            if (np.abs(length - 1.0) > _UNIT).any():
                raise ValueError(
                    f"World.normals needs unit vectors; got one of length {length.flat[_worst(length)]:.6g}"
                )

    def tree_flatten(self) -> tuple[tuple[Any, ...], None]:
        """Return the arrays."""
        return (self.centers, self.radii, self.normals, self.offsets), None

    @classmethod
    def tree_unflatten(cls, _: None, leaves: tuple[Any, ...]) -> "World":
        """Return a world of anything in the place of its arrays.

        Args:
            leaves: Centers, radii, normals and offsets.
        """
        world = object.__new__(cls)
        for name, leaf in zip(("centers", "radii", "normals", "offsets"), leaves, strict=True):
            object.__setattr__(world, name, leaf)
        return world

    @property
    def batch(self) -> tuple[int, ...]:
        """Batch axes: empty for a world that is the same for all targets."""
        return jnp.shape(self.radii)[:-1]

    @property
    def moving(self) -> bool:
        """True for a world per target or waypoint."""
        return bool(self.batch)

    def rows(self, index: Any) -> "World":
        """Return the worlds of some rows, or the world itself where there is one for all.

        Args:
            index: Index of the first batch axis.
        """
        return jax.tree.map(lambda x: x[index], self) if self.moving else self

    def padded(self) -> "World":
        """Return the world with spheres of negative radius, up to one of a few sizes."""
        count = self.radii.shape[-1]
        more = _size(count) - count
        if not more:
            return self
        tail = [(0, 0)] * len(self.batch)
        centers = jnp.pad(self.centers, (*tail, (0, more), (0, 0)))
        radii = jnp.pad(self.radii, (*tail, (0, more)), constant_values=-1.0)
        return World.tree_unflatten(None, (centers, radii, self.normals, self.offsets))

    def grown(self, margin: ArrayLike) -> "World":
        """Return the world with every obstacle larger, padding left as it is.

        Args:
            margin: Length that is added to radii and taken off offsets [m].
        """
        margin = jnp.asarray(margin, self.radii.dtype)
        radii = jnp.where(self.radii < 0.0, self.radii, self.radii + margin)
        return World.tree_unflatten(None, (self.centers, radii, self.normals, self.offsets - margin))


def _pair(name: str, points: Any, other: str, sizes: Any) -> tuple[Any, Any]:
    """Points and their sizes, none of both for None."""
    if points is None:
        if sizes is not None:
            raise ValueError(f"World.{other} needs World.{name}")
        return np.zeros((0, 3), np.float32), np.zeros((0,), np.float32)
    if sizes is None:
        raise ValueError(f"World.{name} needs World.{other}")
    points = as_array(f"World.{name} of shape (*batch, n, 3)", points)
    return points if np.size(points) else np.zeros((0, 3), np.float32), as_array(f"World.{other}", sizes)


def _check_points(name: str, value: Array) -> None:
    if value.ndim < 2 or value.shape[-1] != 3:
        raise ValueError(f"expected World.{name} of shape (*batch, n, 3), got {value.shape}")


def _batch(centers: Array, radii: Array, normals: Array, offsets: Array) -> tuple[int, ...]:
    try:
        return jnp.broadcast_shapes(centers.shape[:-2], radii.shape[:-1], normals.shape[:-2], offsets.shape[:-1])
    except ValueError:
        shapes = ", ".join(str(x.shape) for x in (centers, radii, normals, offsets))
        raise ValueError(f"batch axes of World's arrays do not broadcast: got {shapes}") from None


def _worst(length: np.ndarray) -> int:
    return int(np.argmax(np.abs(length - 1.0)))


def _size(count: int) -> int:
    return count if not count else max(_SMALLEST, 1 << (count - 1).bit_length())
