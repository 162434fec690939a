"""The elbow policy: targets and present posture in, swivel and branch out, at about a thousandth of a plan's cost.

1. A coarse search says in which branches and valleys of the energy one could go.
2. In each of these a linear step says where the elbow should be, knot by knot. The cheapest goes on: a network, which
   sees the closed form and what the next linear step would do, says what is still missing.
3. Between the knots the swivel is interpolated: the tool stays on its target whatever the elbow does.
4. What is outside the exact feasible arcs moves into the nearest one.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from functools import reduce
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.core import Tracer
from jaxtyping import Bool, Float, Int, PRNGKeyArray

from jaxik import energy as energies
from jaxik.arm import Arm, ArmModel
from jaxik.batches import cores
from jaxik.energy import Energy
from jaxik.model_file import model_content, model_from_content
from jaxik.staging import stage
from jaxik.targets import Target
from training import policy_files
from training.alignment import filled
from training.coarse_prices import Start
from training.elbow_charts import BranchCharts, ElbowCharts, elbow_charts, near, steps
from training.features import feature_count, path_features
from training.knots import KNOTS, knot_index, knots_for
from training.linear_step import linear_step
from training.network import WaypointNet
from training.projection import into_limits
from training.valleys import EXCESS, best_valleys, coarse

_KIND = "elbow-policy"
_CORRECTION = 0.3  # swivel that an output of one stands for [rad]
_DILATIONS = (1, 2, 4)  # knots: together they see half of a trained path
CANDIDATES = 6
LOOKS = 2
_NEVER = 1e9  # times the price: only where there is nothing else
AT_ONCE = 128  # paths worked on in one go: of 1024, which leave the processor's cache, each takes six times longer

Rows = tuple[Target, Array, Array, Array]  # targets and times of paths, the postures they come from and at which rate


class PolicyMotion(eqx.Module):
    """What the policy makes of paths.

    Attributes:
        swivel: ``(*batch, K)`` [rad], without jumps of a full turn.
        branch: ``(*batch, K)``; it changes where the motion passes an aligned shoulder or wrist.
        q: ``(*batch, K, joint)`` [rad].
        feasible: Whether the branches have a feasible swivel at every waypoint, ``(*batch,)``.
    """

    swivel: Float[Array, "*batch waypoint"]
    branch: Int[Array, "*batch waypoint"]
    q: Float[Array, "*batch waypoint joint"]
    feasible: Bool[Array, "*batch"]


class Outlook(NamedTuple):
    """What paths ask for, before the network is asked: nothing of it depends on weights.

    Attributes:
        charts: Of the branches chosen.
        branch: ``(K, B)``.
        begin: Swivels of the coarse search, ``(K, B)`` [rad].
        swivel: The same after a linear step, where that helps.
        step: The next linear step, ``(K, B)`` [rad].
        excess: Mean excess over the limits that the beginning has, ``(B,)`` [rad].
        features: What the network sees, ``(features, K, B)``.
        spare: The best beginning in one branch.
    """

    charts: BranchCharts
    branch: Array
    begin: Array
    swivel: Array
    step: Array
    excess: Array
    features: Array
    spare: "Course"


class Course(NamedTuple):
    """Swivels and branches ``(K, B)``, and what they cost, ``(B,)``."""

    price: Array
    swivel: Array
    branch: Array


class ElbowPolicy(eqx.Module):
    """A planner learned for one arm and one energy.

    Attributes:
        net: What is trained.
        arm: The arm it was trained for, in single precision.
        weight: Of the joints' motion in the energy, ``(joint,)``.
    """

    net: WaypointNet
    arm: Arm
    weight: Float[Array, "joint"]

    def outlook(self, charts: ElbowCharts, time_s: Array, start: Start, candidates: int = CANDIDATES) -> Outlook:
        """What B paths ask for, all their waypoints taken for knots.

        Args:
            charts: Of the paths at K knots.
            time_s: ``(K, B)`` [s].
            start: Where the arms come from.
            candidates: Valleys that are looked into.
        """
        arm, searched = self.arm, coarse(len(time_s))
        valleys = best_valleys(arm, charts.at(searched), time_s[searched], self.weight, start, candidates)

        def look(best: tuple[Course, Course], valley: tuple[Array, Array]) -> tuple[tuple[Course, Course], None]:
            """The best beginning and the best of those in one branch: from what was seen and one more."""
            swivel, branch = filled(charts, searched, *valley)
            chart = charts.of(branch)
            price = self._price(chart, chart.joints(swivel), swivel, time_s, start)
            for _ in range(LOOKS):
                step = linear_step(arm, chart, swivel, *chart.slopes(swivel), time_s, self.weight, start)
                after = self._price(chart, chart.joints(swivel + step), swivel + step, time_s, start)
                swivel = jnp.where(after < price, swivel + step, swivel)
                price = jnp.minimum(price, after)
            changes = jnp.any(branch != branch[:1], axis=0)
            mine = Course(price, swivel, branch), Course(jnp.where(changes, _NEVER * price, price), swivel, branch)
            return tuple(_cheaper(*pair) for pair in zip(mine, best, strict=True)), None  # pyright: ignore

        nowhere = jnp.zeros_like(time_s)
        nothing = Course(nowhere[0] + jnp.inf, nowhere, nowhere.astype(valleys[1].dtype))
        ((_, begin, branch), spare), _ = jax.lax.scan(look, (nothing, nothing), valleys)
        chart = charts.of(branch)

        def stepped(swivel: Array) -> tuple[tuple[Array, Array], Array, Array]:
            """Joints and slopes, their price, and the linear step from there."""
            q, slope = chart.slopes(swivel)
            price = self._price(chart, q, swivel, time_s, start)
            return (q, slope), price, linear_step(arm, chart, swivel, q, slope, time_s, self.weight, start)

        before, price, step = stepped(begin)
        after, better, second = stepped(begin + step)
        # Where joints do not go straight, a step may lead away; the network then has the beginning to go on from.
        good = better < price
        swivel = jnp.where(good, begin + step, begin)
        joints = jnp.where(good, after[0], before[0]), jnp.where(good, after[1], before[1])
        step = jnp.where(good, second, 0.0)
        seen = path_features(arm, chart, swivel, joints, step, time_s, self.weight, start)
        excess = jnp.mean(chart.excess(arm, before[0], begin), axis=0)
        return Outlook(chart, branch, begin, swivel, step, excess, seen, spare)

    def _price(self, charts: BranchCharts, q: Array, swivel: Array, time_s: Array, start: Start) -> Array:
        return _price(self.arm, charts, q, swivel, time_s, self.weight, start)

    def answer(self, outlook: Outlook) -> Array:
        """The swivels, ``(K, B)`` [rad].

        **Differentiability**: in the network's weights.
        """
        share, more = self.net(outlook.features)
        return outlook.swivel + (1.0 + share) * outlook.step + _CORRECTION * more

    def __call__(
        self,
        target: Target,
        time_s: Float[Array, "*batch waypoint"],
        start: Float[Array, "*batch joint"] | None = None,
        approach_s: Float[Array, ""] | float = 1.0,
        *,
        knots: int | None = None,
    ) -> PolicyMotion:
        """Motions along paths, within limits and keep-out.

        Args:
            target: K targets a path, leading axes ``(*batch, K)``.
            time_s: ``(*batch, K)`` [s].
            start: Postures the arms come from, ``(*batch, joint)`` [rad].
            approach_s: Time they have for it [s].
            knots: Waypoints at which the policy decides; None for one for every 0.3 of the arm's length or radian of
                the longest path, rounded up to 16, 32, 64 or 128, and for 16 inside a ``jit`` of yours.

        Returns:
            The motions, in single precision. In real time take the first waypoint and ask again.

        **Differentiability**: in the network's weights through :meth:`answer`; not through this.
        """
        traced = any(isinstance(x, Tracer) for x in jax.tree.leaves((self, target, time_s, start, approach_s)))
        if knots is None:
            knots = KNOTS if traced else knots_for(self.arm.length, target)
        knots, batch = min(knots, time_s.shape[-1]), time_s.shape[:-1]
        flat = lambda x, kept: jnp.asarray(x, jnp.float32).reshape(-1, *x.shape[x.ndim - kept :])  # noqa: E731
        target = jax.tree.map(lambda x: flat(x, x.ndim - len(batch)), target)
        times = flat(time_s, 1)
        begin = no_start(self.arm, len(times))
        if start is not None:
            rate = jnp.full(len(times), 1.0, jnp.float32) / jnp.asarray(approach_s, jnp.float32)
            begin = Start(flat(start, 1).T, rate)
        swivel, branch, q, feasible = self._all((target, times, begin.q.T, begin.rate), knots, traced)
        return PolicyMotion(
            swivel.reshape(time_s.shape),
            branch.reshape(time_s.shape),
            q.reshape(*time_s.shape, -1),
            feasible.reshape(batch),
        )

    def _all(self, rows: Rows, knots: int, traced: bool) -> tuple[Array, ...]:
        """Motions of flat rows, :data:`AT_ONCE` paths a part: each core has parts of its own, or they take turns."""
        count = len(rows[1])
        size = min(AT_ONCE, count)
        first = np.minimum(np.arange(0, count, size), count - size)  # the last part begins within the one before
        if traced:
            parts = list(
                zip(*jax.lax.map(lambda at: self._part(rows, at, size, knots), jnp.asarray(first)), strict=True)
            )
        else:
            with ThreadPoolExecutor(min(cores(), len(first))) as pool:
                part = lambda at: jax.block_until_ready(self._part(rows, at, size, knots))  # noqa: E731
                parts = list(pool.map(part, first))
        last = parts[-1] if len(parts) == 1 else jax.tree.map(lambda x: x[len(first) * size - count :], parts[-1])
        return jax.tree.map(lambda *x: jnp.concatenate(x), *parts[:-1], last)

    @eqx.filter_jit
    def _part(self, rows: Rows, first: Array, size: int, knots: int) -> tuple[Array, ...]:
        """Motions of some rows."""
        return self._some(jax.tree.map(lambda x: jax.lax.dynamic_slice_in_dim(x, first, size), rows), knots)

    def _some(self, rows: Rows, knots: int) -> tuple[Array, ...]:
        """Swivels ``(B, K)``, branches, joints ``(B, K, joint)`` and feasibility of some paths."""
        target, times, q, rate = rows
        waypoints = times.shape[1]
        index = knot_index(waypoints, knots)
        charts = elbow_charts(self.arm, target)
        come = Start(q.T, rate)
        outlook = self.outlook(charts.at(index), times.T[index], come)
        spare = outlook.spare.swivel, jnp.broadcast_to(outlook.spare.branch[:1], outlook.branch.shape)
        proposals = (self.answer(outlook), outlook.branch), (outlook.swivel + outlook.step, outlook.branch), spare

        def judged(swivel: Array, branch: Array) -> Course:
            """Between the knots, too."""
            swivel, branch = filled(charts, index, swivel, branch)
            chart = charts.of(branch)
            return Course(self._price(chart, chart.joints(swivel), swivel, times.T, come), swivel, branch)

        *others, alone = (judged(*proposal) for proposal in proposals)
        price, swivel, branch = reduce(_cheaper, (*others, alone))
        chart = charts.of(branch)
        step = linear_step(self.arm, chart, swivel, *chart.slopes(swivel), times.T, self.weight, come)
        after = self._price(chart, chart.joints(swivel + step), swivel + step, times.T, come)
        swivel = jnp.where(after < price, swivel + step, swivel)
        swivel, branch, q, feasible = into_limits(self.arm, target, charts, times.T, swivel, branch, alone.swivel)
        return swivel.T, branch.T, jnp.transpose(q, (2, 1, 0)), feasible


def _cheaper(a: Course, b: Course) -> Course:
    """The cheaper one of each path's two."""
    return jax.tree.map(lambda x, y: jnp.where(a.price < b.price, x, y), a, b)


