"""The self-motion in a branch: joint angles, their derivatives and the room to limits at any swivel.

This is the one place where a swivel becomes joint angles without a new solve.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxik.arm import Arm, resting_angle
from jaxik.numerics import arctan2, clipped_sqrt, fused_separately, principal, sincos
from jaxik.obstacles import FreeSwivels
from jaxik.redundancy.sinusoid import values


class Rates(NamedTuple):
    """Joint angles and their derivatives in the swivel.

    Attributes:
        q: Joint angles, ``(joint, *rows)`` [rad].
        first: First derivatives, ``(joint, *rows)``.
        second: Second derivatives, ``(joint, *rows)`` [1/rad].
    """

    q: Array
    first: Array
    second: Array


class BranchMotion(NamedTuple):
    """The self-motion of targets in one branch each.

    Attributes:
        arm: The arm.
        sides: (a, b, c) of opposite and adjacent side of the angles that turn with the swivel,
            ``(2, angle, 3, *rows)``; for a middle angle its cosine in both places.
        elbow: Joint 4, ``(*rows,)`` [rad].
        keep_out: Distance of the elbow to each half-space, ``(half_spaces, 3, *rows)`` [m].
        shoulder_sign: +1 or -1, the solution of the shoulder, ``(*rows,)``.
        wrist_sign: +1 or -1, the solution of the wrist, ``(*rows,)``.
        shoulder_delta: Middle angle of the shoulder less joint 2, ``()`` [rad].
        wrist_delta: Middle angle of the wrist less joint 6, ``()`` [rad].
        free: Free swivels of the body, ``(arc, *rows)``; None without a body.
    """

    arm: Arm
    sides: Array
    elbow: Array
    keep_out: Array
    shoulder_sign: Array
    wrist_sign: Array
    shoulder_delta: Array
    wrist_delta: Array
    free: FreeSwivels | None = None

    def angles(self, swivel: Array) -> Array:
        """Joint angles at swivels ``(*more, *rows)``: ``(joint, *more, *rows)`` [rad].

        Each is in the turn nearest to the middle of its joint's range.

        **Differentiability**: smooth in swivel, coefficients and arm away from singular postures.
        """
        return _angles(self, _sincos(swivel))

    def slopes(self, swivel: Array) -> tuple[Array, Array]:
        """Joint angles and their first derivatives in the swivel, ``(joint, *more, *rows)`` each."""
        trig = _sincos(swivel)
        return _angles(self, trig), _first_derivatives(self, *trig)

    def rates(self, swivel: Array) -> Rates:
        """Joint angles with their first and second derivatives in the swivel."""
        trig = _sincos(swivel)
        return Rates(_angles(self, trig), *_both_derivatives(self, *trig))

    def keep_out_distance(self, swivel: Array) -> Array:
        """Distance of the elbow to each half-space, ``(half_spaces, *more, *rows)`` [m]; negative is forbidden."""
        return values(self.keep_out, *_sincos(swivel))

    def room(self, q: Array, swivel: Array) -> Array:
        """Distance to every lower limit, every upper limit [rad] and every half-space [m], negative outside.

        With a body also the distances to the nearest start and end of a free arc [rad].
        """
        lower, upper = _per_joint(self.arm.lower, q), _per_joint(self.arm.upper, q)
        rows = [q - lower, upper - q, self.keep_out_distance(swivel)]
        if self.free is not None:
            rows += [_nearest(swivel, self.free.start), -_nearest(swivel, self.free.end)]
        return jnp.concatenate(rows)

    def excess(self, q: Array, swivel: Array) -> Array:
        """Sum of the violations of limits [rad], keep-out [arm lengths] and free arcs [rad], ``(*more, *rows)``."""
        lower, upper = _per_joint(self.arm.lower, q), _per_joint(self.arm.upper, q)
        over = jnp.sum(jnp.maximum(jnp.maximum(lower - q, q - upper), 0.0), axis=0)
        if self.free is not None:
            over = over + self.free.missed(swivel)
        return over + jnp.sum(jnp.maximum(-self.keep_out_distance(swivel), 0.0), axis=0) / self.arm.length


def _nearest(swivel: Array, ends: Array) -> Array:
    """Distance past the nearest end ``(arc, *rows)`` of an arc, ``(1, *rows)`` [rad]; the seam is no end."""
    past = jnp.where(jnp.abs(ends) == jnp.asarray(jnp.pi, ends.dtype), jnp.inf, principal(swivel - ends))
    return jnp.take_along_axis(past, jnp.argmin(jnp.abs(past), axis=0)[None], 0)


def near_range(arm: Arm, q: Array) -> Array:
    """Joint angles ``(joint, ...)`` in the turn nearest to the middle of their ranges [rad]."""
    center = _per_joint((arm.lower + arm.upper) / 2, q)
    return center + principal(q - center)


# From here on the angles that turn with the swivel are rows of one array, each written as the direction of a plane
# vector: a formula per row would be a program of its own to compile.


@fused_separately
def _sincos(swivel: Array) -> tuple[Array, Array]:
    return sincos(principal(swivel))


def _angles(m: BranchMotion, trig: tuple[Array, Array]) -> Array:
    return _joints(m, _arctan2(*_directions(m, *trig)))


def side_values(m: BranchMotion, sin: Array, cos: Array) -> tuple[Array, Array, Array]:
    """Sides a + b cos + c sin with their first and second derivatives, ``(2, angle, *more, *rows)`` each."""
    lift = (1,) * (sin.ndim + 3 - m.sides.ndim)
    head, rows = m.sides.shape[:2], m.sides.shape[3:]
    a, b, c = (m.sides[:, :, i].reshape(*head, *lift, *rows) for i in range(3))
    value = a + b * cos + c * sin
    return value, c * cos - b * sin, a - value


def _middle_and_sign(m: BranchMotion, like: Array) -> tuple[Array, Array]:
    """Mask of the middle angles among rows ``(angle, ...)``, and the sign of the solution of each row's joint."""
    row = jnp.arange(like.shape[0]).reshape(-1, *(1,) * (like.ndim - 1))
    return row % 3 == 1, jnp.where(row < 3, m.shoulder_sign, m.wrist_sign)


