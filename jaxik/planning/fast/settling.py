"""One path that settles within its exact feasible arcs: a few steps of the planner's own Newton method from there."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxik.arm import Arm
from jaxik.energy import joint_motion
from jaxik.planning.chart import make_chart
from jaxik.planning.cost import Ends, PathCost
from jaxik.planning.fast.candidates import Way
from jaxik.planning.fast.coarse_costs import Start
from jaxik.planning.fast.motion_cost import path_motion, too_fast
from jaxik.planning.fast.path_batch import ElbowCharts
from jaxik.planning.initial_guess import into_arcs
from jaxik.planning.newton import newton_in_box
from jaxik.redundancy import swivel_arcs
from jaxik.targets import Target

STEPS = 3  # Newton steps: where nine waypoints had been moved, one reaches 0.02 %
_ENOUGH = 1.05  # times the motion without limits: no other valley is looked into
_BAD = 100.0  # times it: something jumps, and every branch is looked at
_FAST = 1e3  # times the motion: only where there is nothing slower
_NO_RATE = 1e-6  # of coming from nowhere [1/s]
_LOST = 1e9  # times the motion without limits, for each waypoint without an arc

Priced = tuple[Array, Way]


def settled(
    arm: Arm,
    target: Target,
    charts: ElbowCharts,
    time: Array,
    proposal: Way,
    others: Callable[[Array], Way],
    count: int,
    smooth: Array,
    weight: Array,
    start: Start,
    steps: int = STEPS,
) -> Way:
    """A motion in the arcs from the one proposed or, while that costs much more than without limits, from others.

    Args:
        arm: The arm.
        target: K targets, of one path.
        charts: Of this path.
        time: ``(K,)`` [s].
        proposal: Swivels [rad] and branches, ``(K,)`` each.
        others: Gives one more of them; the first is the last resort, in the branch that then costs least.
        count: How many more there are.
        smooth: What the proposal's motion costs without limits, ``()``.
        weight: Of the joints' motion, ``(joint,)``.
        start: Where the arm comes from.
        steps: Newton steps; 0 to stay at the nearest arcs.

    Returns:
        Swivels and branches, ``(K,)``; nan where there is no arc.
    """
    column = time[:, None]
    arcs, chart = swivel_arcs(arm, target), make_chart(arm, target)
    # A start that does not count has all the time of the world.
    ends = Ends(start.q[:, 0], None, 1.0 / jnp.maximum(start.rate[0], _NO_RATE))
    energy = joint_motion(weight)
    turning = arm.upper - arm.lower >= 2 * jnp.pi * (1 - 1e-6)

    def price(way: Way) -> Array:
        swivel, branch = way
        q = charts.of(branch[:, None]).joints(swivel[:, None])
        motion = path_motion(q, column, weight, start)[0]
        lost = jnp.sum(jnp.isnan(swivel).astype(motion.dtype))
        fast = jnp.where(too_fast(arm, q, column)[0], _FAST * motion, motion)
        return jnp.where(lost > 0, _LOST * smooth * lost, fast)

    def in_arcs(way: Way) -> Priced:
        """A motion in the arcs, from there."""
        course = into_arcs(arcs, *way)
        swivel = course.swivel
        if steps:
            cost = PathCost(arm, chart, energy, time, ends, course.branch, turning, smooth)
            swivel = newton_in_box(cost, swivel, course.lower, course.upper, steps).x
        return price((swivel, course.branch)), (swivel, course.branch)

    def next_one(state: tuple[Array, Priced]) -> tuple[Array, Priced]:
        number, best = state
        way = lax.cond(number == 0, lambda: proposal, lambda: others(number - 1))
        return number + 1, _cheaper(in_arcs(way), best)

    def in_every_branch(best: Priced) -> Priced:
        swivel, _ = others(jnp.zeros((), jnp.int32))

        def nearest(branch: Array) -> Priced:
            way = into_arcs(arcs, swivel, jnp.full(time.shape, branch))[:2]
            return price(way), way

        prices, ways = lax.map(nearest, jnp.arange(8, dtype=proposal[1].dtype))
        least = jnp.argmin(prices)
        return _cheaper((prices[least], jax.tree.map(lambda x: x[least], ways)), best)

    # A target that is no number has no price that is less than another: it ends where it began, nowhere.
    nothing = jnp.full((), jnp.inf, smooth.dtype), (jnp.full_like(proposal[0], jnp.nan), proposal[1])
    dear = lambda state: (state[0] <= count) & ~(state[1][0] <= _ENOUGH * smooth)  # noqa: E731
    _, best = lax.while_loop(dear, next_one, (jnp.zeros((), jnp.int32), nothing))
    return lax.cond(best[0] <= _BAD * smooth, lambda best: best, in_every_branch, best)[1]


def _cheaper(a: Priced, b: Priced) -> Priced:
    return jax.tree.map(lambda x, y: jnp.where(a[0] < b[0], x, y), a, b)