@stage
def _price(arm: Arm, charts: BranchCharts, q: Array, swivel: Array, times: Array, weight: Array, start: Start) -> Array:
    """Joint motion, times one and the mean excess over limits, ``(B,)``."""
    rate = 1.0 / jnp.diff(times, axis=0)
    moved = jnp.sum(weight[:, None] * jnp.sum(steps(q) ** 2 * rate, axis=1), axis=0)
    coming = jnp.sum(weight[:, None] * near(q[:, 0] - start.q) ** 2, axis=0) * start.rate
    return (moved + coming) * (1.0 + EXCESS * jnp.mean(charts.excess(arm, q, swivel), axis=0))


def make_policy(key: PRNGKeyArray, arm: Arm, energy: Energy | None = None, width: int = 16) -> ElbowPolicy:
    """An untrained policy: it takes two linear steps from the coarse search's motion.

    Args:
        key: Of the random weights.
        arm: The arm.
        energy: What it is to make small; None for :func:`jaxik.energy.joint_motion`.
        width: Of the hidden layers.
    """
    arm = arm.astype(jnp.float32)
    energy = energies.joint_motion() if energy is None else energy
    weight = energy.motion_weight(arm)
    weight = jnp.where(jnp.max(weight) > 0, weight, jnp.ones_like(weight))
    net = WaypointNet(feature_count(arm), 2, width, _DILATIONS, key)
    return ElbowPolicy(net, arm, jnp.asarray(weight, jnp.float32))


