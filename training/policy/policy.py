"""The elbow policy: targets and present posture in, swivel and branch out, at about a thousandth of a plan's cost.

1. A coarse search says in which branches and valleys of the energy one could go, and linear steps in which of them to
   go, knot by knot (:mod:`jaxik.planning.fast.candidates`).
2. A network, which sees the closed form there and what the next linear step would do, says what is still missing.
3. Between the knots the swivel is interpolated: the tool stays on its target whatever the elbow does. Where the energy
   is joint motion alone, what the network says has to be better than what was there without it, and all waypoints take
   one more linear step.
4. What is outside the exact feasible arcs moves into the nearest one, and the path settles there
   (:mod:`jaxik.planning.fast.repair`).
"""

import os
from concurrent.futures import ThreadPoolExecutor

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.core import Tracer
from jaxtyping import Bool, Float, Int, PRNGKeyArray

from jaxik import energy as energies
from jaxik.arm import Arm, ArmModel, model_content, model_from_content
from jaxik.energy import Energy
from jaxik.energy.motion import JointMotion
from jaxik.ik import cores
from jaxik.planning.fast.branch_changes import filled
from jaxik.planning.fast.candidates import Outlook, Way, best_course, look_out
from jaxik.planning.fast.coarse_costs import Start
from jaxik.planning.fast.knots import KNOTS, knot_index, knots_for
from jaxik.planning.fast.path_batch import ElbowCharts, elbow_charts
from jaxik.planning.fast.repair import into_limits
from jaxik.planning.fast.settling import STEPS
from jaxik.targets import Target
from training import network_files as policy_files
from training.policy.features import feature_count
from training.policy.network import WaypointNet

_KIND = "elbow-policy"
_CORRECTION = 0.3  # swivel that an output of one stands for [rad]
_DILATIONS = (1, 2, 4)  # knots: together they see half of a trained path
CANDIDATES = 6  # valleys looked into: 4 lose a third as much again, 8 win little
AT_ONCE = 128  # paths worked on in one go: of 1024, which leave the processor's cache, each takes six times longer

Rows = tuple[Target, Array, Array, Array]  # targets and times of paths, the postures they come from and at which rate


class PolicyMotion(eqx.Module):
    """What the policy makes of paths.

    Attributes:
        swivel: ``(*batch, K)`` [rad], without jumps of a full turn.
        branch: ``(*batch, K)``; it changes where the motion passes an aligned shoulder or wrist.
        q: ``(*batch, K, joint)`` [rad].
        feasible: Whether the branches have a feasible swivel at every waypoint, ``(*batch,)``; where a target cannot be
            reached, or no branch serves the path, swivel and q are nan there.
    """

    swivel: Float[Array, "*batch waypoint"]
    branch: Int[Array, "*batch waypoint"]
    q: Float[Array, "*batch waypoint joint"]
    feasible: Bool[Array, "*batch"]


