"""Swivels moved into the nearest exact feasible arc: what makes a learned motion safe.

1. Nearly all waypoints of a policy are inside their limits as they are, and a look at their joint angles shows it. Arcs
   are worked out for the others, some at a time.
2. Waypoints moved one by one make a kink. Where that costs, or leaves no motion, the whole path settles within its arcs
   (:mod:`jaxik.planning.fast.settling`).
"""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxik.arm import Arm
from jaxik.planning.fast.candidates import Way
from jaxik.planning.fast.coarse_costs import Start
from jaxik.planning.fast.motion_cost import path_motion, too_fast
from jaxik.planning.fast.path_batch import ElbowCharts
from jaxik.planning.fast.settling import STEPS, settled
from jaxik.planning.initial_guess import into_arcs
from jaxik.redundancy import swivel_arcs
from jaxik.targets import Target

_WAYPOINTS = 128  # whose arcs are worked out in one go
_INSIDE = 1e-5  # distance from a limit below which the arcs decide [rad, arm lengths]
_KINK = 1.005  # times the motion's cost: beyond, the path settles


def into_limits(
    arm: Arm,
    target: Target,
    charts: ElbowCharts,
    time: Array,
    course: Way,
    others: Callable[[Array, Array], Way],
    count: int,
    weight: Array,
    start: Start,
    steps: int = STEPS,
) -> tuple[Array, Array, Array, Array]:
    """Moves waypoints that leave the limits into the nearest arcs of their branch.

    Args:
        arm: The arm.
        target: Leading axes ``(B, K)``.
        charts: Of these targets.
        time: ``(K, B)`` [s].
        course: Swivels [rad] and branches, ``(K, B)`` each.
        others: Gives one more of them, ``(K,)`` each, for a path and a number.
        count: How many there are of each path.
        weight: Of the joints' motion, ``(joint,)``.
        start: Where the arms come from.
        steps: Newton steps of a path that settles; 0 where the energy is another, and kinks stay as they are.

    Returns:
        Swivels, branches, joint angles ``(joint, K, B)``, and whether every waypoint has a swivel, ``(B,)``. Where not,
        swivel and angles are nan at the waypoints without an arc in the branch that has most.
    """
    swivel, branch = course
    chart = charts.of(branch)
    before = chart.joints(swivel)
    smooth = path_motion(before, time, weight, start)
    roomy = jnp.all(chart.room(swivel) >= _INSIDE * arm.length, axis=0)
    outside = ~(_inside(arm, before) & roomy & charts.solvable)
    moved, q = _each_moved(arm, target, charts, swivel, branch, before, outside)

    touched = jnp.any(outside, axis=0)
    # Where the branch changes, what is interpolated may miss the alignment.
    changed = jnp.any(branch != branch[:1], axis=0)
    left = jnp.any(jnp.isnan(moved), axis=0) | ((touched | changed) & too_fast(arm, q, time))
    if steps:
        left = left | (touched & (path_motion(q, time, weight, start) > _KINK * smooth))
    left = left & jnp.all(charts.solvable, axis=0)  # a target that cannot be reached is nobody's valley

    def one_path(state: tuple[Array, ...]) -> tuple[Array, ...]:
        left, moved, branch, q = state
        row = jnp.argmax(left)
        some = charts.of_paths(row[None])
        come = Start(start.q[:, row, None], start.rate[row, None])
        proposal = swivel[:, row], branch[:, row]
        mine = jax.tree.map(lambda x: x[row], target)
        more = partial(others, row), count
        best, served = settled(arm, mine, some, time[:, row], proposal, *more, smooth[row], weight, come, steps)
        joints = some.of(served[:, None]).joints(best[:, None])[..., 0]
        return (
            left.at[row].set(False),
            moved.at[:, row].set(best),
            branch.at[:, row].set(served),
            q.at[..., row].set(joints),
        )

    _, moved, branch, q = lax.while_loop(lambda state: jnp.any(state[0]), one_path, (left, moved, branch, q))
    q = jnp.where(jnp.isnan(moved), jnp.nan, q)  # joint 4 would have an angle
    return moved, branch, q, jnp.all(jnp.isfinite(moved), axis=0)


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

    _, swivel, q = lax.while_loop(lambda state: jnp.any(state[0]), some_waypoints, (outside, swivel, q))
    return swivel, q


def _inside(arm: Arm, q: Array) -> Array:
    """Whether every joint is in its range with a little to spare, ``(K, B)``."""
    lower, upper = arm.lower[:, None, None] + _INSIDE, arm.upper[:, None, None] - _INSIDE
    return jnp.all((q >= lower) & (q <= upper), axis=0)
