"""Keeps bad rows from harming anything: they are replaced before the arithmetic, and say so in their status."""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxik import columns as col
from jaxik.arm import Arm
from jaxik.columns import Mat3, Vec3
from jaxik.numerics import Tolerances
from jaxik.targets import Pointing, Pose, Target


class Screened(NamedTuple):
    """A target in columns whose every row is finite and proper."""

    position: Vec3
    directions: Mat3 | tuple[Vec3]  # the rotation's columns, or the unit pointing direction alone
    swivel: Array
    invalid: Array
    nonfinite: Array


def screen(arm: Arm, target: Target, swivel: Array, tol: Tolerances) -> Screened:
    """Splits a target into columns, with the arm's zero posture in the place of every unusable part.

    Selecting before the arithmetic also makes the derivative of a replaced row exactly zero and leaves every other row's
    untouched.
    """
    position = col.split_vector(target.position)
    home = col.split_vector(arm.tool_position)
    home_axes = col.split_matrix(arm.tool_rotation)
    if isinstance(target, Pose):
        axes = col.split_matrix(target.rotation)
        flat = [*position, *(x for axis in axes for x in axis), swivel]
        nonfinite = ~_all([jnp.isfinite(x) for x in flat])
        proper = _is_rotation(axes, tol)
        directions = tuple(col.where(proper, a, h) for a, h in zip(axes, home_axes, strict=True))
    else:
        raw = col.split_vector(target.direction)
        nonfinite = ~_all([jnp.isfinite(x) for x in (*position, *raw, swivel)])
        # Scaling by the largest entry first keeps the length of very long or short directions from over- or underflowing.
        largest = jnp.maximum(jnp.maximum(jnp.abs(raw[0]), jnp.abs(raw[1])), jnp.abs(raw[2]))
        proper = (largest >= jnp.finfo(largest.dtype).tiny) & ~nonfinite
        scaled = col.where(proper, col.scale(1.0 / jnp.where(proper, largest, 1.0), raw), home_axes[2])
        directions = (col.scale(1.0 / jnp.sqrt(col.dot(scaled, scaled)), scaled),)
        proper = proper & _points(arm, tol)
    # Beyond this the squared distance would overflow; the row is out of reach all the same.
    largest_coordinate = float(jnp.finfo(swivel.dtype).max) ** 0.25
    clipped = tuple(jnp.clip(x, -largest_coordinate, largest_coordinate) for x in position)
    return Screened(
        position=col.where(nonfinite, home, clipped),  # pyright: ignore[reportArgumentType]
        directions=tuple(col.where(nonfinite, h, d) for h, d in zip(_homes(home_axes, directions), directions, strict=True)),  # pyright: ignore
        swivel=jnp.where(nonfinite, 0.0, swivel),
        invalid=~proper,
        nonfinite=nonfinite,
    )


def _homes(home: Mat3, directions: tuple[Vec3, ...]) -> tuple[Vec3, ...]:
    return home if len(directions) == 3 else home[2:]


def _is_rotation(axes: Mat3, tol: Tolerances) -> Array:
    x, y, z = axes
    off = [col.dot(x, x) - 1.0, col.dot(y, y) - 1.0, col.dot(x, y), *col.sub(col.cross(x, y), z)]
    return _all([jnp.abs(value) <= tol.rotation for value in off])


def _points(arm: Arm, tol: Tolerances) -> Array:
    """Whether the hand lies along the tool's z axis and the last joint, if there is one, only rolls it."""
    hand = col.split_vector(arm.tool_position - arm.wrist)
    z = col.split_vector(arm.tool_rotation[:, 2])
    aside = col.cross(hand, z)
    straight = col.dot(aside, aside) <= (tol.rotation**2) * col.dot(hand, hand)
    if arm.n_joints == 6:
        return straight
    roll = col.cross(col.split_vector(arm.axes[6]), z)
    return straight & (col.dot(roll, roll) <= tol.rotation**2)


def _all(conditions: list[Array]) -> Array:
    result = conditions[0]
    for c in conditions[1:]:
        result = result & c
    return result
