"""The elbow policy: targets and present posture in, swivel and branch out, at less than a hundredth of a plan's cost.

1. The closed form prices a few constant swivels in every branch; the cheapest is where to begin.
2. A network that sees the closed form turned to that swivel says where else the elbow should be, knot by knot; a second
   one looks again from there.
3. Between the knots the swivel is interpolated: the tool stays on its target whatever the elbow does.
4. What is outside the exact feasible arcs moves into the nearest one.
"""

import os
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Int, PRNGKeyArray

from jaxik import energy as energies
from jaxik.arm import Arm, ArmModel
from jaxik.energy import Energy
from jaxik.model_file import model_content, model_from_content
from jaxik.swivel import swivel_of
from jaxik.targets import Target
from training import policy_files
from training.elbow_charts import BranchCharts, elbow_charts, near
from training.features import path_features
from training.network import WaypointNet
from training.prices import EXCESS, Start, constant_prices
from training.projection import into_limits

_KIND = "elbow-policy"
CANDIDATES = 16  # constant swivels priced, 22.5 degrees apart: what lies between them is the network's part
PRICED_EVERY = 2  # knots: prices need no more
CORRECTION = 0.5  # swivel that an output of one stands for [rad]
KNOTS = 32
DISTINCT = 0.9  # of two beams of a path, so that they are not in one valley [rad]


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
        beams: Candidates that the networks look at; the cheapest of what they make of them is the answer.
    """

    nets: list[WaypointNet]
    arm: Arm
    weight: Float[Array, "joint"]
    beams: int = eqx.field(static=True, default=1)

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
        flat, count = prices.reshape(-1, prices.shape[-1]), len(candidates)
        bit = jnp.repeat((jnp.arange(8) >> 1 & 1).astype(times.dtype), count)[:, None]
        plane = jnp.tile(candidates, (8, 1)) - jnp.pi * bit
        beams = []
        for _ in range(self.beams):
            best = jnp.argmin(flat, axis=0)
            beams.append(best)
            own = jnp.take_along_axis(plane, best[None], 0)
            flat = jnp.where(jnp.abs(near(plane - own)) < DISTINCT, jnp.inf, flat)
        best = jnp.concatenate(beams)
        repeated = lambda x: jnp.tile(x, (1,) * (x.ndim - 1) + (self.beams,))  # noqa: E731
        times, candidates = repeated(times), repeated(candidates)
        start = Start(repeated(start.q), repeated(start.rate))
        charts = charts._replace(
            **{n: repeated(getattr(charts, n)) for n in ("shoulder", "wrist", "elbow", "keep_out")}
        )
        branch, place = best // count, best % count
        chosen = charts.of(branch)
        swivel = jnp.broadcast_to(jnp.take_along_axis(candidates, place[None], 0), times.shape)
        swivels = [swivel]
        for net in self.nets:
            seen = jax.lax.stop_gradient(path_features(arm, chosen, swivel, times, self.weight, start))
            swivel = swivel + CORRECTION * net(seen)[0]
            swivels.append(swivel)
            swivel = jax.lax.stop_gradient(swivel)
        at_best = jnp.take_along_axis(repeated(excess.reshape(-1, excess.shape[-1])), best[None], 0)[0]
        return Proposal(chosen, branch, swivels, at_best)

    def _candidates(self, start: Start) -> Array:
        """Constant swivels to price, ``(S, B)``: a grid, and the start's own."""
        grid = jnp.linspace(-jnp.pi, jnp.pi, CANDIDATES, endpoint=False, dtype=start.q.dtype)
        own, _ = swivel_of(self.arm, start.q.T)
        return jnp.concatenate([jnp.broadcast_to(grid[:, None], (CANDIDATES, len(own))), own[None]])

    def cheapest(self, proposal: Proposal, times: Array, start: Start) -> tuple[Array, Array]:
        """Of every path's beams the one of least joint motion and excess: swivels ``(K, B)`` and branches ``(B,)``."""
        beams, last = self.beams, proposal.swivels[-1]
        if beams == 1:
            return last, proposal.branch
        q = proposal.charts.joints(last)
        excess = jnp.mean(proposal.charts.excess(self.arm, q, last), axis=0)
        step = jnp.diff(q, axis=1)
        turning = (self.arm.upper - self.arm.lower >= 2 * jnp.pi * (1 - 1e-6))[:, None, None]
        step = jnp.where(turning, near(step), step)
        tile = lambda x: jnp.tile(x, (1,) * (x.ndim - 1) + (beams,))  # noqa: E731
        rate = 1.0 / jnp.diff(tile(times), axis=0)
        motion = jnp.sum(jnp.sum(step**2 * rate, axis=1) * self.weight[:, None], axis=0)
        coming = jnp.sum(self.weight[:, None] * near(q[:, 0] - tile(start.q)) ** 2, axis=0) * tile(start.rate)
        price = ((motion + coming) * (1.0 + EXCESS * excess)).reshape(beams, -1)
        pick = jnp.argmin(price, axis=0)

        def take(x: Array) -> Array:
            """The rows ``(..., B)`` of the beams picked, from ``(..., beams * B)``."""
            parts = x.reshape(*x.shape[:-1], beams, -1)
            return jnp.take_along_axis(parts, pick.reshape((1,) * (x.ndim - 1) + (1, -1)), -2)[..., 0, :]

        return take(last), take(proposal.branch)

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
        chosen_swivel, branch = self.cheapest(proposal, times[:, index].T, begin)
        swivel = interpolation(index, waypoints) @ chosen_swivel
        swivel, branch, q, feasible = into_limits(self.arm, target, swivel, branch)
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
        "width": int(policy.nets[0].first.shape[0]),
        "looks": len(policy.nets),
        "beams": policy.beams,
    }
    policy_files.write(path, _KIND, facts, policy.nets)


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
    like = make_policy(jax.random.key(0), arm, width=header["width"], looks=header["looks"])
    nets = policy_files.read(path, like.nets)
    return ElbowPolicy(nets, arm, jnp.asarray(header["weight"], jnp.float32), header["beams"])
