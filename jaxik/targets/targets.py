"""Targets of the tool: a full pose, or a point and a direction."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar, overload, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from jaxik.targets.arrays import as_array, as_floats
from jaxik.targets.rotations import compose, matrix_from_wxyz, rotate, wxyz_from_matrix


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Pose:
    """Position and rotation of the tool in the arm's base frame: six task freedoms.

    As a rigid motion it maps the tool's coordinates to the base frame's. ``a @ b`` is the pose that ``b`` describes
    within frame ``a``. Poses with leading batch axes have a length, are indexed and iterated over, as arrays are.

    Attributes:
        position: Tool point, ``(*batch, 3)`` [m].
        rotation: Rotation matrix whose columns are the tool's axes, ``(*batch, 3, 3)``.

    Example:
        >>> a = Pose.from_quaternion([0.0, 0.0, 1.0], wxyz=[0.0, 0.0, 0.0, 1.0])  # half a turn about z
        >>> (a @ a).position.tolist()
        [0.0, 0.0, 2.0]
        >>> (a @ jnp.array([1.0, 0.0, 0.0])).tolist()
        [-1.0, 0.0, 1.0]
    """

    position: Float[Array, "*batch 3"]
    rotation: Float[Array, "*batch 3 3"]

    @classmethod
    def from_matrix(cls, matrix: Float[ArrayLike, "*batch 4 4"] | Sequence) -> "Pose":
        """Return the pose of homogeneous matrices.

        Args:
            matrix: ``(*batch, 4, 4)``, translations in m; the last row is taken to be (0, 0, 0, 1).

        Raises:
            ValueError: If the last two axes are not 4 by 4.

        **Differentiability**: linear.
        """
        (matrix,) = as_floats(as_array("matrices of shape (*batch, 4, 4)", matrix))
        if matrix.shape[-2:] != (4, 4):
            raise ValueError(f"expected matrices of shape (*batch, 4, 4), got {matrix.shape}")
        return cls(matrix[..., :3, 3], matrix[..., :3, :3])

    @classmethod
    def from_quaternion(
        cls,
        position: Float[ArrayLike, "*#batch 3"] | Sequence,
        *,
        wxyz: Float[ArrayLike, "*#batch 4"] | Sequence | None = None,
        xyzw: Float[ArrayLike, "*#batch 4"] | Sequence | None = None,
    ) -> "Pose":
        """Return the pose at a point with the rotation of a quaternion; give exactly one of the two orders.

        Args:
            position: Tool point, ``(*batch, 3)`` [m].
            wxyz: Quaternion with the scalar first (MuJoCo, jaxlie, Eigen's constructor), ``(*batch, 4)``, of any length
                but zero.
            xyzw: Quaternion with the scalar last (ROS, SciPy), likewise.

        Raises:
            ValueError: If a shape is wrong, or neither or both quaternions are given.

        **Differentiability**: smooth in both, in the quaternion away from length zero, where it is zero.

        Example:
            >>> Pose.from_quaternion([0.0, 0.0, 1.0], xyzw=[0.0, 0.0, 0.0, 2.0]).rotation.tolist()
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
        """
        if (wxyz is None) == (xyzw is None):
            raise ValueError("expected exactly one quaternion: wxyz=... (scalar first) or xyzw=... (scalar last)")
        given = wxyz if xyzw is None else xyzw
        position, quaternion = as_floats(
            as_array("positions of shape (*batch, 3)", position), as_array("quaternions of shape (*batch, 4)", given)
        )
        for name, value, size in (("position", position, 3), ("wxyz" if xyzw is None else "xyzw", quaternion, 4)):
            if value.shape[-1:] != (size,):
                raise ValueError(f"expected {name} of shape (*batch, {size}), got {value.shape}")
        return cls(position, matrix_from_wxyz(quaternion if xyzw is None else jnp.roll(quaternion, 1, axis=-1)))

    def matrix(self) -> Float[Array, "*batch 4 4"]:
        """Return homogeneous matrices, ``(*batch, 4, 4)``; ``jaxlie.SE3.from_matrix`` takes them.

        **Differentiability**: linear.
        """
        position, rotation = self._full()
        upper = jnp.concatenate([rotation, position[..., None]], -1)
        last = jnp.broadcast_to(jnp.array([0, 0, 0, 1], upper.dtype), (*upper.shape[:-2], 1, 4))
        return jnp.concatenate([upper, last], -2)

    def wxyz(self) -> Float[Array, "*batch 4"]:
        """Return unit quaternions of the rotation, scalar first and not negative, ``(*batch, 4)``.

        Accurate at every angle; a matrix that is no rotation gives the quaternion of the nearest one, to second order
        in its error.

        **Differentiability**: forward and reverse, finite at every rotation. At half turns, where q and -q both have
        scalar 0 and the sign jumps, it is that of the side returned.
        """
        return wxyz_from_matrix(as_floats(self.rotation)[0])

    def pointing(self) -> "Pointing":
        """Return the target that remains when the roll about the tool's z axis is left free.

        **Differentiability**: linear.
        """
        return Pointing(self.position, self.rotation[..., :, 2])

    def inverse(self) -> "Pose":
        """Return the pose of the base frame seen from the tool: ``pose.inverse() @ pose`` is the identity.

        **Differentiability**: smooth.
        """
        position, rotation = self._full()
        back = jnp.swapaxes(rotation, -1, -2)
        return Pose(-rotate(back, position), back)

    @overload
    def __matmul__(self, other: "Pose") -> "Pose": ...
    @overload
    def __matmul__(self, other: "Pointing") -> "Pointing": ...
    @overload
    def __matmul__(self, other: ArrayLike | Sequence) -> Array: ...
    def __matmul__(self, other: "Pose | Pointing | ArrayLike | Sequence") -> "Pose | Pointing | Array":
        """Return a pose, a pointing target or points ``(*batch, 3)`` given in this frame, in the base frame."""
        if isinstance(other, Pose):
            position, rotation, inner, turn = as_floats(self.position, self.rotation, other.position, other.rotation)
            return Pose(position + rotate(rotation, inner), compose(rotation, turn))
        if isinstance(other, Pointing):
            position, rotation, inner, turn = as_floats(self.position, self.rotation, other.position, other.direction)
            return Pointing(position + rotate(rotation, inner), rotate(rotation, turn))
        position, rotation, points = as_floats(
            self.position, self.rotation, as_array("a Pose, a Pointing or points of shape (*batch, 3)", other)
        )
        if points.shape[-1:] != (3,):
            raise ValueError(f"expected points of shape (*batch, 3), got {points.shape}")
        return position + rotate(rotation, points)

    def __len__(self) -> int:
        """Length of the first batch axis."""
        return _length(self)

    def __getitem__(self, index: Any) -> "Pose":
        """Index over the batch axes, as an array of that shape."""
        return _indexed(self, index)

    def __iter__(self) -> Iterator["Pose"]:
        """Iterate over the first batch axis."""
        return (self[i] for i in range(len(self)))

    def _full(self) -> tuple[Array, Array]:
        """Position and rotation of one dtype and the same batch axes."""
        position, rotation = as_floats(self.position, self.rotation)
        batch = jnp.broadcast_shapes(position.shape[:-1], rotation.shape[:-2])
        return jnp.broadcast_to(position, (*batch, 3)), jnp.broadcast_to(rotation, (*batch, 3, 3))


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Pointing:
    """Tool point and the direction the hand points in, roll about it left free: five task freedoms.

    With leading batch axes it has a length, is indexed and iterated over, as an array is.

    Attributes:
        position: Tool point, ``(*batch, 3)`` [m].
        direction: Direction of the tool's z axis, ``(*batch, 3)``; any length but zero.
    """

    position: Float[Array, "*batch 3"]
    direction: Float[Array, "*batch 3"]

    def __len__(self) -> int:
        """Length of the first batch axis."""
        return _length(self)

    def __getitem__(self, index: Any) -> "Pointing":
        """Index over the batch axes, as an array of that shape."""
        return _indexed(self, index)

    def __iter__(self) -> Iterator["Pointing"]:
        """Iterate over the first batch axis."""
        return (self[i] for i in range(len(self)))

    def _full(self) -> tuple[Array, Array]:
        """Position and direction of one dtype and the same batch axes."""
        position, direction = jnp.broadcast_arrays(*as_floats(self.position, self.direction))
        return position, direction


@runtime_checkable
class RigidTransform(Protocol):
    """Poses of other libraries, such as jaxlie's ``SE3``."""

    def as_matrix(self) -> Any:
        """Return homogeneous matrices, ``(*batch, 4, 4)``."""
        ...


Target = Pose | Pointing
TargetLike = Pose | Pointing | ArrayLike | RigidTransform
"""Types that public functions take for a target: matrices ``(*batch, 4, 4)`` and jaxlie's ``SE3`` stand for a pose."""

_T = TypeVar("_T", Pose, Pointing)


def _length(target: Target) -> int:
    position, _ = target._full()
    if position.ndim == 1:
        raise TypeError(f"a single {type(target).__name__} has no length; it has no batch axes")
    return position.shape[0]


def _indexed(target: _T, index: Any) -> _T:
    """Index the batch axes alone: the others are mapped over, so that every kind of index means what it always does."""
    parts = target._full()
    batch = parts[0].shape[:-1]
    if not batch:
        raise TypeError(f"a single {type(target).__name__} cannot be indexed; it has no batch axes")
    if isinstance(index, int | np.integer) and not -batch[0] <= index < batch[0]:  # JAX would take the nearest
        raise IndexError(f"index {index} is out of range for {batch[0]} targets")

    def take(x: Array) -> Array:
        core = x.shape[len(batch) :]
        flat = x.reshape(*batch, -1)
        picked = jax.vmap(lambda column: column[index], in_axes=-1, out_axes=-1)(flat)
        return picked.reshape(*picked.shape[:-1], *core)

    return type(target)(*map(take, parts))
