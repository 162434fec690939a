"""Shape and dtype checks at the public entries: ValueError with what was got and what was expected."""

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from jaxik.arm import Arm
from jaxik.targets.targets import Pointing, Pose, Target


def as_floats(*values: ArrayLike) -> tuple[Array, ...]:
    """The values as arrays of their common float dtype (integers become the default float)."""
    arrays = [jnp.asarray(v) for v in values]
    for a in arrays:
        if not (jnp.issubdtype(a.dtype, jnp.floating) or jnp.issubdtype(a.dtype, jnp.integer)):
            raise ValueError(f"expected real numbers, got an array of {a.dtype}")
    floats = [a.dtype for a in arrays if jnp.issubdtype(a.dtype, jnp.floating)]
    dtype = max(floats, key=lambda d: jnp.finfo(d).bits) if floats else jnp.result_type(float)
    return tuple(a.astype(dtype) for a in arrays)


def check_joints(arm: Arm, q: Array) -> None:
    """Raises unless the last axis of q is the arm's joints."""
    if q.ndim == 0 or q.shape[-1] != arm.n_joints:
        raise ValueError(f"expected joint angles of shape (*batch, {arm.n_joints}), got {q.shape}")


def check_target(arm: Arm, target: Target, *others: ArrayLike) -> tuple[Target, tuple[Array, ...]]:
    """The target and the other arguments as float arrays of one dtype, shapes checked.

    Raises:
        ValueError: Wrong kind of target for the arm, or a wrong shape; says what was got and expected.
    """
    if isinstance(target, Pose):
        if arm.n_joints == 6:
            raise ValueError(
                "a 6-joint arm cannot choose the tool's roll: expected a jaxik.Pointing target, got a Pose"
            )
        position, rotation, *rest = as_floats(target.position, target.rotation, *others)
        _check_shape("Pose.position", position, (3,))
        _check_shape("Pose.rotation", rotation, (3, 3))
        return Pose(position, rotation), tuple(rest)
    if isinstance(target, Pointing):
        position, direction, *rest = as_floats(target.position, target.direction, *others)
        _check_shape("Pointing.position", position, (3,))
        _check_shape("Pointing.direction", direction, (3,))
        return Pointing(position, direction), tuple(rest)
    raise ValueError(f"expected a jaxik.Pose or jaxik.Pointing target, got {type(target).__name__}")


def batch_shape(target: Target, *others: Array) -> tuple[int, ...]:
    """The batch shape that the target and scalar-per-row arguments broadcast to.

    Raises:
        ValueError: If they do not broadcast.
    """
    shapes = [target.position.shape[:-1], *(a.shape for a in others)]
    shapes.append(target.rotation.shape[:-2] if isinstance(target, Pose) else target.direction.shape[:-1])
    try:
        return jnp.broadcast_shapes(*shapes)
    except ValueError:
        raise ValueError(f"batch shapes do not broadcast: got {', '.join(map(str, shapes))}") from None


def _check_shape(name: str, value: Array, trailing: tuple[int, ...]) -> None:
    if value.shape[value.ndim - len(trailing) :] != trailing:
        expected = ", ".join(map(str, trailing))
        raise ValueError(f"expected {name} of shape (*batch, {expected}), got {value.shape}")
