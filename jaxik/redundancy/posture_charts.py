"""Postures on target near given ones, whatever the arm's class: a coordinate on each self-motion.

The coordinate of a posture is its way along the tangent of the given posture. Unlike a redundancy parameter it is good
at every regular posture, and at those where two branches meet; but only near by: further off, take charts anew.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxik.arm import Arm
from jaxik.kinematics import joint_positions
from jaxik.numerics import with_value
from jaxik.redundancy.branch_motion import Rates
from jaxik.redundancy.tangent import Tangent, correction, tangent, way_within

WIDEST = 0.3
"""Largest coordinate [rad]."""

_TURNED = 0.4  # rad by which the tangent may turn within a chart
_STEPS = 4  # of Newton's method: from 0.06 rad to rounding
_LEAST = 0.3  # of the tangent's motion along the chart's: beyond, the chart ends


class PostureCharts(NamedTuple):
    """Charts of the self-motions of n targets, with the interface of a motion in branches that planning needs.

    Attributes:
        arm: The arm.
        position: Tool points, ``(3, n)`` [m].
        directions: Rotations, ``(3, 3, n)``.
        origin: Postures at zero, on target or beside it, ``(joint, n)`` [rad].
        along: Unit tangents there, ``(joint, n)``.
        widest: Largest coordinate of each chart, ``(n,)`` [rad].
    """

    arm: Arm
    position: Array
    directions: Array
    origin: Array
    along: Array
    widest: Array

    def angles(self, x: Array) -> Array:
        """Joint angles at coordinates ``(..., n)``: ``(joint, ..., n)`` [rad], without derivatives."""
        return self._near(x)[0]

    def slopes(self, x: Array) -> tuple[Array, Array]:
        """Joint angles and their first derivatives in the coordinate, ``(joint, ..., n)`` each.

        **Differentiability**: in coordinates, targets and arm.
        """
        q, held = self._near(x)
        arm, position, directions, _, along, _ = self._lifted(x)
        move = correction(arm, position, directions, q)
        ahead = x - jax.lax.stop_gradient(x) - jnp.sum(along * move, axis=0)
        q = q + move + held.direction * (ahead / _ahead(along, held))
        at = tangent(arm, position, directions, q)
        return q, at.direction / _ahead(along, at)

    def rates(self, x: Array) -> Rates:
        """Joint angles with their first and second derivatives in the coordinate; these are all their derivatives."""
        q, at = self._near(x)
        along = self._lifted(x).along
        ahead = _ahead(along, at)
        bend = at.bend - at.direction * (jnp.sum(along * at.bend, axis=0) / ahead)
        return Rates(q, at.direction / ahead, bend / ahead**2)

    def _near(self, x: Array) -> tuple[Array, Tangent]:
        """Joint angles at coordinates ``(..., n)`` by Newton's method, and the self-motion there, held."""
        x = jax.lax.stop_gradient(x)
        arm, position, directions, origin, along, _ = jax.lax.stop_gradient(self)._lifted(x)

        def step(_: Any, state: tuple[Array, Array, Tangent]) -> tuple[Array, Array, Tangent]:
            q = state[1]
            at = tangent(arm, position, directions, q)
            far = jnp.sqrt(jnp.sum(at.correction**2, axis=0))
            onto = q + at.correction * jnp.minimum(1.0, WIDEST / jnp.maximum(far, WIDEST))
            left = x - jnp.sum(along * (onto - origin), axis=0)
            return q, onto + at.direction * jnp.clip(left / _ahead(along, at), -WIDEST, WIDEST), at

        begin = origin + x * along
        blank = jax.eval_shape(lambda q: tangent(arm, position, directions, q), begin)
        blank = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), blank)
        q, _, at = jax.lax.fori_loop(0, _STEPS + 1, step, (begin, begin, blank))
        return q, at

    def excess(self, q: Array, x: Array) -> Array:
        """Sum of the violations of limits [rad] and keep-out [arm lengths], ``(n,)``."""
        del x
        over = jnp.maximum(jnp.maximum(self.arm.lower[:, None] - q, q - self.arm.upper[:, None]), 0.0)
        over = jnp.sum(jnp.where(self.arm.turning[:, None], 0.0, over), axis=0)
        return over + jnp.sum(jnp.maximum(-_room(self.arm, q), 0.0), axis=0) / self.arm.length

    def _lifted(self, x: Array) -> "PostureCharts":
        """The charts with axes for those of coordinates before the last."""
        lift = (1,) * (x.ndim - 1)
        rows = (v.reshape(*v.shape[:-1], *lift, v.shape[-1]) for v in self[1:])
        return PostureCharts(self.arm, *rows)


