"""Training of the elbow policy: first without labels, by energy through the closed form, then from plans to imitate."""

import os
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.sharding import Mesh
from jaxtyping import PRNGKeyArray

from jaxik import energy as energies
from jaxik.arm import Arm, ArmModel, as_arm, presets
from jaxik.energy import Energy
from jaxik.ik import solve_ik
from jaxik.paths import Path
from jaxik.planning import SwivelMotion, least_energy_motion
from jaxik.planning.fast import KNOTS, Candidate, StartPostures
from jaxik.targets import Target
from training.examples import Examples
from training.loop import Fitted, LoopConfig, fit
from training.policy.losses import Example, energy_loss, example, imitation_loss
from training.policy.policy import ElbowPolicy, make_policy
from training.policy.random_paths import random_paths

_SEARCHED = 32  # waypoints that the search of a plan to imitate sees
_NORMALIZED = 4  # batches from whose features mean and spread are taken
_TO_PLAN = -(1 << 30)  # first row to plan; rows below zero are not trained on by energy
_STARTED = 0.25  # share of paths with a posture that the arm comes from
_OFF = 0.05  # its distance from the first target, each joint [rad]
_APPROACH_TIMES = (0.1, 2.0)  # for the approach from it, on a logarithmic scale [s]
_LEAST_RATE = 1e-6  # of an approach that does not count [1/s]


@dataclass(frozen=True)
class PolicyConfig:
    """Settings of the training of an elbow policy; the defaults take 80 s of processor time, half of it compiling.

    Attributes:
        seed: Seed of the weights, paths and starts: one seed, one policy, bit for bit.
        width: Width of the hidden layers.
        loop: Settings of the training by energy.
        plans: Number of plans to imitate afterwards; 0 for none.
        imitation: Settings of that training; every batch adds as many fresh paths judged by energy.
        weight: Weight of the imitation's squared swivel difference [1/rad²].
        validation_rows: Number of held-out paths for early stopping.
        folder: Folder for checkpoints and metrics; None for none.
    """

    seed: int = 0
    width: int = 16
    loop: LoopConfig = field(default_factory=lambda: LoopConfig(steps=300, batch=128, validate_every=50))
    plans: int = 64
    imitation: LoopConfig = field(
        default_factory=lambda: LoopConfig(steps=60, batch=128, learning_rate=5e-4, validate_every=30)
    )
    weight: float = 0.1
    validation_rows: int = 256
    folder: str | os.PathLike[str] | None = None

    def sized(self, steps: int | None = None, plans: int | None = None) -> "PolicyConfig":
        """Return the settings with other numbers.

        Args:
            steps: Number of steps of the training by energy; None leaves it.
            plans: Number of plans to imitate; None leaves it.
        """
        loop = self.loop if steps is None else replace(self.loop, steps=steps)
        return replace(self, loop=loop, plans=self.plans if plans is None else plans)


@dataclass(frozen=True)
class Trained:
    """A trained policy and its training curves.

    Attributes:
        policy: The policy.
        by_energy: Curves of the training by energy.
        by_plans: Curves of the imitation; None without.
    """

    policy: ElbowPolicy
    by_energy: Fitted[Any]
    by_plans: Fitted[Any] | None


