"""The path's chart: every waypoint's joint angles as functions of its swivel and branch alone.

Everything that does not depend on the swivel is worked out once per path. What remains for a posture is a few sines and
polynomials, so that searching, polishing and bounding cost a small part of as many calls of ``solve_ik``.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxik.arm import Arm, fit_to_limits
from jaxik.ik import target_columns
from jaxik.numerics import arctan2, clipped_sqrt, fused_separately, sincos, wrap
from jaxik.redundancy import swivel_functions
from jaxik.targets import Target


class Chart(NamedTuple):
    """Coefficients of one elbow bit each; the waypoint is the last axis.

    Attributes:
        shoulder: (a, b, c) of the shoulder's entries, ``(5, 3, elbow bit, K)``.
        wrist: The same of the wrist, or ``(3, 3, elbow bit, K)`` without the third angle.
        elbow: Joint 4, ``(elbow bit, K)`` [rad].
        shoulder_delta: What the middle angle is more than its joint, ``(1,)`` [rad].
        wrist_delta: The same of the wrist.
    """

    shoulder: Array
    wrist: Array
    elbow: Array
    shoulder_delta: Array
    wrist_delta: Array

    def at(self, index: Array | np.ndarray) -> "Chart":
        """Some waypoints of the chart."""
        return self._replace(**{name: getattr(self, name)[..., index] for name in ("shoulder", "wrist", "elbow")})


def make_chart(arm: Arm, target: Target) -> Chart:
    """The chart of K targets ``(K, ...)``."""
    dtype = target.position.dtype
    position, directions, _ = target_columns(target, jnp.zeros((), dtype), target.position.shape[:1])
    f = swivel_functions(arm, position, directions)
    return Chart(f.shoulder, f.wrist, f.elbow, f.shoulder_delta, f.wrist_delta)


def postures(arm: Arm, chart: Chart, swivel: Array, branch: Array) -> Array:
    """Joint angles at swivels and branches ``(..., K)`` that broadcast: ``(joint, ..., K)`` [rad].

    Each angle is in (-pi, pi], or in the turn beyond where a limit admits only that.

    **Differentiability**: smooth in swivel, chart and arm away from singular postures.
    """
    return _joints(arm, chart, _arctan2(*_solution(_vectors(chart), *_sincos(swivel), branch)), branch)


class Rates(NamedTuple):
    """Joint angles and their first and second derivative in the swivel, ``(joint, ..., K)`` each."""

    q: Array
    first: Array
    second: Array


def rates(arm: Arm, chart: Chart, swivel: Array, branch: Array) -> Rates:
    """Joint angles and their derivatives at swivels and branches ``(..., K)`` that broadcast."""
    vectors, (sin, cos) = _vectors(chart), _sincos(swivel)
    q = _joints(arm, chart, _arctan2(*_solution(vectors, sin, cos, branch)), branch)
    return Rates(q, *_derivatives(arm, vectors, sin, cos, branch))


# From here on the angles that turn with the swivel are rows of one array, each written as the direction of a plane
# vector: a formula a row would be a program of its own to compile.


def _vectors(chart: Chart) -> Array:
    """Coefficients of the angles' opposite and adjacent sides, ``(2, angle, 3, elbow bit, K)``.

    Of the middle angles only the cosine is known: it stands in both places.
    """
    triples = [(entries, (entries.shape[0] + 1) // 2) for entries in (chart.shoulder, chart.wrist)]
    rows = (np.array([1, 2, 4]), np.array([0, 2, 3]))
    return jnp.stack([jnp.concatenate([entries[row[:count]] for entries, count in triples]) for row in rows])


def _sides(vectors: Array, sin: Array, cos: Array, branch: Array) -> tuple[Array, Array, Array]:
    """Sides a + b cos + c sin with their first and second derivatives, ``(2, angle, ..., K)`` each."""
    lift = (1,) * (max(sin.ndim, branch.ndim) - 1)
    rows = jnp.moveaxis(vectors, 2, 0).reshape(3, 2, vectors.shape[1], 2, *lift, vectors.shape[-1])
    a, b, c = jnp.where((branch >> 1 & 1) == 1, rows[:, :, :, 1], rows[:, :, :, 0])
    value = a + b * cos + c * sin
    return value, c * cos - b * sin, a - value


def _kinds(like: Array, branch: Array) -> tuple[Array, Array]:
    """Which of the rows ``(angle, ..., K)`` are middle angles, and the sign of the branch's solution of each triple."""
    row = jnp.arange(like.shape[0]).reshape(-1, *(1,) * (like.ndim - 1))
    one = jnp.ones((), like.dtype)
    return row % 3 == 1, jnp.where((branch >> jnp.where(row < 3, 2, 0) & 1) == 1, -one, one)


