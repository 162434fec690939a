"""Arrays from arguments: one float dtype, lists of numbers taken, anything else refused in plain words."""

from typing import Any

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike


def as_floats(*values: ArrayLike) -> tuple[Array, ...]:
    """Return the values as arrays of their common float dtype (integers become the default float).

    Raises:
        ValueError: If a value holds anything but real numbers, or floats of fewer than 32 bits.
    """
    arrays = [jnp.asarray(as_array("real numbers", v)) for v in values]
    for a in arrays:
        if not (jnp.issubdtype(a.dtype, jnp.floating) or jnp.issubdtype(a.dtype, jnp.integer)):
            raise ValueError(f"expected real numbers, got an array of {a.dtype}")
        if jnp.issubdtype(a.dtype, jnp.floating) and jnp.finfo(a.dtype).bits < 32:
            raise ValueError(
                f"expected float32 or float64, got an array of {a.dtype}, too coarse for joint angles and positions; "
                'convert it, x.astype("float32")'
            )
    floats = [a.dtype for a in arrays if jnp.issubdtype(a.dtype, jnp.floating)]
    dtype = max(floats, key=lambda d: jnp.finfo(d).bits) if floats else jnp.result_type(float)
    return tuple(a.astype(dtype) for a in arrays)


def is_array(value: Any) -> bool:
    """Return True for arrays of numbers or truth values, traced ones included."""
    dtype = getattr(value, "dtype", None)
    return getattr(dtype, "kind", "O") not in "OSUMm"  # objects, texts, times


def as_array(name: str, value: Any) -> Any:
    """Return an array or a number as it is, and nested lists of numbers as an array.

    Use it before compiled code, which takes lists apart and refuses anything else in its own words.

    Args:
        name: Name for the message, such as "joint angles of shape (*batch, 7)".
        value: The argument.

    Raises:
        ValueError: If it is neither an array of numbers, a number nor lists of numbers; says what was got.
    """
    if is_array(value):
        return value
    if hasattr(value, "dtype"):
        raise ValueError(f"expected {name}, got an array of {value.dtype}")
    if isinstance(value, float | int | complex):  # real or not is said where all are checked
        return value
    if isinstance(value, list | tuple):
        try:
            return jnp.asarray(value)
        except (TypeError, ValueError):
            raise ValueError(f"expected {name}, got {value!r:.80}") from None
    raise ValueError(f"expected {name}, got {type(value).__name__}")