def train(
    config: PolicyConfig | None = None,
    *,
    arm: Arm | ArmModel | None = None,
    energy: Energy | None = None,
    mesh: Mesh | None = None,
    progress: Callable[[str, float], None] = lambda stage, share: None,
) -> Trained:
    """Train an elbow policy for an arm and an energy.

    Args:
        config: Settings; None for the defaults.
        arm: The arm; None for :func:`jaxik.presets.iiwa14`.
        energy: Energy to minimize; None for :func:`jaxik.energy.joint_motion`.
        mesh: Devices that share the work, see :func:`training.data_mesh`; None for one.
        progress: Called with the stage and the fraction of it done.

    Returns:
        The policy and its curves.

    Raises:
        ValueError: The batch does not divide among the devices, or the folder holds another training.
        FloatingPointError: The loss is no longer a number.
    """
    config = PolicyConfig() if config is None else config
    bare = as_arm(presets.iiwa14() if arm is None else arm).astype(jnp.float32)
    energy = energies.joint_motion() if energy is None else energy
    energy.check(bare)
    weights, data = jax.random.split(jax.random.key(config.seed))
    blank = make_policy(bare, key=weights, energy=energy, width=config.width)

    def make(rows: Array) -> Example:
        return example(blank, energy, rows, *batch(data, bare, rows))

    here = Examples(make)
    everywhere = here if mesh is None else Examples(make, mesh)
    policy = _with(blank, blank.net.normalized(_features(here, config.loop.batch)))

    def loss(net: Any, of: Example) -> tuple[Array, Array]:
        return energy_loss(_with(policy, net), energy, of)

    first = fit(
        policy.net,
        loss,
        config.loop.stored(config.folder, "energy"),
        examples=everywhere,
        validation_rows=config.validation_rows,
        progress=lambda share: progress("by energy", share),
    )
    policy = _with(policy, first.params)
    if not config.plans:
        return Trained(policy, first, None)
    progress("plans", 0.0)
    taught = _plans(here, bare, energy, config, lambda share: progress("plans", share))

    def both(net: Any, of: Example) -> tuple[Array, Array]:
        total, count = loss(net, of)
        lesson = jax.tree.map(lambda x: x[of.rows[0] // len(of.rows) % len(taught.branch)], taught)
        apart, same = imitation_loss(_with(policy, net), *lesson)
        return total + config.weight * apart * count / jnp.maximum(same, 1.0), count

    second = fit(
        policy.net,
        both,
        config.imitation.stored(config.folder, "plans"),
        examples=everywhere,
        validation=loss,
        validation_rows=config.validation_rows,
        progress=lambda share: progress("from plans", share),
    )
    return Trained(_with(policy, second.params), first, second)


def batch(key: PRNGKeyArray, arm: Arm, rows: Array, waypoints: int = KNOTS) -> tuple[Path, StartPostures]:
    """Return the paths and starts with some numbers of a seed's endless list.

    Some of the paths have a start: a posture near the first target, with the elbow anywhere.
    """
    paths = random_paths(key, arm, rows, waypoints)

    def start(row: Array, first: Target) -> tuple[Array, Array]:
        given, turn, which, off, pace = jax.random.split(jax.random.fold_in(jax.random.fold_in(key, row), 1), 5)
        dtype = arm.axes.dtype
        solution = solve_ik(arm, first, jax.random.uniform(turn, (), dtype, -jnp.pi, jnp.pi))
        inside = jnp.where(solution.ok, 1.0, 1e-3)
        q = solution.q[jax.random.categorical(which, jnp.log(inside))]
        q = jnp.clip(q + _OFF * jax.random.normal(off, q.shape, dtype), arm.lower, arm.upper)
        low, high = np.log(_APPROACH_TIMES)
        rate = jnp.exp(-jax.random.uniform(pace, (), dtype, low, high))
        return q, jnp.where(jax.random.bernoulli(given, _STARTED), rate, 0.0)

    q, rate = jax.vmap(start)(rows, jax.tree.map(lambda x: x[:, 0], paths.target))
    return paths, StartPostures(q.T, rate)


class Lessons(NamedTuple):
    """Plans to imitate, in groups along the first axis.

    Attributes:
        candidate: Best candidates of the planned paths.
        features: Their features, ``(group, features, K, B)``.
        swivel: Swivels of the plans, ``(group, K, B)`` [rad].
        branch: Branches of the plans, ``(group, K, B)``; -1 where there is none.
    """

    candidate: Candidate
    features: Array
    swivel: Array
    branch: Array


def _features(examples: Examples, rows: int) -> Array:
    """Features of some batches, ``(features, K, B)``."""
    seen = [examples(first, rows).features for first in range(0, _NORMALIZED * rows, rows)]
    return jnp.concatenate([group for batch in seen for group in batch], axis=-1)


def _plans(
    examples: Examples, arm: Arm, energy: Energy, config: PolicyConfig, progress: Callable[[float], None]
) -> Lessons:
    """Plans to imitate, in groups like those of the examples."""
    parts = [examples(_TO_PLAN + first, config.loop.batch) for first in range(0, config.plans, config.loop.batch)]
    of: Example = jax.tree.map(lambda *x: jnp.concatenate(x), *parts)
    groups = -(-config.plans // of.rows.shape[1])
    of = jax.tree.map(lambda x: x[:groups], of)
    rows = of.rows.reshape(-1)
    plans = planned(arm, energy, *batch(jax.random.split(jax.random.key(config.seed))[1], arm, rows), progress)
    found = plans.ok & plans.converged & (jnp.arange(len(plans.energy)) < config.plans)
    branch = jnp.where(found[:, None], plans.branch, -1)  # no plan, nothing to imitate

    def grouped(x: Array) -> Array:
        return jnp.swapaxes(x.reshape(groups, -1, x.shape[-1]), 1, 2)

    swivel = grouped(jnp.nan_to_num(plans.swivel).astype(jnp.float32))
    return Lessons(of.candidate, of.features, swivel, grouped(branch))


def planned(
    arm: Arm,
    energy: Energy,
    paths: Path,
    start: StartPostures,
    progress: Callable[[float], None],
    at_once: int = 32,
) -> SwivelMotion:
    """Plan motions along paths, some at a time."""

    @jax.jit
    def some(target: Any, time: Array, q: Array, approach_time: Array) -> SwivelMotion:
        def one(row: tuple[Any, ...]) -> SwivelMotion:
            target, time, q, approach_time = row
            ends = {"start": q, "approach_time": approach_time}
            return least_energy_motion(arm64, target, time, energy=energy, search=_SEARCHED, **ends)

        return jax.lax.map(one, (target, time, q, approach_time))

    # In double precision where the process has it: the refinement then ends at the minimum, not at rounding.
    dtype = jnp.result_type(float)
    arm64 = arm.astype(dtype)
    approach = 1.0 / jnp.maximum(start.rate, _LEAST_RATE)
    rows = jax.tree.map(lambda x: x.astype(dtype), (paths.target, paths.time, start.q.T, approach))
    count = paths.time.shape[0]
    parts = []
    for first in range(0, count, at_once):
        index = np.minimum(np.arange(first, first + at_once), count - 1)
        parts.append(jax.device_get(some(*jax.tree.map(lambda x, i=index: x[i], rows))))
        progress(min(1.0, (first + at_once) / count))
    return jax.tree.map(lambda *x: jnp.asarray(np.concatenate(x)[:count]), *parts)


def _with(policy: ElbowPolicy, net: Any) -> ElbowPolicy:
    return eqx.tree_at(lambda p: p.net, policy, net)
