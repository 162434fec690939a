"""The elbow policy: targets and present posture in, swivel and branch out, at a thousandth of a plan's cost.

1. The closed form prices a few constant swivels in every branch; the cheapest is where to begin.
2. A network that sees the closed form turned to that swivel says where else the elbow should be, knot by knot; a second
   one looks again from there.
3. Between the knots the swivel is interpolated: the tool stays on its target whatever the elbow does.
4. What is outside the exact feasible arcs moves into the nearest one.
"""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Int, PRNGKeyArray

from jaxik import energy as energies
from jaxik.arm import Arm
from jaxik.energy import Energy
from jaxik.swivel import swivel_of
from jaxik.targets import Target
from training.elbow_charts import BranchCharts, elbow_charts, near
from training.features import path_features
from training.network import WaypointNet
from training.prices import EXCESS, Start, constant_prices
from training.projection import into_limits

CANDIDATES = 16  # constant swivels priced, 22.5 degrees apart: what lies between them is the network's part
PRICED_EVERY = 2  # knots: prices need no more
CORRECTION = 0.5  # swivel that an output of one stands for [rad]
KNOTS = 32


class PolicyMotion(eqx.Module):
    """What the policy makes of paths.

    Attributes:
        swivel: ``(*batch, K)`` [rad], without jumps of a full turn.
        branch: One for each path, ``(*batch,)``.
        q: ``(*batch, K, joint)`` [rad].
        feasible: Whether the branch has a feasible swivel at every waypoint, ``(*batch,)``.
    """

    swivel: Float[Array, "*batch waypoint"]
    branch: Int[Array, "*batch"]
    q: Float[Array, "*batch waypoint joint"]
    feasible: Bool[Array, "*batch"]


class Proposal(NamedTuple):
    """The policy's answer at the knots.

    Attributes:
        charts: Of the branches chosen.
        branch: ``(B,)``.
        swivels: At the beginning and after each network, ``(K, B)`` each.
        excess: Mean excess over the limits that the beginning has, ``(B,)`` [rad].
    """

    charts: BranchCharts
    branch: Array
    swivels: list[Array]
    excess: Array


class ElbowPolicy(eqx.Module):
    """A planner learned for one arm and one energy.

    Attributes:
        nets: What is trained: one network for each look at the path.
        arm: The arm it was trained for, in single precision.
        weight: Of the joints' motion in the energy, ``(joint,)``.
    """

    nets: list[WaypointNet]
    arm: Arm
    weight: Float[Array, "joint"]

    def propose(self, target: Target, time_s: Array, start: Start) -> Proposal:
        """Swivels and branches at all waypoints of B paths, taken for knots.

        Args:
            target: Leading axes ``(B, K)``.
            time_s: ``(B, K)`` [s].
            start: Where the arms come from.
        """
        arm, times = self.arm, time_s.T
        charts = elbow_charts(arm, target)
        knots = times.shape[0]
        priced = np.unique(np.append(np.arange(0, knots, PRICED_EVERY), knots - 1))
        candidates = self._candidates(start)
        prices, excess = constant_prices(arm, charts.at(priced), times[priced], candidates, self.weight, start)
        best = jnp.argmin(prices.reshape(-1, prices.shape[-1]), axis=0)
        branch, place = best // len(candidates), best % len(candidates)
        chosen = charts.of(branch)
        swivel = jnp.broadcast_to(jnp.take_along_axis(candidates, place[None], 0), times.shape)
        swivels = [swivel]
        for net in self.nets:
            seen = jax.lax.stop_gradient(path_features(arm, chosen, swivel, times, self.weight, start))
            swivel = swivel + CORRECTION * net(seen)[0]
            swivels.append(swivel)
            swivel = jax.lax.stop_gradient(swivel)
        at_best = jnp.take_along_axis(excess.reshape(-1, excess.shape[-1]), best[None], 0)[0]
        return Proposal(chosen, branch, swivels, at_best)

    def _candidates(self, start: Start) -> Array:
        """Constant swivels to price, ``(S, B)``: a grid, and the start's own."""
        grid = jnp.linspace(-jnp.pi, jnp.pi, CANDIDATES, endpoint=False, dtype=start.q.dtype)
        own, _ = swivel_of(self.arm, start.q.T)
        return jnp.concatenate([jnp.broadcast_to(grid[:, None], (CANDIDATES, len(own))), own[None]])

    @eqx.filter_jit
    def __call__(
        self,
        target: Target,
        time_s: Float[Array, "*batch waypoint"],
        start: Float[Array, "*batch joint"] | None = None,
        approach_s: Float[Array, ""] | float = 1.0,
        *,
        knots: int = KNOTS,
    ) -> PolicyMotion:
        """Motions along paths, within limits and keep-out.

        Args:
            target: K targets a path, leading axes ``(*batch, K)``.
            time_s: ``(*batch, K)`` [s].
            start: Postures the arms come from, ``(*batch, joint)`` [rad].
            approach_s: Time they have for it [s].
            knots: Waypoints at which the network decides; about one for every 0.1 of the arm's length or radian.

        Returns:
            The motions, in single precision. In real time take the first waypoint and ask again.

        **Differentiability**: in the networks' weights through :meth:`propose`; not through this.
        """
        batch, waypoints = time_s.shape[:-1], time_s.shape[-1]
        flat = lambda x, kept: jnp.asarray(x, jnp.float32).reshape(-1, *x.shape[x.ndim - kept :])  # noqa: E731
        target = jax.tree.map(lambda x: flat(x, x.ndim - len(batch)), target)
        times = flat(time_s, 1)
        begin = no_start(self.arm, len(times))
        if start is not None:
            rate = jnp.full(len(times), 1.0, jnp.float32) / jnp.asarray(approach_s, jnp.float32)
            begin = Start(flat(start, 1).T, rate)
        index = np.unique(np.linspace(0, waypoints - 1, min(knots, waypoints)).round().astype(int))
        proposal = self.propose(jax.tree.map(lambda x: x[:, index], target), times[:, index], begin)
        swivel = interpolation(index, waypoints) @ proposal.swivels[-1]
        swivel, branch, q, feasible = into_limits(self.arm, target, swivel, proposal.branch)
        return PolicyMotion(
            swivel.T.reshape(time_s.shape),
            branch.reshape(batch),
            jnp.transpose(q, (2, 1, 0)).reshape(*time_s.shape, -1),
            feasible.reshape(batch),
        )


