"""What a path's swivels cost: value, gradient and banded Hessian for the polish."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxik.arm import Arm
from jaxik.energy import Energy
from jaxik.planning.chart import Chart, rates
from jaxik.planning.continuity import unwrap
from jaxik.planning.newton import Band

_SPEED_MARGIN = 0.98  # the penalty on joint speeds sets in here, so that the limit itself is kept
_SPEED_PENALTY = 1e2  # against an energy scaled to one


class Ends(NamedTuple):
    """Postures before the first waypoint and behind the last, and the time for the motion between.

    Attributes:
        start: Posture the arm comes from, if any, ``(joint,)``.
        end: Posture it goes on to, if any, ``(joint,)``.
        seconds: Time for each of these motions [s].
    """

    start: Array | None
    end: Array | None
    seconds: Array


class PathCost(NamedTuple):
    """The objective of one path in given branches, a function of the swivels ``(K,)``.

    The energy is differentiated in the joint angles, where it is a few lines of algebra, and the joint angles in the
    swivel, each waypoint by itself. The band of the Hessian comes from as many Hessian-vector products as it is wide
    (Curtis, Powell and Reid, "On the estimation of sparse Jacobian matrices", 1974).

    Attributes:
        arm: The arm.
        chart: Its angles along the path.
        energy: What to make small.
        time: ``(K,)`` [s].
        ends: Postures before and behind the path.
        branch: ``(K,)``.
        turning: Which joints turn without end, ``(joint,)``.
        scale: The energy's size, ``()``.
    """

    arm: Arm
    chart: Chart
    energy: Energy
    time: Array
    ends: Ends
    branch: Array
    turning: Array
    scale: Array

    def joints(self, swivel: Array) -> Array:
        """Joint angles ``(K, joint)`` [rad], without jumps of a full turn in turning joints."""
        return unwrap(rates(self.arm, self.chart, swivel, self.branch).q.T, self.turning)

    def spent(self, q: Array) -> tuple[Array, Array]:
        """The motion's energy, and what coming from the start and going on to the end costs beside it."""
        weight = self.energy.motion_weight(self.arm)
        first = approach_cost(self.ends.start, q[0], weight, self.ends.seconds, self.turning)
        last = approach_cost(self.ends.end, q[-1], weight, self.ends.seconds, self.turning)
        return self.energy(self.arm, q, self.time), first + last

    def value(self, q: Array) -> Array:
        """Both against the scale, and a penalty on joints near their greatest speed."""
        speed = jnp.abs(jnp.diff(q, axis=0)) / (jnp.diff(self.time)[:, None] * self.arm.velocity_limit)
        excess = jnp.maximum(speed - _SPEED_MARGIN, 0.0)
        return sum(self.spent(q)) / self.scale + _SPEED_PENALTY * jnp.sum(excess**2)

    def gradient(self, swivel: Array) -> Array:
        """Of the value in the swivels, ``(K,)``."""
        r = rates(self.arm, self.chart, swivel, self.branch)
        return jnp.sum(jax.grad(self.value)(unwrap(r.q.T, self.turning)) * r.first.T, axis=-1)

    def __call__(self, swivel: Array) -> tuple[Array, Array, Band]:
        """Value, gradient and Hessian in the swivels."""
        r = rates(self.arm, self.chart, swivel, self.branch)
        q, first = unwrap(r.q.T, self.turning), r.first.T
        value, by_joint = jax.value_and_grad(self.value)(q)
        gradient = jnp.sum(by_joint * first, axis=-1)
        # A step couples two waypoints, a velocity or acceleration three.
        width = 1 if self.energy.separable else 2
        colors, index = 2 * width + 1, jnp.arange(len(swivel))
        seeds = (index % colors == jnp.arange(colors)[:, None]).astype(q.dtype)[..., None] * first
        products = jax.vmap(lambda seed: jax.jvp(jax.grad(self.value), (q,), (seed,))[1])(seeds)
        products = jnp.sum(products * first, axis=-1)
        diagonals = [
            jnp.where(index + d < len(index), products[(index + d) % colors, index], 0.0) for d in range(width + 1)
        ]
        diagonals[0] = diagonals[0] + jnp.sum(by_joint * r.second.T, axis=-1)
        return value, gradient, Band(tuple(diagonals))


def approach_cost(posture: Array | None, q: Array, weight: Array, seconds: Array, turning: Array) -> Array:
    """Σ_j w_j Δq_j² / seconds of the straight joint motion between a posture and ``(*batch, joint)``: ``(*batch,)``."""
    if posture is None:
        return jnp.zeros(q.shape[:-1], q.dtype)
    step = q - posture
    step = step - jnp.where(turning, 2 * jnp.pi, 0.0) * jnp.round(step / (2 * jnp.pi))
    return jnp.sum(weight * step**2, axis=-1) / seconds
