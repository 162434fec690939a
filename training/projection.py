"""Swivels moved into the nearest exact feasible arc: what makes a learned motion safe.

Nearly all waypoints of a policy are inside their limits as they are, and a look at their joint angles shows it. Arcs
are worked out for the others, some at a time; all branches are looked at only where that leaves no motion.
"""

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxik.arcs import SwivelArcs, swivel_arcs
from jaxik.arm import Arm
from jaxik.planning.course import into_arcs
from jaxik.targets import Target
from training.elbow_charts import ElbowCharts, near

_WAYPOINTS = 128  # whose arcs are worked out in one go
_PATHS = 2  # whose branches are compared in one go
_INSIDE = 1e-5  # distance from a limit below which the arcs decide [rad, arm lengths]


def into_limits(
    arm: Arm, target: Target, charts: ElbowCharts, time_s: Array, swivel: Array, branch: Array, spare: Array
) -> tuple[Array, Array, Array, Array]:
    """Moves waypoints that leave the limits into the nearest arcs of their branch.

    Paths that then have no motion, or one faster than the joints, go to the arcs of the one branch that moves least.

    Args:
        arm: The arm.
        target: Leading axes ``(B, K)``.
        charts: Of these targets.
        time_s: ``(K, B)`` [s].
        swivel: ``(K, B)`` [rad].
        branch: ``(K, B)``.
        spare: Swivels to try in one branch where that fails, ``(K, B)`` [rad].

    Returns:
        Swivels, branches, joint angles ``(joint, K, B)``, and whether a branch serves the whole path, ``(B,)``. Where
        none does, swivel and angles are nan at the waypoints without an arc.
    """
    count = swivel.shape[1]
    chart = charts.of(branch)
    q = chart.joints(swivel)
    outside = ~(_inside(arm, q) & jnp.all(chart.room(swivel) >= _INSIDE * arm.length, axis=0))

    def some_waypoints(state: tuple[Array, ...]) -> tuple[Array, ...]:
        left, swivel, q = state
        (places,) = jnp.nonzero(left.reshape(-1), size=min(_WAYPOINTS, left.size), fill_value=left.size)
        waypoint, path = (jnp.minimum(places, left.size - 1) // count, jnp.minimum(places, left.size - 1) % count)
        arcs = swivel_arcs(arm, jax.tree.map(lambda x: x[path, waypoint], target))
        moved = into_arcs(arcs, swivel[waypoint, path], branch[waypoint, path]).swivel
        angles = charts.of_waypoints(waypoint, path).of(branch[waypoint, path]).joints(moved[None])[:, 0]
        flat = lambda x: x.reshape(*x.shape[:-2], -1)  # noqa: E731
        return (
            flat(left).at[places].set(False, mode="drop").reshape(left.shape),
            flat(swivel).at[places].set(moved, mode="drop").reshape(swivel.shape),
            flat(q).at[:, places].set(angles, mode="drop").reshape(q.shape),
        )

    _, swivel, q = lax.while_loop(lambda state: jnp.any(state[0]), some_waypoints, (outside, swivel, q))
    moved = jnp.any(outside, axis=0)
    fast = jnp.any(_moves(arm, q) > arm.velocity_limit[:, None, None] * jnp.diff(time_s, axis=0), axis=(0, 1))
    # Where the branch changes, what is interpolated may miss the alignment.
    changed = jnp.any(branch != branch[:1], axis=0)
    lost = jnp.any(jnp.isnan(swivel), axis=0) | ((moved | changed) & fast)

    def some_paths(state: tuple[Array, ...]) -> tuple[Array, ...]:
        left, swivel, branch, q = state
        (paths,) = jnp.nonzero(left, size=min(_PATHS, count), fill_value=count)  # a place beyond the end is dropped
        rows = jnp.minimum(paths, count - 1)
        arcs = swivel_arcs(arm, jax.tree.map(lambda x: x[rows], target))
        some = charts.of_paths(rows)
        moved, served = _moved(arm, some, arcs, spare[:, rows])
        return (
            left.at[paths].set(False, mode="drop"),
            swivel.at[:, paths].set(moved, mode="drop"),
            branch.at[:, paths].set(served, mode="drop"),
            q.at[..., paths].set(some.of(served).joints(moved), mode="drop"),
        )

    _, swivel, branch, q = lax.while_loop(lambda state: jnp.any(state[0]), some_paths, (lost, swivel, branch, q))
    return swivel, branch, q, jnp.all(jnp.isfinite(swivel), axis=0)


def _moved(arm: Arm, charts: ElbowCharts, arcs: SwivelArcs, swivel: Array) -> tuple[Array, Array]:
    """Swivels ``(K, B)`` in the arcs of the branch that then moves least, and that branch.

    The nearest arc of the branch proposed may lie on the other side for the next waypoint; what that costs shows in the
    joints' motion alone.
    """
    others = jnp.arange(8, dtype=jnp.int32)

    def course(other: Array) -> tuple[Array, Array]:
        column = jnp.full(swivel.shape[:1], other)
        moved = jax.vmap(lambda a, s: into_arcs(a, s, column).swivel)(arcs, swivel.T).T
        q = charts.of(column[:, None]).joints(moved)
        motion = jnp.sum(_moves(arm, q) ** 2, axis=(0, 1))
        lost = jnp.sum(jnp.isnan(moved).astype(motion.dtype), axis=0)
        return moved, jnp.where(lost > 0, 1e9 * lost, motion)

    moved, motion = lax.map(course, others)
    pick = jnp.argmin(motion, axis=0)
    return jnp.take_along_axis(moved, pick[None, None], 0)[0], pick.astype(jnp.int32)


def _moves(arm: Arm, q: Array) -> Array:
    """How far joints go in each step, the shorter way where they turn without end, ``(joint, K - 1, B)`` [rad]."""
    step = jnp.diff(q, axis=1)
    turning = (arm.upper - arm.lower >= 2 * jnp.pi * (1 - 1e-6))[:, None, None]
    return jnp.abs(jnp.where(turning, near(step), step))


def _inside(arm: Arm, q: Array) -> Array:
    """Whether every joint is in its range with a little to spare, ``(K, B)``."""
    lower, upper = arm.lower[:, None, None] + _INSIDE, arm.upper[:, None, None] - _INSIDE
    return jnp.all((q >= lower) & (q <= upper), axis=0)
