"""What paths ask of an elbow policy: the best of some valleys, and what a network is to see of it.

1. Candidates from different valleys (:mod:`jaxik.planning.fast.coarse_search`), filled in at the knots.
2. Linear steps in each, taken where they help; the cheapest candidate goes on.
3. One step more, the next one as a proposal, and the features there.
"""

from functools import reduce
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxik.arm import Arm
from jaxik.numerics import fused_separately
from jaxik.planning.fast.branch_changes import filled
from jaxik.planning.fast.coarse_costs import Start
from jaxik.planning.fast.coarse_search import EXCESS, best_valleys, coarse
from jaxik.planning.fast.gauss_newton import linear_step
from jaxik.planning.fast.motion_cost import path_motion
from jaxik.planning.fast.path_batch import BranchCharts, ElbowCharts
from training.policy.features import path_features

_LOOKS = 2  # linear steps before candidates are compared: after one, some have not come far enough
_NEVER = 1e9  # times the price: only where there is nothing else


Way = tuple[Array, Array]  # swivels and branches


class Outlook(NamedTuple):
    """What paths ask for; nothing of it depends on a network's weights.

    Attributes:
        charts: Of the branches chosen.
        branch: ``(K, B)``.
        begin: Swivels of the best candidate, ``(K, B)`` [rad].
        swivel: The same after a linear step, where that helps.
        step: The next linear step, ``(K, B)`` [rad].
        excess: Mean excess over the limits that the beginning has, ``(B,)`` [rad].
        features: What the network sees, ``(features, K, B)``.
        spare: Swivels and branches of the best candidate that keeps one branch, ``(K, B)`` each.
        valleys: The same of all candidates, ``(candidates, K, B)`` each.
    """

    charts: BranchCharts
    branch: Array
    begin: Array
    swivel: Array
    step: Array
    excess: Array
    features: Array
    spare: Way
    valleys: Way


class Course(NamedTuple):
    """Swivels and branches ``(K, B)``, and what they cost, ``(B,)``."""

    price: Array
    swivel: Array
    branch: Array


def look_out(arm: Arm, charts: ElbowCharts, time: Array, weight: Array, start: Start, candidates: int) -> Outlook:
    """What B paths ask for.

    Args:
        arm: The arm.
        charts: Of the paths at K knots.
        time: ``(K, B)`` [s].
        weight: Of the joints' motion, ``(joint,)``.
        start: Where the arms come from.
        candidates: Valleys that are looked into.
    """
    searched = coarse(len(time))
    valleys = best_valleys(arm, charts.at(searched), time[searched], weight, start, candidates)

    def look(best: tuple[Course, Course], valley: Way) -> tuple[tuple[Course, Course], Way]:
        """The best of all candidates so far, and of those that keep one branch."""
        swivel, branch = filled(charts, searched, *valley)
        chart = charts.of(branch)
        price = motion_price(arm, chart, chart.joints(swivel), swivel, time, weight, start)
        for _ in range(_LOOKS):
            price, swivel = _stepped(arm, chart, price, swivel, time, weight, start)
        changes = jnp.any(branch != branch[:1], axis=0)
        mine = Course(price, swivel, branch), Course(jnp.where(changes, _NEVER * price, price), swivel, branch)
        return (_cheaper(mine[0], best[0]), _cheaper(mine[1], best[1])), (swivel, branch)

    nowhere = jnp.zeros_like(time)
    nothing = Course(nowhere[0] + jnp.inf, nowhere, nowhere.astype(valleys[1].dtype))
    ((_, begin, branch), spare), looked = jax.lax.scan(look, (nothing, nothing), valleys)
    chart = charts.of(branch)

    def stepped(swivel: Array) -> tuple[tuple[Array, Array], Array, Array]:
        """Joints and slopes, their price, and the linear step from there."""
        q, slope = chart.slopes(swivel)
        price = motion_price(arm, chart, q, swivel, time, weight, start)
        return (q, slope), price, linear_step(arm, chart, swivel, q, slope, time, weight, start)

    before, price, step = stepped(begin)
    after, better, second = stepped(begin + step)
    # Where joints do not go straight, a step may lead away; the network then has the beginning to go on from.
    good = better < price
    swivel = jnp.where(good, begin + step, begin)
    joints = jnp.where(good, after[0], before[0]), jnp.where(good, after[1], before[1])
    step = jnp.where(good, second, 0.0)
    seen = path_features(arm, chart, swivel, joints, step, time, weight, start)
    excess = jnp.mean(chart.excess(arm, before[0], begin), axis=0)
    one_branch = jnp.broadcast_to(spare.branch[:1], branch.shape)
    return Outlook(chart, branch, begin, swivel, step, excess, seen, (spare.swivel, one_branch), looked)


def best_course(
    arm: Arm,
    charts: ElbowCharts,
    proposals: tuple[tuple[Array, Array], ...],
    time: Array,
    weight: Array,
    start: Start,
) -> tuple[Array, Array]:
    """The cheapest of some proposals, swivels and branches ``(K, B)``, after one linear step where that helps."""

    def priced(swivel: Array, branch: Array) -> Course:
        chart = charts.of(branch)
        return Course(motion_price(arm, chart, chart.joints(swivel), swivel, time, weight, start), swivel, branch)

    price, swivel, branch = reduce(_cheaper, (priced(*proposal) for proposal in proposals))
    return _stepped(arm, charts.of(branch), price, swivel, time, weight, start)[1], branch


@fused_separately
def motion_price(
    arm: Arm, charts: BranchCharts, q: Array, swivel: Array, time: Array, weight: Array, start: Start
) -> Array:
    """Joint motion, times one and the mean excess over limits, ``(B,)``."""
    beyond = jnp.mean(charts.excess(arm, q, swivel), axis=0)
    return path_motion(q, time, weight, start) * (1.0 + EXCESS * beyond)


def _stepped(
    arm: Arm, charts: BranchCharts, price: Array, swivel: Array, time: Array, weight: Array, start: Start
) -> tuple[Array, Array]:
    """Prices and swivels after a linear step, where it helps."""
    step = linear_step(arm, charts, swivel, *charts.slopes(swivel), time, weight, start)
    after = motion_price(arm, charts, charts.joints(swivel + step), swivel + step, time, weight, start)
    return jnp.minimum(price, after), jnp.where(after < price, swivel + step, swivel)


def _cheaper(a: Course, b: Course) -> Course:
    """The cheaper one of each path's two."""
    return jax.tree.map(lambda x, y: jnp.where(a.price < b.price, x, y), a, b)