class ElbowPolicy(eqx.Module):
    """A planner learned for one arm and one energy.

    Attributes:
        net: What is trained.
        arm: The arm it was trained for, in single precision.
        weight: Of the joints' motion in the energy, ``(joint,)``.
        motion_alone: Whether that is all there is in the energy, so that motions can be judged by it.
    """

    net: WaypointNet
    arm: Arm
    weight: Float[Array, "joint"]
    motion_alone: bool = eqx.field(static=True, default=True)

    def outlook(self, charts: ElbowCharts, time: Array, start: Start, candidates: int = CANDIDATES) -> Outlook:
        """What B paths ask for, all their waypoints taken for knots, see :func:`training.outlook.look_out`."""
        return look_out(self.arm, charts, time, self.weight, start, candidates)

    def answer(self, outlook: Outlook) -> Array:
        """The swivels, ``(K, B)`` [rad].

        **Differentiability**: in the network's weights.
        """
        share, more = self.net(outlook.features)
        return outlook.swivel + (1.0 + share) * outlook.step + _CORRECTION * more

    def __call__(
        self,
        target: Target,
        time: Float[Array, "*batch waypoint"],
        start: Float[Array, "*batch joint"] | None = None,
        approach_time: Float[Array, ""] | float = 1.0,
        *,
        knots: int | None = None,
        candidates: int = CANDIDATES,
    ) -> PolicyMotion:
        """Motions along paths, within limits and keep-out.

        Args:
            target: K targets a path, leading axes ``(*batch, K)``.
            time: ``(*batch, K)`` [s].
            start: Postures the arms come from, ``(*batch, joint)`` [rad].
            approach_time: Time they have for it [s].
            knots: Waypoints at which the policy decides; None for one for every 0.3 of the arm's length or radian of
                the longest path, rounded up to 16, 32, 64 or 128, and for 16 inside a ``jit`` of yours.
            candidates: Valleys that are looked into, at most 16: fewer are faster, more miss fewer good ones.

        Returns:
            The motions, in single precision. In real time take the first waypoint and ask again.

        **Differentiability**: in the network's weights through :meth:`answer`; not through this.
        """
        traced = any(isinstance(x, Tracer) for x in jax.tree.leaves((self, target, time, start, approach_time)))
        if knots is None:
            knots = KNOTS if traced else knots_for(self.arm.length, target)
        knots, batch = min(knots, time.shape[-1]), time.shape[:-1]
        flat = lambda x, kept: jnp.asarray(x, jnp.float32).reshape(-1, *x.shape[x.ndim - kept :])  # noqa: E731
        target = jax.tree.map(lambda x: flat(x, x.ndim - len(batch)), target)
        times = flat(time, 1)
        begin = no_start(self.arm, len(times))
        if start is not None:
            rate = jnp.full(len(times), 1.0, jnp.float32) / jnp.asarray(approach_time, jnp.float32)
            begin = Start(flat(start, 1).T, rate)
        swivel, branch, q, feasible = self._all((target, times, begin.q.T, begin.rate), (knots, candidates), traced)
        return PolicyMotion(
            swivel.reshape(time.shape),
            branch.reshape(time.shape),
            q.reshape(*time.shape, -1),
            feasible.reshape(batch),
        )

    def _all(self, rows: Rows, choice: tuple[int, int], traced: bool) -> tuple[Array, ...]:
        """Motions of flat rows, :data:`AT_ONCE` paths a part: each core has parts of its own, or they take turns."""
        count = len(rows[1])
        size = min(AT_ONCE, count)
        first = np.minimum(np.arange(0, count, size), count - size)  # the last part begins within the one before
        if traced:
            parts = list(
                zip(*jax.lax.map(lambda at: self._part(rows, at, size, choice), jnp.asarray(first)), strict=True)
            )
        else:
            with ThreadPoolExecutor(min(cores(), len(first))) as pool:
                part = lambda at: jax.block_until_ready(self._part(rows, at, size, choice))  # noqa: E731
                parts = list(pool.map(part, first))
        last = parts[-1] if len(parts) == 1 else jax.tree.map(lambda x: x[len(first) * size - count :], parts[-1])
        return jax.tree.map(lambda *x: jnp.concatenate(x), *parts[:-1], last)

    @eqx.filter_jit
    def _part(self, rows: Rows, first: Array, size: int, choice: tuple[int, int]) -> tuple[Array, ...]:
        """Motions of some rows."""
        return self._some(jax.tree.map(lambda x: jax.lax.dynamic_slice_in_dim(x, first, size), rows), *choice)

    def _some(self, rows: Rows, knots: int, candidates: int) -> tuple[Array, ...]:
        """Swivels ``(B, K)``, branches, joints ``(B, K, joint)`` and feasibility of some paths."""
        target, times, q, rate = rows
        waypoints = times.shape[1]
        index = knot_index(waypoints, knots)
        charts = elbow_charts(self.arm, target)
        come = Start(q.T, rate)
        outlook = self.outlook(charts.at(index), times.T[index], come, candidates)
        course = filled(charts, index, self.answer(outlook), outlook.branch)
        spare = filled(charts, index, *outlook.spare)
        if self.motion_alone:
            cautious = filled(charts, index, outlook.swivel + outlook.step, outlook.branch)
            course = best_course(self.arm, charts, (course, cautious, spare), times.T, self.weight, come)

        def others(row: Array, number: Array) -> Way:
            """What else a path could do: the best motion in one branch, then all candidates."""
            join = lambda x, xs: jnp.concatenate([x[None], xs])[number, :, row]  # noqa: E731
            way = jax.tree.map(join, outlook.spare, outlook.valleys)
            swivel, branch = filled(charts.of_paths(row[None]), index, *(x[:, None] for x in way))
            return swivel[:, 0], branch[:, 0]

        steps = STEPS if self.motion_alone else 0
        here = self.arm, target, charts, times.T
        swivel, branch, q, feasible = into_limits(*here, course, others, candidates + 1, self.weight, come, steps)
        return swivel.T, branch.T, jnp.transpose(q, (2, 1, 0)), feasible


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
    motion_alone = all(isinstance(term, JointMotion) for term in energy.terms)
    weight = jnp.where(jnp.max(weight) > 0, weight, jnp.ones_like(weight))
    net = WaypointNet(feature_count(arm), 2, width, _DILATIONS, key)
    return ElbowPolicy(net, arm, jnp.asarray(weight, jnp.float32), motion_alone)


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
        "motion_alone": policy.motion_alone,
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
    return ElbowPolicy(net, arm, jnp.asarray(header["weight"], jnp.float32), header["motion_alone"])