@fused_separately
def _sincos(swivel: Array) -> tuple[Array, Array]:
    return sincos(wrap(swivel - 2 * jnp.pi * jnp.round(swivel / (2 * jnp.pi))))


@fused_separately
def _solution(vectors: Array, sin: Array, cos: Array, branch: Array) -> tuple[Array, Array]:
    """Opposite and adjacent sides of the angles in the branches' solutions, ``(angle, ..., K)``."""
    y, x = _sides(vectors, sin, cos, branch)[0]
    middle, sign = _kinds(y, branch)
    return sign * jnp.where(middle, clipped_sqrt(1.0 - y * y), y), jnp.where(middle, x, sign * x)


@fused_separately
def _arctan2(opposite: Array, adjacent: Array) -> Array:
    return arctan2(opposite, adjacent)


@fused_separately
def _joints(arm: Arm, chart: Chart, angles: Array, branch: Array) -> Array:
    """Joint angles from the angles of the triples."""
    elbow = jnp.where((branch >> 1 & 1) == 1, chart.elbow[1], chart.elbow[0])
    rows = [*angles[:3], jnp.broadcast_to(elbow, angles.shape[1:]), *angles[3:]]
    rows[1], rows[5] = wrap(rows[1] - chart.shoulder_delta), wrap(rows[5] - chart.wrist_delta)
    if len(rows) < arm.n_joints:  # a pointing target leaves the last of seven joints at rest
        rows.append(jnp.clip(jnp.zeros_like(rows[0]), arm.lower[6], arm.upper[6]))
    q = jnp.stack(rows)
    return fit_to_limits(arm, tuple(range(arm.n_joints)), q.reshape(arm.n_joints, -1)).reshape(q.shape)


@fused_separately
def _derivatives(arm: Arm, vectors: Array, sin: Array, cos: Array, branch: Array) -> tuple[Array, Array]:
    """First and second derivative of the joint angles in the swivel, ``(joint, ..., K)``.

    The direction φ of (x, y) has φ' = (x y' - y x') / ρ², a middle angle θ with cosine z and sine s has θ' = -z' / s.
    Where ρ or s vanish, at a singular posture, both are 0.
    """
    (y, x), (dy, dx), (ddy, ddx) = _sides(vectors, sin, cos, branch)
    middle, sign = _kinds(y, branch)
    square = jnp.where(middle, 1.0 - y * y, x * x + y * y)
    least = float(jnp.finfo(y.dtype).eps) ** 2
    inverse = jnp.where(square > 0.0, 1.0 / jnp.sqrt(jnp.maximum(square, least)), 0.0)
    inverse = jnp.where(middle, -sign * inverse, inverse * inverse)
    first = jnp.where(middle, dy, x * dy - y * dx) * inverse
    turned = jnp.where(middle, ddy + y * first * first, x * ddy - y * ddx - 2.0 * first * (x * dx + y * dy))
    still = (1, *first.shape[1:])

    def by_joint(rows: Array) -> Array:
        none = jnp.zeros(still, rows.dtype)
        return jnp.concatenate([rows[:3], none, rows[3:], *[none] * (arm.n_joints - 1 - len(rows))])

    return by_joint(first), by_joint(turned * inverse)
