"""The body of an arm: spheres on its links, and which pairs of them must not meet."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxik.numerics import at_hand
from jaxik.targets import as_array, as_floats

# Parts of an S-R-S arm by the number of joints that move them, 0 to 7: within a part no sphere meets another.
_PARTS = np.array([0, 0, 1, 1, 2, 2, 3, 3])
PART_NAMES = ("base", "upper arm", "forearm", "hand")


@jax.tree_util.register_pytree_node_class
@dataclass(frozen=True, init=False, eq=False)
class Body:
    """Spheres that cover an arm.

    Attributes:
        link: Number of joints that move each sphere, from 0 for the base to the number of joints for the hand, ``(M,)``
            integers. They are part of the tree structure, as the pairs: a body is compiled for.
        centers: Centers at zero joint angles in the arm's base frame, ``(M, 3)`` [m].
        radii: Radii, ``(M,)`` [m]; negative for padding.
        pairs: Spheres that must not meet, ``(pairs, 2)`` indices.

    Example:
        >>> import jaxik
        >>> jaxik.Body([3, 4, 7], [[0, 0, 0.6], [0, 0, 1.0], [0, 0, 1.3]], 0.08).pairs
        ((0, 2),)
    """

    link: tuple[int, ...]
    centers: Float[Array, "sphere 3"]
    radii: Float[Array, "sphere"]
    pairs: tuple[tuple[int, int], ...]

    def __init__(
        self,
        link: Sequence[int] | np.ndarray | Array,
        centers: ArrayLike | Sequence,
        radii: ArrayLike | Sequence,
        pairs: Sequence | np.ndarray | Array | None = None,
    ) -> None:
        """Check shapes and values.

        Args:
            link: Number of joints that move each sphere, ``(M,)`` integers from 0 to 7.
            centers: Centers at zero joint angles in the base frame, ``(M, 3)`` [m].
            radii: Radii, ``(M,)`` or one for all [m].
            pairs: Spheres that must not meet, ``(pairs, 2)`` indices. Default: every two of parts that are no neighbors
                in base, upper arm, forearm and hand. ``()`` for none.

        Raises:
            ValueError: Wrong shapes; a link that is no whole number from 0 to 7; an index that is no sphere's.
        """
        moved_by = np.asarray(link)
        if moved_by.ndim != 1 or not len(moved_by) or not np.issubdtype(moved_by.dtype, np.integer):
            raise ValueError(f"Body.link needs one whole number per sphere, (M,); got {moved_by.dtype}{moved_by.shape}")
        if moved_by.min() < 0 or moved_by.max() > 7:
            raise ValueError(f"Body.link counts joints, 0 to 7; got {moved_by.min()} to {moved_by.max()}")
        count = len(moved_by)
        named = as_array("Body.centers of shape (M, 3)", centers), as_array("Body.radii of shape (M,)", radii)
        points, sizes = as_floats(*named)
        if points.shape != (count, 3) or sizes.shape not in ((), (count,)):
            raise ValueError(
                f"Body of {count} links needs centers ({count}, 3) and radii ({count},); got {points.shape} and "
                f"{sizes.shape}"
            )
        if at_hand(points, sizes) and not all(np.isfinite(np.asarray(x)).all() for x in (points, sizes)):
            raise ValueError("Body has a number that is not finite; pad with negative radii")
        self._set(tuple(int(x) for x in moved_by), points, jnp.broadcast_to(sizes, (count,)), ())
        chosen = _apart(self.parts) if pairs is None else _checked_pairs(np.asarray(pairs), count)
        object.__setattr__(self, "pairs", chosen)

    def _set(self, *fields: Any) -> "Body":
        for name, value in zip(("link", "centers", "radii", "pairs"), fields, strict=True):
            object.__setattr__(self, name, value)
        return self

    def tree_flatten(self) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        """Return the arrays, and links and pairs beside them."""
        return (self.centers, self.radii), (self.link, self.pairs)

    @classmethod
    def tree_unflatten(cls, structure: tuple[Any, ...], leaves: tuple[Any, ...]) -> "Body":
        """Return a body of anything in the place of its arrays.

        Args:
            structure: Links and pairs.
            leaves: Centers and radii.
        """
        return object.__new__(cls)._set(structure[0], *leaves, structure[1])

    @classmethod
    def from_urdf(
        cls,
        file: str | os.PathLike[str],
        base_link: str,
        tip_link: str,
        *,
        overhang: float = 0.02,
        skip_meshes: bool = False,
    ) -> "Body":
        """Return spheres over the collision shapes of a URDF file between two links, and of what these carry.

        Spheres stay as they are, as in files that foam or other programs have filled with spheres. Boxes, cylinders and
        capsules are covered by spheres, and meshes are by their convex hulls; how far spheres reach beyond is noted by
        :func:`jaxik.with_body`. Few spheres are fast: begin with an overhang of some centimeters.

        Args:
            file: File name.
            base_link: Link whose frame is the arm's base frame, as for :func:`jaxik.load_urdf`.
            tip_link: Link whose frame is the tool.
            overhang: Largest distance that a sphere may reach beyond a shape [m]; beyond the ends of cylinders it may
                be larger.
            skip_meshes: True to leave meshes out. Their files are found relative to the URDF file, ``package://``
                included.

        Raises:
            FileFormatError: The file has no collision shapes there, or a mesh that cannot be read.
            MissingExtraError: A mesh, and trimesh is not installed.
            ArmClassError: There is no chain of turning joints between the links.
            ValueError: A link is unknown.
        """
        from jaxik.obstacles.body_files import body_of_urdf  # which imports this file

        return body_of_urdf(file, base_link, tip_link, overhang, skip_meshes)

    @classmethod
    def from_yaml(
        cls, file: str | os.PathLike[str], urdf: str | os.PathLike[str], base_link: str, tip_link: str
    ) -> "Body":
        """Return the spheres of a YAML file as cuRobo writes them: ``collision_spheres: {link: [{center, radius}]}``.

        Centers are in the frames of the links, which the URDF file places. Where the file has ``self_collision_ignore``
        too, all pairs of spheres of other links must not meet; else the default pairs of :class:`Body`.

        Args:
            file: File name.
            urdf: URDF file of the robot.
            base_link: Link whose frame is the arm's base frame.
            tip_link: Link whose frame is the tool.

        Raises:
            FileFormatError: The file has no such spheres, or none of a link of the arm.
            MissingExtraError: PyYAML is not installed.
        """
        from jaxik.obstacles.body_files import body_of_yaml

        return body_of_yaml(file, urdf, base_link, tip_link)

    @classmethod
    def preset(cls, name: str) -> "Body":
        """Return the body of a preset arm: Franka's self-collision capsules, or estimates from drawings and pictures.

        Args:
            name: Name of the model: ``"iiwa14"``, ``"franka_panda"``, ``"franka_fr3"``, ``"meccanoid_left"`` or
                ``"meccanoid_right"``; those of the Meccanoid hold torso and head, and the other arm hanging down.

        Raises:
            ValueError: There is none of that name.

        Example:
            >>> import jaxik
            >>> model = jaxik.with_body(jaxik.presets.meccanoid("left"), jaxik.Body.preset("meccanoid_left"))
        """
        from jaxik.obstacles.preset_bodies import preset_body

        return preset_body(name)

    def noted(self, notes: tuple[str, ...]) -> "Body":
        """Return the body with notes for the model that gets it; they are no part of the tree.

        Args:
            notes: One sentence each.
        """
        object.__setattr__(self, "_notes", notes)
        return self

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on where the spheres come from, one sentence each."""
        return getattr(self, "_notes", ())

    @property
    def parts(self) -> np.ndarray:
        """Part of each sphere: 0 base, 1 upper arm, 2 forearm, 3 hand, ``(M,)``."""
        return _PARTS[list(self.link)]

    def with_spheres(self, link: Sequence[int], centers: Array, radii: Array) -> "Body":
        """Return the body with other spheres and the same pairs.

        Args:
            link: Number of joints that move each sphere, ``(M,)``.
            centers: Centers, ``(M, 3)`` [m].
            radii: Radii, ``(M,)`` [m].
        """
        return object.__new__(Body)._set(tuple(link), centers, radii, self.pairs)

    def grown(self, margin: ArrayLike) -> "Body":
        """Return the body with every sphere larger, padding left as it is.

        Args:
            margin: Length that is added to the radii [m].
        """
        larger = self.radii + jnp.asarray(margin, self.radii.dtype)
        return self.with_spheres(self.link, self.centers, jnp.where(self.radii < 0.0, self.radii, larger))

    def name(self, sphere: int) -> str:
        """Return the name of a sphere, such as "sphere 3 (forearm)".

        Args:
            sphere: Its index.
        """
        return f"sphere {sphere} ({PART_NAMES[self.parts[sphere]]})"


def _apart(parts: np.ndarray) -> tuple[tuple[int, int], ...]:
    """Pairs of spheres of parts that are no neighbors."""
    return tuple((i, j) for i, j in combinations(range(len(parts)), 2) if abs(parts[i] - parts[j]) > 1)


def _checked_pairs(pairs: np.ndarray, count: int) -> tuple[tuple[int, int], ...]:
    if not pairs.size:
        return ()
    if pairs.ndim != 2 or pairs.shape[1] != 2 or not np.issubdtype(pairs.dtype, np.integer):
        raise ValueError(f"Body.pairs needs integers (pairs, 2); got {pairs.dtype}{pairs.shape}")
    if pairs.min() < 0 or pairs.max() >= count or (pairs[:, 0] == pairs[:, 1]).any():
        raise ValueError(f"Body.pairs needs two different spheres of 0 to {count - 1} each; got {pairs.tolist()!r:.80}")
    return tuple(dict.fromkeys((int(min(pair)), int(max(pair))) for pair in pairs))
