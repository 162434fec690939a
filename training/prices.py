"""What holding the swivel constant would cost, in every branch: where the policy begins.

Shoulder, elbow and wrist are priced apart and added up: eight branches share two elbows and two solutions a triple, so
their prices cost little more than one.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxik.arm import Arm
from jaxik.numerics import arctan2, clipped_sqrt, sincos, wrap
from training.elbow_charts import ElbowCharts, near


class Start(NamedTuple):
    """The postures that arms come from.

    Attributes:
        q: ``(joint, B)`` [rad].
        rate: One over the time they have to the first waypoint, ``(B,)`` [1/s]; zero for arms that come from nowhere.
    """

    q: Array
    rate: Array


EXCESS = 20.0  # relative price of one radian of mean excess over a joint's range: 1 % for 0.03 degrees


def constant_prices(
    arm: Arm, charts: ElbowCharts, time_s: Array, swivel: Array, weight: Array, start: Start
) -> tuple[Array, Array]:
    """Prices of constant swivels in every branch.

    Args:
        arm: The arm.
        charts: Of B paths of K waypoints.
        time_s: ``(K, B)`` [s].
        swivel: Candidates, ``(S, B)`` [rad].
        weight: Of Δq² / dt in the energy, ``(joint,)``.
        start: Where the arms come from.

    Returns:
        Joint motion, times one and twenty times the mean excess over limits and keep-out; and that excess [rad];
        ``(8, S, B)`` each.
    """
    rate = 1.0 / jnp.diff(time_s, axis=0)
    sin, cos = (x[:, None] for x in sincos(near(swivel)))

    def triple(entries: Array, delta: Array, first: int) -> tuple[Array, Array]:
        """Motion and excess of both solutions, ``(2, elbow bit, S, B)`` each."""
        values = entries[:, 0][:, :, None] + entries[:, 1][:, :, None] * cos + entries[:, 2][:, :, None] * sin
        middle = arctan2(clipped_sqrt(1.0 - values[2] ** 2), values[2])
        outer = [arctan2(values[1], values[0])] + ([arctan2(values[4], values[3])] if len(values) == 5 else [])
        plus = [outer[0], wrap(middle - delta), *outer[1:]]
        minus = [wrap(outer[0] + jnp.pi), wrap(-middle - delta), *(wrap(a + jnp.pi) for a in outer[1:])]
        # Both solutions make the same steps: their outer angles differ by half a turn, the middle ones by the sign.
        motion = sum(weight[j] * _motion(a, rate) for j, a in enumerate(plus, first))
        joining = [_joining(start, weight, s, first) for s in (plus, minus)]
        return motion + jnp.stack(joining), jnp.stack([_excess(arm, s, first) for s in (plus, minus)])

    shoulder, shoulder_excess = triple(charts.shoulder, charts.shoulder_delta, 0)
    wrist, wrist_excess = triple(charts.wrist, charts.wrist_delta, 4)
    elbow = charts.elbow[:, None]
    motion = weight[3] * _motion(elbow, rate) + _joining(start, weight, [elbow], 3)
    room = charts.keep_out[:, 0][:, None] + charts.keep_out[:, 1][:, None] * cos + charts.keep_out[:, 2][:, None] * sin
    forbidden = jnp.sum(jnp.mean(jnp.maximum(-room, 0.0), axis=-2), axis=0) / arm.length

    def branches(s: Array, e: Array, w: Array) -> Array:
        """Sums over shoulder bit, elbow bit and wrist bit, in the order of branch numbers."""
        return s[:, :, None] + e[None, :, None] + jnp.moveaxis(w, 0, 1)[None]

    total = branches(shoulder, motion, wrist)
    excess = branches(shoulder_excess, _excess(arm, [elbow], 3), wrist_excess) + forbidden
    shape = (8, *swivel.shape)
    return (total * (1.0 + EXCESS * excess)).reshape(shape), jnp.broadcast_to(excess, total.shape).reshape(shape)


def _joining(start: Start, weight: Array, angles: list[Array], first: int) -> Array:
    """Σ w Δq² / dt of the way from the start to the first waypoint."""
    total = jnp.zeros((), weight.dtype)
    for joint, q in enumerate(angles, first):
        total = total + weight[joint] * near(q[..., 0, :] - start.q[joint]) ** 2 * start.rate
    return total


def _motion(angle: Array, rate: Array) -> Array:
    """Σ Δq² / dt over the waypoints."""
    return jnp.sum(near(jnp.diff(angle, axis=-2)) ** 2 * rate, axis=-2)


def _excess(arm: Arm, angles: list[Array], first: int) -> Array:
    """Mean excess of some joints over their ranges, and one for every jump from end to end."""
    total = jnp.zeros((), angles[0].dtype)
    for joint, q in enumerate(angles, first):
        middle, half = (arm.upper[joint] + arm.lower[joint]) / 2, (arm.upper[joint] - arm.lower[joint]) / 2
        off = near(q - middle)
        total = total + jnp.mean(jnp.maximum(jnp.abs(off) - half, 0.0), axis=-2)
        # A joint that passes from one end of its range to the other has no way there, unless it turns without end.
        jumps = jnp.sum((jnp.abs(jnp.diff(off, axis=-2)) > jnp.pi).astype(off.dtype), axis=-2)
        total = total + jnp.where(half < jnp.pi * (1 - 1e-6), jumps, 0.0)
    return total
