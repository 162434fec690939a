"""Many paths' joint angles as functions of the swivel alone, batch last: what the policy sees, prices and plans with.

The same chart as the planner's (:mod:`jaxik.planning.chart`) with the path as a second trailing axis, so that one pass
of vector code serves all waypoints of all paths: every array ends in ``(K, B)``.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxik.arm import Arm
from jaxik.ik import target_columns
from jaxik.numerics import fused_separately, sincos
from jaxik.redundancy import swivel_functions, triple_angles
from jaxik.targets import Target

_OF_PATHS = ("shoulder", "wrist", "elbow", "keep_out", "solvable")  # what ends in (K, B)


class ElbowCharts(NamedTuple):
    """Coefficients of a + b cos(swivel) + c sin(swivel) for every entry, see :mod:`jaxik.redundancy.swivel_functions`.

    Attributes:
        shoulder: ``(5, 3, elbow bit, K, B)``.
        wrist: ``(5 or 3, 3, elbow bit, K, B)``.
        elbow: Joint 4, ``(elbow bit, K, B)`` [rad].
        keep_out: Room to each half-space, ``(half_spaces, 3, K, B)`` [m].
        solvable: Whether a target is proper and within reach, ``(K, B)``; the rest is finite where it is not.
        shoulder_delta: What the shoulder's middle angle is more than its joint, ``()`` [rad].
        wrist_delta: The same of the wrist.
        center: Middles of the joints' ranges, ``(joint, 1, 1)`` [rad].
    """

    shoulder: Array
    wrist: Array
    elbow: Array
    keep_out: Array
    solvable: Array
    shoulder_delta: Array
    wrist_delta: Array
    center: Array

    def at(self, index: np.ndarray) -> "ElbowCharts":
        """Some waypoints."""
        return self._replace(**{name: getattr(self, name)[..., index, :] for name in _OF_PATHS})

    def of_paths(self, paths: Array) -> "ElbowCharts":
        """Some paths."""
        return self._replace(**{name: getattr(self, name)[..., paths] for name in _OF_PATHS})

    def of_waypoints(self, waypoints: Array, paths: Array) -> "ElbowCharts":
        """Single waypoints of some paths, as paths of one waypoint."""
        return self._replace(**{name: getattr(self, name)[..., waypoints, paths][..., None, :] for name in _OF_PATHS})

    def joined(self, *halves: np.ndarray) -> "ElbowCharts":
        """Parts of every path, equally long, as paths of their own: all first ones, then all second ones, and so on."""
        join = lambda x: jnp.concatenate([x[..., half, :] for half in halves], axis=-1)  # noqa: E731
        return self._replace(**{name: join(getattr(self, name)) for name in _OF_PATHS})

    def of(self, branch: Array) -> "BranchCharts":
        """The charts of the branches taken, ``(K, B)``, or one a path, ``(B,)``."""
        branch = jnp.broadcast_to(branch, self.elbow.shape[1:])
        s, e, w = ((branch >> bit & 1) == 1 for bit in (2, 1, 0))
        one = jnp.ones((), self.elbow.dtype)
        return BranchCharts(
            jnp.where(e, self.shoulder[:, :, 1], self.shoulder[:, :, 0]),
            jnp.where(e, self.wrist[:, :, 1], self.wrist[:, :, 0]),
            jnp.where(e, self.elbow[1], self.elbow[0]),
            self.keep_out,
            self.shoulder_delta,
            self.wrist_delta,
            self.center,
            jnp.where(s, -one, one),
            jnp.where(w, -one, one),
        )


class BranchCharts(NamedTuple):
    """Charts of the branches taken: as :class:`ElbowCharts`, without the elbow bit and with the signs ``(K, B)``."""

    shoulder: Array
    wrist: Array
    elbow: Array
    keep_out: Array
    shoulder_delta: Array
    wrist_delta: Array
    center: Array
    shoulder_sign: Array
    wrist_sign: Array

    def joints(self, swivel: Array) -> Array:
        """Joint angles ``(joint, K, B)`` at swivels ``(K, B)``, in the turn nearest their ranges [rad]."""
        return _joints(self, swivel)

    def slopes(self, swivel: Array) -> tuple[Array, Array]:
        """Joint angles and their derivatives in the swivel."""
        return jax.jvp(partial(_joints, self), (swivel,), (jnp.ones_like(swivel),))

    def room(self, swivel: Array) -> Array:
        """The elbow's distance to each half-space, ``(half_spaces, K, B)`` [m]; negative is forbidden."""
        sin, cos = sincos(near(swivel))
        return self.keep_out[:, 0] + self.keep_out[:, 1] * cos + self.keep_out[:, 2] * sin

    def excess(self, arm: Arm, q: Array, swivel: Array) -> Array:
        """How far joints and elbow are beyond what they may, ``(K, B)`` [rad, and arm lengths of the elbow]."""
        lower, upper = arm.lower[:, None, None], arm.upper[:, None, None]
        over = jnp.sum(jnp.maximum(jnp.maximum(lower - q, q - upper), 0.0), axis=0)
        return over + jnp.sum(jnp.maximum(-self.room(swivel), 0.0), axis=0) / arm.length


@fused_separately
def _joints(charts: BranchCharts, swivel: Array) -> Array:
    sin, cos = sincos(near(swivel))
    shoulder = triple_angles(charts.shoulder, charts.shoulder_sign, charts.shoulder_delta, sin, cos)
    wrist = triple_angles(charts.wrist, charts.wrist_sign, charts.wrist_delta, sin, cos)
    q = jnp.stack([*shoulder, jnp.broadcast_to(charts.elbow, swivel.shape), *wrist])
    return charts.center + near(q - charts.center)


def elbow_charts(arm: Arm, target: Target) -> ElbowCharts:
    """The charts of B paths of K targets, leading axes ``(B, K)``, in the arm's dtype."""
    count, waypoints = target.position.shape[:2]
    rows = jax.tree.map(lambda x: jnp.swapaxes(x, 0, 1).reshape(-1, *x.shape[2:]), target)
    position, directions, _ = target_columns(rows, jnp.zeros((), rows.position.dtype), (waypoints * count,))
    f = swivel_functions(arm, position, directions)

    def paths(x: Array) -> Array:
        return x.reshape(*x.shape[:-1], waypoints, count)

    shoulder, wrist, elbow, room, solvable = (paths(x) for x in (f.shoulder, f.wrist, f.elbow, f.keep_out, f.solvable))
    center = ((arm.lower + arm.upper) / 2)[:, None, None]
    return ElbowCharts(shoulder, wrist, elbow, room, solvable, f.shoulder_delta[0], f.wrist_delta[0], center)


def near(angle: Array) -> Array:
    """An angle, or the difference of two, within half a turn of zero [rad]."""
    return angle - 2 * jnp.pi * jnp.round(angle / (2 * jnp.pi))


def steps(q: Array) -> Array:
    """Joint motion of every step, the shorter way round, ``(joint, K - 1, B)`` [rad].

    A joint that cannot turn round would have to leave its range to take that way, which the limits price.
    """
    return near(jnp.diff(q, axis=1))
