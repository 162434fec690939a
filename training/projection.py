"""Swivels moved into the nearest exact feasible arc: what makes a learned motion safe.

1. Nearly all waypoints of a policy are inside their limits as they are, and a look at their joint angles shows it. Arcs
   are worked out for the others, some at a time.
2. Waypoints moved one by one make a kink. Where that costs, or leaves no motion, the whole path settles within its arcs
   (:mod:`training.settling`).
"""

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxik.arcs import swivel_arcs
from jaxik.arm import Arm
from jaxik.planning.course import into_arcs
from jaxik.targets import Target
from training.coarse_prices import Start
from training.elbow_charts import ElbowCharts
from training.joint_motion import motion_cost, too_fast
from training.settling import settled

_WAYPOINTS = 128  # whose arcs are worked out in one go
_INSIDE = 1e-5  # distance from a limit below which the arcs decide [rad, arm lengths]
_KINK = 1.005  # times the motion's cost: beyond, the path settles


def into_limits(
    arm: Arm,
    target: Target,
    charts: ElbowCharts,
    time_s: Array,
    course: tuple[Array, Array],
    spare: Array,
    weight: Array | None,
    start: Start,
) -> tuple[Array, Array, Array, Array]:
    """Moves waypoints that leave the limits into the nearest arcs of their branch.

    Args:
        arm: The arm.
        target: Leading axes ``(B, K)``.
        charts: Of these targets.
        time_s: ``(K, B)`` [s].
        course: Swivels [rad] and branches, ``(K, B)`` each.
        spare: Swivels to try in one branch where that fails, ``(K, B)`` [rad].
        weight: Of the joints' motion, ``(joint,)``; None where the energy is another, and kinks are left as they are.
        start: Where the arms come from.

    Returns:
        Swivels, branches, joint angles ``(joint, K, B)``, and whether every waypoint has a swivel, ``(B,)``. Where not,
        swivel and angles are nan at the waypoints without an arc in the branch that has most.
    """
    swivel, branch = course
    chart = charts.of(branch)
    before = chart.joints(swivel)
    outside = ~(_inside(arm, before) & jnp.all(chart.room(swivel) >= _INSIDE * arm.length, axis=0))
    swivel, q = _each_moved(arm, target, charts, swivel, branch, before, outside)

    moved = jnp.any(outside, axis=0)
    # Where the branch changes, what is interpolated may miss the alignment.
    changed = jnp.any(branch != branch[:1], axis=0)
    left = jnp.any(jnp.isnan(swivel), axis=0) | ((moved | changed) & too_fast(arm, q, time_s))
    if weight is not None:
        cost, smooth = (motion_cost(x, time_s, weight, start) for x in (q, before))
        left = left | (moved & (cost > _KINK * smooth))

    def one_path(state: tuple[Array, ...]) -> tuple[Array, ...]:
        left, swivel, branch, q = state
        row = jnp.argmax(left)
        some = charts.of_paths(row[None])
        come = Start(start.q[:, row, None], start.rate[row, None])
        arcs = swivel_arcs(arm, jax.tree.map(lambda x: x[row], target))
        course = swivel[:, row], branch[:, row]
        best, served = settled(arm, some, arcs, time_s[:, row], course, spare[:, row], weight, come)
        joints = some.of(served[:, None]).joints(best[:, None])[..., 0]
        return (
            left.at[row].set(False),
            swivel.at[:, row].set(best),
            branch.at[:, row].set(served),
            q.at[..., row].set(joints),
        )

    _, swivel, branch, q = lax.while_loop(lambda state: jnp.any(state[0]), one_path, (left, swivel, branch, q))
    return swivel, branch, q, jnp.all(jnp.isfinite(swivel), axis=0)


def _each_moved(
    arm: Arm, target: Target, charts: ElbowCharts, swivel: Array, branch: Array, q: Array, outside: Array
) -> tuple[Array, Array]:
    """Swivels and joint angles with the waypoints outside in the nearest arc, each by itself."""
    count = swivel.shape[1]

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

    return lax.while_loop(lambda state: jnp.any(state[0]), some_waypoints, (outside, swivel, q))[1:]


def _inside(arm: Arm, q: Array) -> Array:
    """Whether every joint is in its range with a little to spare, ``(K, B)``."""
    lower, upper = arm.lower[:, None, None] + _INSIDE, arm.upper[:, None, None] - _INSIDE
    return jnp.all((q >= lower) & (q <= upper), axis=0)
