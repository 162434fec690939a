"""Swivels moved into the nearest exact feasible arc: what makes a learned motion safe.

Most waypoints of a trained policy are inside their limits as they are, and a look at their joint angles shows it. Arcs
are worked out for the paths that are not, some at a time.
"""

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxik.arcs import SwivelArcs, swivel_arcs
from jaxik.arm import Arm
from jaxik.planning.course import into_arcs
from jaxik.targets import Target
from training.elbow_charts import ElbowCharts, elbow_charts, near

_AT_ONCE = 8  # paths whose arcs are worked out in one go
_INSIDE = 1e-5  # distance from a limit below which the arcs decide [rad, arm lengths]


def into_limits(arm: Arm, target: Target, swivel: Array, branch: Array) -> tuple[Array, Array, Array, Array]:
    """Moves paths that leave the limits into the nearest arcs of their branch, or of the branch nearest to that.

    Args:
        arm: The arm.
        target: Leading axes ``(B, K)``.
        swivel: ``(K, B)`` [rad].
        branch: ``(B,)``.

    Returns:
        Swivels, branches, joint angles ``(joint, K, B)``, and whether a branch serves the whole path, ``(B,)``. Where
        none does, swivel and angles are nan at the waypoints without an arc.
    """
    charts = elbow_charts(arm, target)
    chart = charts.of(branch)
    q = chart.joints(swivel)
    outside = ~jnp.all(_inside(arm, q) & _clear(arm, chart.room(swivel)), axis=0)
    count = swivel.shape[1]
    at_once = min(_AT_ONCE, count)

    def more(state: tuple[Array, ...]) -> Array:
        return jnp.any(state[0])

    def some(state: tuple[Array, ...]) -> tuple[Array, ...]:
        left, swivel, branch = state
        (paths,) = jnp.nonzero(left, size=at_once, fill_value=count)  # a place beyond the end is dropped below
        rows = jnp.minimum(paths, count - 1)
        arcs = swivel_arcs(arm, jax.tree.map(lambda x: x[rows], target))
        moved, served = _moved(arm, charts.of_paths(rows), arcs, swivel[:, rows], branch[rows])
        return (
            left.at[paths].set(False, mode="drop"),
            swivel.at[:, paths].set(moved, mode="drop"),
            branch.at[paths].set(served, mode="drop"),
        )

    _, swivel, branch = lax.while_loop(more, some, (outside, swivel, branch))
    return swivel, branch, charts.of(branch).joints(swivel), jnp.all(jnp.isfinite(swivel), axis=0)


def _moved(arm: Arm, charts: ElbowCharts, arcs: SwivelArcs, swivel: Array, branch: Array) -> tuple[Array, Array]:
    """Swivels ``(K, B)`` in the arcs of the branch that then moves least, and that branch.

    The nearest arc of the branch proposed may lie on the other side for the next waypoint; what that costs shows in the
    joints' motion alone. Half a turn of swivel and the other elbow bit are the same elbow where it does not stick out.
    """
    others = jnp.arange(8, dtype=branch.dtype)

    def course(other: Array) -> tuple[Array, Array]:
        flipped = jnp.pi * ((other ^ branch) >> 1 & 1).astype(swivel.dtype)
        wanted = swivel + flipped
        column = jnp.full(wanted.shape[:1], other)
        moved = jax.vmap(lambda a, s: into_arcs(a, s, column).swivel)(arcs, wanted.T).T
        q = charts.of(jnp.full_like(branch, other)).joints(moved)
        step = jnp.diff(q, axis=1)
        turning = (arm.upper - arm.lower >= 2 * jnp.pi * (1 - 1e-6))[:, None, None]
        motion = jnp.sum(jnp.where(turning, near(step), step) ** 2, axis=(0, 1))
        lost = jnp.sum(jnp.isnan(moved).astype(motion.dtype), axis=0)
        return moved, jnp.where(lost > 0, 1e9 * lost, motion)

    moved, motion = lax.map(course, others)
    pick = jnp.argmin(motion, axis=0)
    return jnp.take_along_axis(moved, pick[None, None], 0)[0], pick.astype(branch.dtype)


def _inside(arm: Arm, q: Array) -> Array:
    """Whether every joint is in its range with a little to spare, ``(K, B)``."""
    lower, upper = arm.lower[:, None, None] + _INSIDE, arm.upper[:, None, None] - _INSIDE
    return jnp.all((q >= lower) & (q <= upper), axis=0)


def _clear(arm: Arm, room: Array) -> Array:
    return jnp.all(room >= _INSIDE * arm.length, axis=0)
