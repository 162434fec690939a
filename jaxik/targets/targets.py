"""Targets of the tool: a full pose, or a point and a direction."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
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
        rotation: Rotation matrix whose columns are the tool's axes, ``(*batch, 3, 3)``. Solvers take a matrix R whose
            entries of RᵀR - I and of x × y - z are at most 2e-6 (3.6e-5 in float32), which six decimals keep, and give
            others the status INVALID_TARGET; :func:`jaxik.nearest_rotation` mends them.

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
        return _pose_of_matrix(as_array("matrices of shape (*batch, 4, 4)", matrix))

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
        name, given = ("wxyz", wxyz) if xyzw is None else ("xyzw", xyzw)
        point, quaternion = as_array("positions of shape (*batch, 3)", position), as_array("quaternions", given)
        for what, value, size in (("position", point, 3), (name, quaternion, 4)):
            if (shape := jnp.shape(value))[-1:] != (size,):
                raise ValueError(f"expected {what} of shape (*batch, {size}), got {shape}")
        return _pose_of_quaternion(point, quaternion, scalar_last=wxyz is None)

    @jax.jit
    def matrix(self) -> Float[Array, "*batch 4 4"]:
        """Return homogeneous matrices, ``(*batch, 4, 4)``; ``jaxlie.SE3.from_matrix`` takes them.

        **Differentiability**: linear.
        """
        position, rotation = self._full()
        upper = jnp.concatenate([rotation, position[..., None]], -1)
        last = jnp.broadcast_to(jnp.array([0, 0, 0, 1], upper.dtype), (*upper.shape[:-2], 1, 4))
        return jnp.concatenate([upper, last], -2)

    @jax.jit
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

    @jax.jit
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
        if isinstance(other, Pose | Pointing):
            return _placed(self, other)
        points = as_array("a Pose, a Pointing or points of shape (*batch, 3)", other)
        if (shape := jnp.shape(points))[-1:] != (3,):
            raise ValueError(f"expected points of shape (*batch, 3), got {shape}")
        return _placed(self, points)

    def __len__(self) -> int:
        """Length of the first batch axis."""
        return _batch(self)[0]

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
        return _batch(self)[0]

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


@jax.jit
def _pose_of_matrix(matrix: ArrayLike) -> Pose:
    (matrix,) = as_floats(matrix)
    if matrix.shape[-2:] != (4, 4):
        raise ValueError(f"expected matrices of shape (*batch, 4, 4), got {matrix.shape}")
    return Pose(matrix[..., :3, 3], matrix[..., :3, :3])


@partial(jax.jit, static_argnames="scalar_last")
def _pose_of_quaternion(position: ArrayLike, quaternion: ArrayLike, *, scalar_last: bool) -> Pose:
    position, quaternion = as_floats(position, quaternion)
    return Pose(position, matrix_from_wxyz(jnp.roll(quaternion, 1, axis=-1) if scalar_last else quaternion))


@jax.jit
def _placed(frame: Pose, inner: Pose | Pointing | ArrayLike) -> Pose | Pointing | Array:
    """Bring what is given in a frame into the frame's own."""
    position, rotation, *parts = as_floats(frame.position, frame.rotation, *jax.tree.leaves(inner))
    point = position + rotate(rotation, parts[0])
    if isinstance(inner, Pose):
        return Pose(point, compose(rotation, parts[1]))
    return Pointing(point, rotate(rotation, parts[1])) if isinstance(inner, Pointing) else point


def _batch(target: Target) -> tuple[int, ...]:
    turn = jnp.shape(target.rotation)[:-2] if isinstance(target, Pose) else jnp.shape(target.direction)[:-1]
    batch = jnp.broadcast_shapes(jnp.shape(target.position)[:-1], turn)
    if not batch:
        raise TypeError(f"a single {type(target).__name__} has no length and no parts: it has no batch axes")
    return batch


def _indexed(target: _T, index: Any) -> _T:
    batch = _batch(target)
    if isinstance(index, int | np.integer) and not -batch[0] <= index < batch[0]:  # JAX would take the nearest
        raise IndexError(f"index {index} is out of range for {batch[0]} targets")
    if isinstance(index, list):
        index = np.asarray(index)
    index = index if isinstance(index, tuple) else (index,)
    # Whole core axes behind the index, so that an ellipsis ends before them.
    return type(target)(*(x[(*index, *[slice(None)] * (x.ndim - len(batch)))] for x in target._full()))