def make_policy(
    key: PRNGKeyArray, arm: Arm, energy: Energy | None = None, width: int = 32, looks: int = 1
) -> ElbowPolicy:
    """An untrained policy: it keeps the swivel at the cheapest constant.

    Args:
        key: Of the random weights.
        arm: The arm.
        energy: What it is to make small; None for :func:`jaxik.energy.joint_motion`.
        width: Of the hidden layers.
        looks: How many networks look at the path, one after the other.
    """
    arm = arm.astype(jnp.float32)
    energy = energies.joint_motion() if energy is None else energy
    weight = energy.motion_weight(arm)
    weight = jnp.where(jnp.max(weight) > 0, weight, jnp.ones_like(weight))
    count = 24 + (6 if arm.n_joints == 7 else 0) + 8 + 3 * arm.n_joints + len(arm.keep_out.offset)
    nets = [WaypointNet(count, 1, width, (1, 2, 4, 8), k) for k in jax.random.split(key, looks)]
    return ElbowPolicy(nets, arm, jnp.asarray(weight, jnp.float32))


def no_start(arm: Arm, count: int) -> Start:
    """Arms that come from nowhere."""
    return Start(jnp.zeros((arm.n_joints, count), arm.axes.dtype), jnp.zeros(count, arm.axes.dtype))


def interpolation(index: np.ndarray, waypoints: int) -> Array:
    """Matrix from values at knots to values at all waypoints, Catmull-Rom, ``(waypoints, knots)``."""
    if len(index) == waypoints:
        return jnp.eye(waypoints, dtype=jnp.float32)
    at, knots = np.arange(waypoints), np.eye(len(index))
    padded = np.concatenate([2 * knots[:1] - knots[1:2], knots, 2 * knots[-1:] - knots[-2:-1]])
    left = np.clip(np.searchsorted(index, at, side="right") - 1, 0, len(index) - 2)
    u = ((at - index[left]) / (index[left + 1] - index[left]))[:, None]
    a, b, c, d = (padded[left + i] for i in range(4))
    matrix = b + u * (c - a) / 2 + u**2 * (2 * a - 5 * b + 4 * c - d) / 2 + u**3 * (3 * (b - c) + d - a) / 2
    return jnp.asarray(matrix, jnp.float32)
