"""A step of a control loop that stays clear: along the keep-out and obstacles where it would enter them."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxik.arm import Arm
from jaxik.kinematics import joint_positions
from jaxik.numerics import tolerances
from jaxik.obstacles import World, closest_pair

_PUSHES = 8  # out of whatever is met: two or three for one obstacle, more between several
_HALVINGS = 6  # of a step that cannot be pushed out


class ClearStep(NamedTuple):
    """Steps of n rows.

    Attributes:
        q: Joint angles after the step, ``(joint, n)`` [rad].
        changed: True where they are not those that were wanted, ``(n,)``.
        meets: True where body or elbow are inside something all the same, ``(n,)``.
    """

    q: Array
    changed: Array
    meets: Array


def clear_step(arm: Arm, world: World | None, now: Array, wanted: Array, low: Array, high: Array) -> ClearStep:
    """Return steps near to wanted ones that enter neither keep-out nor obstacles.

    Where the wanted posture is inside, it is moved out along the gradient of the distance, within the ranges: the step
    slides along the obstacle. Where that fails, the step is halved, and at last left out. From inside, no step leads
    deeper.

    Args:
        arm: The arm, with a body if there is a world.
        world: The world with its rows last; None for an arm without a body.
        now: Present joint angles, ``(joint, n)`` [rad].
        wanted: Wanted joint angles [rad].
        low: Lower ends of the ranges of the step [rad].
        high: Upper ends [rad].
    """
    if world is None and not arm.keep_out.offset.shape[0]:
        nowhere = jnp.zeros(now.shape[1:], bool)
        return ClearStep(wanted, nowhere, nowhere)
    slack = tolerances(now.dtype).limit * arm.length
    room = lambda q: _room(arm, world, q)  # noqa: E731

    def push(_: Array, q: Array) -> Array:
        distance, pull = jax.vjp(room, q)
        (slope,) = pull(jnp.ones_like(distance))
        square = jnp.sum(slope * slope, axis=0)
        inside = (distance < -slack) & (square > 0.0)
        out = jnp.where(inside, -distance / jnp.where(inside, square, 1.0), 0.0)
        return jnp.clip(q + out * slope, low, high)

    pushed = jax.lax.fori_loop(0, _PUSHES, push, wanted)
    held = room(now)
    least = jnp.minimum(held, -slack)

    def shorten(_: Array, q: Array) -> Array:
        return jnp.where(room(q) >= least, q, 0.5 * (q + now))

    q = jax.lax.fori_loop(0, _HALVINGS, shorten, pushed)
    left = room(q)
    goes = left >= least
    q = jnp.where(goes, q, now)
    return ClearStep(q, jnp.any(q != wanted, axis=0), jnp.where(goes, left, held) < -2.0 * slack)


def _room(arm: Arm, world: World | None, q: Array) -> Array:
    """Distance of the elbow from its keep-out, and of the body from the world and itself, the lesser one, ``(n,)``."""
    distance = jnp.full(q.shape[1:], jnp.inf, q.dtype)
    if arm.keep_out.offset.shape[0]:
        elbow = jnp.moveaxis(joint_positions(arm, q.T)[:, 1], -1, 0)
        distance = jnp.min(arm.keep_out.offset[:, None] - arm.keep_out.normal @ elbow, axis=0)
    return distance if world is None else jnp.minimum(distance, closest_pair(arm, q, world)[0])
