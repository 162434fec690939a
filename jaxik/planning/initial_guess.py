"""From swivels and branches at a few waypoints to a start for the polish at all of them."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxik.arm import Arm
from jaxik.planning.chart import Chart, postures
from jaxik.redundancy import SwivelArcs


class Course(NamedTuple):
    """Swivel and branch at every waypoint, and the arc the swivel may move in.

    Attributes:
        swivel: ``(K,)`` [rad]; nan where the branch has no arc.
        branch: ``(K,)``.
        lower: Start of the arc, -inf for a whole circle.
        upper: Its end.
    """

    swivel: Array
    branch: Array
    lower: Array
    upper: Array


def interpolate(
    arm: Arm, chart: Chart, time: Array, index: np.ndarray, swivel: Array, branch: Array, turning: Array
) -> tuple[Array, Array]:
    """Swivel and branch at every waypoint from those at ``index``, first and last included.

    The arm plane turns evenly the shorter way round. It is the swivel itself, or half a turn from it where the elbow is
    bent to its other side: at a straight elbow, where the elbow bit changes, the plane is what goes on. Where the
    branches differ, they change at the step that needs the smallest joint motion.
    """
    flipped = jnp.pi * (branch >> 1 & 1).astype(swivel.dtype)
    plane = jnp.interp(time, time[index], jnp.unwrap(swivel - flipped))
    segment = np.repeat(np.arange(len(index) - 1), np.diff(index))  # of every step from one waypoint to the next
    leaving, entering = branch[:-1][segment], branch[1:][segment]

    def posture(rows: slice, branches: Array) -> Array:
        turned = plane[rows] + jnp.pi * (branches >> 1 & 1).astype(plane.dtype)
        return postures(arm, chart.at(np.arange(len(time))[rows]), turned, branches)

    jump = posture(slice(1, None), entering) - posture(slice(None, -1), leaving)
    wrapped = jump - 2 * jnp.pi * jnp.round(jump / (2 * jnp.pi))
    jump = jnp.max(jnp.abs(jnp.where(turning[:, None], wrapped, jump)), axis=0)
    smallest = jax.ops.segment_min(jump, segment, len(index) - 1)[segment]
    steps = np.arange(len(segment))
    cut = jax.ops.segment_min(jnp.where(jump == smallest, steps, len(segment)), segment, len(index) - 1)[segment]
    branches = jnp.concatenate([branch[:1], jnp.where(steps >= cut, entering, leaving)])
    return plane + jnp.pi * (branches >> 1 & 1).astype(plane.dtype), branches


def filled(
    arm: Arm,
    chart: Chart,
    time: Array,
    index: np.ndarray,
    swivel: np.ndarray,
    branch: np.ndarray,
    turning: Array,
) -> dict[str, Array]:
    """:func:`interpolate` on the host, by name; almost free where the branch stays the same."""
    if (branch == branch[0]).all():
        times = np.asarray(time)
        along = jnp.asarray(np.interp(times, times[index], np.unwrap(swivel)), time.dtype)
        return {"swivel": along, "branch": jnp.full(times.shape, branch[0])}
    rows = jnp.asarray(swivel, time.dtype), jnp.asarray(branch)
    return dict(zip(("swivel", "branch"), interpolate(arm, chart, time, index, *rows, turning), strict=True))


def into_arcs(arcs: SwivelArcs, swivel: Array, branch: Array) -> Course:
    """Moves each swivel into the nearest feasible arc of its branch, in its own turn."""
    margin = 64 * float(jnp.finfo(swivel.dtype).eps) ** 0.75  # the arcs' ends carry this much rounding
    start, end, valid = (
        jnp.take_along_axis(x, branch[:, None, None], 1)[:, 0] for x in (arcs.start, arcs.end, arcs.valid)
    )
    inset = jnp.minimum(margin, (end - start) / 2)
    turn = 2 * jnp.pi
    shift = turn * jnp.round((swivel[:, None] - (start + end) / 2) / turn)
    whole = end - start >= turn * (1 - 1e-9)
    low = jnp.where(whole, -jnp.inf, start + inset + shift)
    high = jnp.where(whole, jnp.inf, end - inset + shift)
    moved = jnp.clip(swivel[:, None], low, high)
    distance = jnp.where(valid, jnp.abs(moved - swivel[:, None]), jnp.inf)
    pick = jnp.argmin(distance, axis=1)[:, None]
    none = jnp.isinf(jnp.take_along_axis(distance, pick, 1)[:, 0])
    moved, low, high = (jnp.take_along_axis(x, pick, 1)[:, 0] for x in (moved, low, high))
    return Course(jnp.where(none, jnp.nan, moved), branch, low, high)
