"""One path that settles within its exact feasible arcs: a few box-bounded Gauss-Newton steps from the nearest arcs.

The planner's own Newton method, with the curvature of joints that go straight: near limits the true one is often
negative, and its first steps are then refused.
"""

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxik.arcs import SwivelArcs
from jaxik.arm import Arm
from jaxik.planning.course import Course, into_arcs
from jaxik.planning.newton import Band, newton_in_box
from training.coarse_prices import Start
from training.elbow_charts import BranchCharts, ElbowCharts
from training.joint_motion import motion_cost, motion_system, moves, too_fast

_STEPS = 4  # two reach a percent where nine waypoints had been moved, four a tenth
_DAMPING = 1e-3  # as in :mod:`training.linear_step`
_FAST = 1e3  # times the motion: only where there is nothing slower
_LOST = 1e9  # price of a waypoint without an arc


def settled(
    arm: Arm,
    charts: ElbowCharts,
    arcs: SwivelArcs,
    time_s: Array,
    proposal: tuple[Array, Array],
    spare: Array,
    weight: Array | None,
    start: Start,
) -> tuple[Array, Array]:
    """The cheaper of two motions in the arcs: along the branches proposed, and in the one branch that moves least.

    Args:
        arm: The arm.
        charts: Of this one path.
        arcs: Of its K targets.
        time_s: ``(K,)`` [s].
        proposal: Swivels [rad] and branches, ``(K,)`` each.
        spare: Swivels for the one branch, ``(K,)`` [rad].
        weight: Of the joints' motion, ``(joint,)``; None to stay at the nearest arcs.
        start: Where the arm comes from.

    Returns:
        Swivels and branches, ``(K,)``; nan where there is no arc.
    """
    column = time_s[:, None]

    def price(swivel: Array, branch: Array) -> Array:
        q = charts.of(branch[:, None]).joints(swivel[:, None])
        motion = jnp.sum(moves(arm, q) ** 2)
        lost = jnp.sum(jnp.isnan(swivel).astype(motion.dtype))
        fast = jnp.where(too_fast(arm, q, column)[0], _FAST * motion, motion)
        return jnp.where(lost > 0, _LOST * lost, fast)

    def in_branch(branch: Array) -> tuple[Array, Course]:
        course = into_arcs(arcs, spare, jnp.full(spare.shape, branch))
        return price(course.swivel, course.branch), course

    prices, single = lax.map(in_branch, jnp.arange(8, dtype=proposal[1].dtype))
    pick = jnp.argmin(prices)
    single = jax.tree.map(lambda x: x[pick], single)
    both = jax.tree.map(lambda *x: jnp.stack(x), single, into_arcs(arcs, *proposal))
    if weight is not None:
        step = lambda course: _stepped(charts.of(course.branch[:, None]), course, column, weight, start)  # noqa: E731
        stepped = lax.map(step, both)
        both = both._replace(swivel=stepped)
    pick = jnp.argmin(jax.vmap(price)(both.swivel, both.branch))
    return both.swivel[pick], both.branch[pick]


def _stepped(charts: BranchCharts, course: Course, time_s: Array, weight: Array, start: Start) -> Array:
    """Swivels ``(K,)`` after some steps within the arcs."""

    def evaluate(swivel: Array) -> tuple[Array, Array, Band]:
        q, slope = charts.slopes(swivel[:, None])
        gradient, main, beside = (x[:, 0] for x in motion_system(q, slope, time_s, weight, start))
        main = main + _DAMPING * jnp.mean(main)
        last = jnp.zeros_like(main[:1])
        return motion_cost(q, time_s, weight, start)[0] / 2, gradient, Band((main, jnp.concatenate([beside, last])))

    return newton_in_box(evaluate, course.swivel, course.lower, course.upper, _STEPS).x