def posture_charts(arm: Arm, position: Array, directions: Array, q: Array) -> PostureCharts:
    """Return charts at postures ``(joint, n)`` [rad] for targets ``(3, n)`` and ``(3, 3, n)``."""
    at = jax.lax.stop_gradient(tangent(arm, position, directions, q))
    bend = jnp.sqrt(jnp.sum(at.bend**2, axis=0))
    widest = jnp.minimum(WIDEST, _TURNED / jnp.maximum(bend, _TURNED))
    return PostureCharts(arm, position, directions, jax.lax.stop_gradient(q), at.direction, widest)


def feasible_coordinates(charts: PostureCharts) -> tuple[Array, Array]:
    """Return the ends of the coordinates within limits and keep-out, ``(n,)`` each, without derivatives.

    Found by Newton's method from the origin, to either side. Where there are none the first end is above the second.
    """
    held = jax.lax.stop_gradient(charts)

    def closer(_: Any, ends: Array) -> Array:
        return jnp.clip(ends + _ways(held, ends), -held.widest, held.widest)

    low, high = jax.lax.fori_loop(0, 4, closer, jnp.zeros((2, *charts.widest.shape), charts.widest.dtype))
    return low, high


def moving_ends(charts: PostureCharts, lower: Array, upper: Array) -> tuple[Array, Array]:
    """Return the same ends with their derivatives in targets and arm; none where they meet, or the chart ends."""
    ends = jnp.stack([lower, upper])
    ways = _ways(charts, ends, moving=True)
    free = (jnp.abs(ends) < charts.widest) & (lower < upper)
    low, high = with_value(jnp.where(free, ends + ways, ends), ends)
    return low, high


def _ways(charts: PostureCharts, ends: Array, moving: bool = False) -> Array:
    """The way, to first order, from coordinates ``(2, n)`` to the nearest lower and upper end of what is feasible."""
    hold = jax.lax.stop_gradient
    q, at = charts._near(ends)
    arm, position, directions, _, along, _ = charts._lifted(ends)
    ahead = _ahead(hold(along), at)
    if moving:
        move = correction(arm, position, directions, q)
        q = q + move - at.direction * (jnp.sum(hold(along) * move, axis=0) / ahead)
        at = at._replace(room=_room(charts.arm, q))
    lower, upper, turning = (x[:, None, None] for x in (arm.lower, arm.upper, arm.turning))
    low, high = way_within(
        at.direction / ahead, jnp.where(turning, -jnp.inf, lower - q), jnp.where(turning, jnp.inf, upper - q)
    )
    near, far = way_within(at.room_rate / ahead, -at.room, jnp.full_like(at.room, jnp.inf))
    low, high = jnp.concatenate([low, near]), jnp.concatenate([high, far])
    return jnp.stack([jnp.max(low[:, 0], axis=0), jnp.min(high[:, 1], axis=0)])


def _room(arm: Arm, q: Array) -> Array:
    """Distance of the elbow to each half-space, ``(half_spaces, ..., n)`` [m]."""
    if not len(arm.keep_out.offset):
        return jnp.zeros((0, *q.shape[1:]), q.dtype)
    elbow = joint_positions(arm, jnp.moveaxis(q, 0, -1))[..., arm.station_of_joint[3], :]
    return jnp.moveaxis(arm.keep_out.offset - elbow @ arm.keep_out.normal.T, -1, 0)


def _ahead(along: Array, at: Tangent) -> Array:
    """Rate of the coordinate along the tangent, kept from zero."""
    ahead = jnp.sum(along * at.direction, axis=0)
    return jnp.where(ahead < 0.0, jnp.minimum(ahead, -_LEAST), jnp.maximum(ahead, _LEAST))
