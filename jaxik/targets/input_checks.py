"""Checks of what callers pass in, at the public entries: ValueError with what was got and what was expected."""

from typing import Any

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from jaxik.arm import Arm
from jaxik.targets.arrays import as_array, as_floats, is_array
from jaxik.targets.targets import Pointing, Pose, Target

_KINDS = "a jaxik.Pose, a jaxik.Pointing, matrices of shape (*batch, 4, 4) or an object with as_matrix()"


def as_target(target: Any) -> Target:
    """Return a target from an argument: a pose, a pointing target, homogeneous matrices or jaxlie's ``SE3``.

    Args:
        target: A :class:`Pose` or :class:`Pointing`, whose fields may be lists of numbers; matrices ``(*batch, 4, 4)``;
            or anything with ``as_matrix()`` that returns such matrices.

    Raises:
        ValueError: If it is anything else; says what was got and expected. Values are not checked.
    """
    if isinstance(target, Pose | Pointing):
        turn = target.rotation if isinstance(target, Pose) else target.direction
        return target if is_array(target.position) and is_array(turn) else _with_arrays(target)
    if hasattr(target, "as_matrix"):
        matrix = as_array(f"{type(target).__name__}.as_matrix() to give matrices", target.as_matrix())
        if jnp.shape(matrix)[-2:] != (4, 4):
            raise ValueError(
                f"expected {type(target).__name__}.as_matrix() to give shape (*batch, 4, 4), got {jnp.shape(matrix)}"
            )
        return Pose.from_matrix(matrix)
    if isinstance(getattr(target, "target", None), Pose | Pointing):
        raise ValueError(f"expected {_KINDS}, got a {type(target).__name__}: pass its .target")
    if not hasattr(target, "dtype") and not isinstance(target, list | tuple):
        raise ValueError(f"expected {_KINDS}, got {type(target).__name__}")
    matrix = as_array(_KINDS, target)
    if jnp.shape(matrix)[-2:] != (4, 4):
        raise ValueError(f"expected {_KINDS}, got an array of shape {jnp.shape(matrix)}")
    return Pose.from_matrix(matrix)


def check_joints(arm: Arm, q: Array) -> None:
    """Raise unless the last axis of ``q`` is the arm's joints."""
    if q.ndim == 0 or q.shape[-1] != arm.n_joints:
        raise ValueError(f"expected joint angles of shape (*batch, {arm.n_joints}), got {q.shape}")


def check_target(arm: Arm, target: Target, *others: ArrayLike) -> tuple[Target, tuple[Array, ...]]:
    """Return the target and the other arguments as float arrays of one dtype, shapes checked.

    Raises:
        ValueError: Wrong kind of target for the arm, or a wrong shape; says what was got and expected.
    """
    if isinstance(target, Pose):
        if arm.n_joints == 6:
            raise ValueError(
                "a 6-joint arm cannot choose the tool's roll: expected a jaxik.Pointing target, got a Pose; "
                "take pose.pointing()"
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
    raise ValueError(f"expected {_KINDS}, got {type(target).__name__}")


def batch_shape(target: Target, *others: Array) -> tuple[int, ...]:
    """Return the batch shape that the target and scalar-per-row arguments broadcast to.

    Raises:
        ValueError: If they do not broadcast.
    """
    shapes = [target.position.shape[:-1], *(a.shape for a in others)]
    shapes.append(target.rotation.shape[:-2] if isinstance(target, Pose) else target.direction.shape[:-1])
    try:
        return jnp.broadcast_shapes(*shapes)
    except ValueError:
        raise ValueError(f"batch shapes do not broadcast: got {', '.join(map(str, shapes))}") from None


def _with_arrays(target: Target) -> Target:
    """Return the target with lists of numbers as arrays."""
    kind = type(target).__name__
    fields = {name: as_array(f"numbers for {kind}.{name}", value) for name, value in vars(target).items()}
    return type(target)(**fields)


def _check_shape(name: str, value: Array, trailing: tuple[int, ...]) -> None:
    if value.shape[value.ndim - len(trailing) :] != trailing:
        expected = ", ".join(map(str, trailing))
        raise ValueError(f"expected {name} of shape (*batch, {expected}), got {value.shape}")
