"""The path's chart: every waypoint's joint angles as functions of its swivel and branch alone.

Everything that does not depend on the swivel is worked out once per path. What remains for a posture is a few sines and
polynomials, so that searching, polishing and bounding cost a small part of as many calls of ``solve_ik``.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxik.arm import Arm
from jaxik.ik import target_columns
from jaxik.limits import fit_to_limits
from jaxik.numerics import sincos, wrap
from jaxik.staging import stage
from jaxik.swivel_functions import swivel_functions, triple_angles
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
    shape = jnp.broadcast_shapes(swivel.shape, branch.shape)
    sin, cos = sincos(wrap(swivel - 2 * jnp.pi * jnp.round(swivel / (2 * jnp.pi))))
    s, e, w = ((branch >> bit & 1) == 1 for bit in (2, 1, 0))
    lift = (slice(None),) * 2 + (None,) * (len(shape) - 1)

    def pick(entries: Array) -> Array:
        return jnp.where(e, entries[:, :, 1][lift], entries[:, :, 0][lift])

    one = jnp.ones((), swivel.dtype)
    shoulder = triple_angles(pick(chart.shoulder), jnp.where(s, -one, one), chart.shoulder_delta, sin, cos)
    wrist = triple_angles(pick(chart.wrist), jnp.where(w, -one, one), chart.wrist_delta, sin, cos)
    elbow = jnp.where(e, chart.elbow[1], chart.elbow[0])
    rows = [jnp.broadcast_to(a, shape) for a in (*shoulder, elbow, *wrist)]
    if len(rows) < arm.n_joints:  # a pointing target leaves the last of seven joints at rest
        rows.append(jnp.clip(jnp.zeros(shape, swivel.dtype), arm.lower[6], arm.upper[6]))
    q = jnp.stack(rows)
    return fit_to_limits(arm, tuple(range(arm.n_joints)), q.reshape(arm.n_joints, -1))[0].reshape(q.shape)


class Rates(NamedTuple):
    """Joint angles and their first and second derivative in the swivel, ``(joint, ..., K)`` each."""

    q: Array
    first: Array
    second: Array


@stage
def rates(arm: Arm, chart: Chart, swivel: Array, branch: Array) -> Rates:
    """Joint angles and their derivatives at swivels and branches ``(..., K)`` that broadcast."""
    swivel = jnp.broadcast_to(swivel, jnp.broadcast_shapes(swivel.shape, branch.shape))
    one = jnp.ones_like(swivel)

    def slope(s: Array) -> tuple[Array, Array]:
        return jax.jvp(lambda s: postures(arm, chart, s, branch), (s,), (one,))

    (q, first), (_, second) = jax.jvp(slope, (swivel,), (one,))
    return Rates(q, first, second)