def no_start(arm: Arm, count: int) -> Start:
    """Arms that come from nowhere."""
    return Start(jnp.zeros((arm.n_joints, count), arm.axes.dtype), jnp.zeros(count, arm.axes.dtype))


def save_policy(policy: ElbowPolicy, path: str | os.PathLike[str]) -> None:
    """Writes a policy with its arm; :func:`load_policy` gives the same bits back.

    Args:
        policy: The policy.
        path: File to write.

    Raises:
        OSError: It cannot be written.
    """
    model = ArmModel(policy.arm, tuple(f"joint_{i + 1}" for i in range(policy.arm.n_joints)), "", "")
    facts = {
        "arm": model_content(model),
        "weight": np.asarray(policy.weight, float).tolist(),
        "width": int(policy.net.first.shape[0]),
    }
    policy_files.write(path, _KIND, facts, policy.net)


def load_policy(path: str | os.PathLike[str]) -> ElbowPolicy:
    """Reads what :func:`save_policy` wrote.

    Args:
        path: The file.

    Returns:
        The policy with its arm.

    Raises:
        FileFormatError: Not such a file.
        OSError: It cannot be read.
    """
    header = policy_files.read_header(path, _KIND)
    arm = model_from_content(header["arm"]).arm
    like = make_policy(jax.random.key(0), arm, width=header["width"])
    net = policy_files.read(path, like.net)
    return ElbowPolicy(net, arm, jnp.asarray(header["weight"], jnp.float32))
