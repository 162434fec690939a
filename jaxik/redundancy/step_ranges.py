"""Ranges of the joints after a step: within limits, speeds and accelerations, in time to stop at a limit.

With accelerations the velocity toward a limit is at most the one from which a stop before it takes whole steps: from
x = v / (a dt) on, steps of x, x - 1, x - 2, ... times a dt². Such a velocity always leaves another, so that neither the
limit nor the acceleration is ever exceeded while ``dt`` stays the same.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxik.arm import Arm

# Time in which a joint near its limit could still reach it [s]: from there on other joints are to do its share.
_EARLY = 0.1
_SPARE = 0.99  # part of the acceleration that braking is planned with: the rest is for rounding
_MOST = 1e12  # steps of braking², no more


class Moving(NamedTuple):
    """Present velocities and largest accelerations of n rows.

    Attributes:
        velocity: Joint velocities, ``(joint, n)`` [rad/s].
        goal: Goals of the last step, ``(joint, n)`` [rad].
        acceleration: Largest accelerations, ``(joint,)`` [rad/s²].
    """

    velocity: Array
    goal: Array
    acceleration: Array


class StepRanges(NamedTuple):
    """Ranges of the joints after a step, and the largest step.

    Attributes:
        low: Lower ends, ``(joint, n)`` [rad].
        high: Upper ends, likewise.
        early: Both ends of narrower ranges, in which joints slow down before their limits, ``(2, joint, n)`` [rad].
        room: Largest step by speed, ``(joint, 1)`` [rad].
    """

    low: Array
    high: Array
    early: Array
    room: Array


def step_ranges(arm: Arm, now: Array, dt: Array, moving: Moving | None) -> StepRanges:
    """Return the ranges of a step of ``dt`` seconds from joint angles ``(joint, n)`` [rad].

    From outside the limits the way leads inside, as fast as it may. Limits and speeds come first where the present
    velocity leaves no step that keeps the accelerations too.
    """
    room = jnp.maximum(arm.velocity_limit * dt, 0.0)[:, None]
    below, above = now - arm.lower[:, None], arm.upper[:, None] - now
    share = jnp.minimum(dt / _EARLY, 1.0)
    early = [jnp.clip(share * below, 0.0, room), jnp.clip(share * above, 0.0, room)]
    if moving is not None:
        unit = _unit(moving, dt)
        below, above = braking_step(below, unit), braking_step(above, unit)
    down, up = -jnp.clip(below, -room, room), jnp.clip(above, -room, room)
    if moving is not None:
        drift, change = moving.velocity * dt, _unit(moving, dt, 1.0)
        down, up = jnp.clip(drift - change, down, up), jnp.clip(drift + change, down, up)
    # By rounding, and where the present velocity leaves no way to stop.
    low, high = (jnp.clip(now + x, arm.lower[:, None], arm.upper[:, None]) for x in (down, up))
    low, high = (jnp.clip(x, now - room, now + room) for x in (low, high))
    slow = jnp.stack([jnp.clip(now - early[0], low, high), jnp.clip(now + early[1], low, high)])
    return StepRanges(low, high, slow, room)


def toward(goal: Array, now: Array, ranges: StepRanges, dt: Array, moving: Moving | None) -> Array:
    """Return joint angles on the straight way to a goal, as far as the slowest joint may be.

    With accelerations no joint is faster than it can come to rest at the goal, which goes on as it moved since the last
    step: one that is followed at a distance would never be met. Where the velocity differs from the way's, the way
    bends.
    """
    way, drift, reach = goal - now, 0.0, ranges.room
    if moving is not None:
        drift = goal - moving.goal
        drift = jnp.where(jnp.all(jnp.abs(drift) <= ranges.room, axis=0), drift, 0.0)  # a goal that jumps has none
        way = way - drift
        reach = jnp.minimum(reach, braking_step(jnp.abs(way), _unit(moving, dt)))
    length = jnp.abs(way)
    share = jnp.min(jnp.where(length > reach, reach / jnp.maximum(length, reach), 1.0), axis=0)
    return jnp.clip(now + drift + share * way, ranges.low, ranges.high)


def braking_step(distance: Array, unit: Array) -> Array:
    """Return the largest step after which steps that shrink by ``unit`` each end within a distance; both [rad].

    Steps x, x - 1, ..., x - n in units, with n = floor(x), sum to (n + 1) (x - n / 2).
    """
    ratio = jnp.clip(distance / unit, 0.0, _MOST)
    more = jnp.floor(0.5 * (jnp.sqrt(1.0 + 8.0 * ratio) - 1.0))
    step = unit * (ratio / (more + 1.0) + 0.5 * more)
    return jnp.where((distance > 0.0) & jnp.isfinite(unit), step, distance)


def _unit(moving: Moving, dt: Array, spare: float = _SPARE) -> Array:
    """Change of a step by acceleration, ``(joint, 1)`` [rad]."""
    change = spare * moving.acceleration * dt * dt
    return jnp.maximum(change, jnp.finfo(change.dtype).tiny)[:, None]