@fused_separately
def _directions(m: BranchMotion, sin: Array, cos: Array) -> tuple[Array, Array]:
    """Opposite and adjacent sides of the angles in the branches' solutions, ``(angle, ...)``."""
    y, x = side_values(m, sin, cos)[0]
    middle, sign = _middle_and_sign(m, y)
    return sign * jnp.where(middle, clipped_sqrt(1.0 - y * y), y), jnp.where(middle, x, sign * x)


@fused_separately
def _arctan2(opposite: Array, adjacent: Array) -> Array:
    return arctan2(opposite, adjacent)


@fused_separately
def _joints(m: BranchMotion, angles: Array) -> Array:
    """Joint angles from the angles of shoulder and wrist."""
    rows = [*angles[:3], jnp.broadcast_to(m.elbow, angles.shape[1:]), *angles[3:]]
    rows[1], rows[5] = rows[1] - m.shoulder_delta, rows[5] - m.wrist_delta
    if len(rows) < m.arm.n_joints:  # a pointing target leaves the last of seven joints at rest
        rows.append(jnp.broadcast_to(resting_angle(m.arm), rows[0].shape))
    return near_range(m.arm, jnp.stack(rows))


@fused_separately
def _first_derivatives(m: BranchMotion, sin: Array, cos: Array) -> Array:
    """First derivatives of the joint angles in the swivel, ``(joint, ...)``."""
    return by_joint(m, _first(m, sin, cos)[0])


@fused_separately
def _both_derivatives(m: BranchMotion, sin: Array, cos: Array) -> tuple[Array, Array]:
    """First and second derivatives of the joint angles in the swivel, ``(joint, ...)``."""
    first, inverse, middle, (y, x), (dy, dx), (ddy, ddx) = _first(m, sin, cos)
    turned = jnp.where(middle, ddy + y * first * first, x * ddy - y * ddx - 2.0 * first * (x * dx + y * dy))
    return by_joint(m, first), by_joint(m, turned * inverse)


def _first(m: BranchMotion, sin: Array, cos: Array) -> tuple[Array, ...]:
    """First derivatives ``(angle, ...)`` and what second ones need of them.

    The direction φ of (x, y) has φ' = (x y' - y x') / ρ², a middle angle θ with cosine z and sine s has θ' = -z' / s.
    Where ρ or s vanish, at a singular posture, both are 0.
    """
    value, slope, bend = side_values(m, sin, cos)
    (y, x), (dy, dx) = value, slope
    middle, sign = _middle_and_sign(m, y)
    square = jnp.where(middle, 1.0 - y * y, x * x + y * y)
    least = float(jnp.finfo(y.dtype).eps) ** 2
    inverse = jnp.where(square > 0.0, 1.0 / jnp.sqrt(jnp.maximum(square, least)), 0.0)
    inverse = jnp.where(middle, -sign * inverse, inverse * inverse)
    return jnp.where(middle, dy, x * dy - y * dx) * inverse, inverse, middle, value, slope, bend


def by_joint(m: BranchMotion, rows: Array) -> Array:
    """Derivatives of the angles as derivatives of the joints: joint 4 and a resting joint 7 do not move."""
    none = jnp.zeros((1, *rows.shape[1:]), rows.dtype)
    return jnp.concatenate([rows[:3], none, rows[3:], *[none] * (m.arm.n_joints - 1 - len(rows))])


def _per_joint(limit: Array, q: Array) -> Array:
    """Values of the joints ``(joint,)`` beside angles ``(joint, ...)``."""
    return limit.reshape(-1, *(1,) * (q.ndim - 1))
