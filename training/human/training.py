"""Training a natural elbow on a recording of a person's arm, and what simpler rules would say of the same frames."""

import os
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.sharding import Mesh

from jaxik.targets import Pose
from training.human.data import HumanFrames, human_arm
from training.human.natural_elbow import (
    FEATURES,
    NaturalElbow,
    across,
    elbow_circle,
    hand_features,
    make_networks,
    unit,
)
from training.loop import Fitted, LoopConfig, fit
from training.policy.network import WaypointNet

_NOISE = 0.2  # on features of spread one: neighboring frames are nearly equal, and must not be learned by heart
_ROUND = 1e-2  # smooths the length of an error at zero; lengths are about one


@dataclass(frozen=True)
class HumanConfig:
    """How to train a natural elbow.

    Attributes:
        seed: Of weights and samples.
        members: Networks that vote.
        width: Of their two layers.
        held_out: Share of the frames, at the end of the recording, that is for evaluation alone.
        loop: Of the training.
    """

    seed: int = 0
    members: int = 16
    width: int = 64
    held_out: float = 0.2
    loop: LoopConfig = field(
        default_factory=lambda: LoopConfig(
            steps=1000, learning_rate=2e-3, weight_decay=1e-3, validate_every=100, patience=6
        )
    )

    def stored(self, folder: str | os.PathLike[str] | None) -> "HumanConfig":
        """The same with checkpoints and metrics in a folder."""
        return self if folder is None else replace(self, loop=self.loop.stored(folder, "human"))


@dataclass(frozen=True)
class HumanScore:
    """Elbow errors on held-out frames, in percent of the recording's length unit, which is about a straight arm.

    Attributes:
        median: Half of the frames are better.
        p90: Nine tenths are.
    """

    median: float
    p90: float


@dataclass(frozen=True)
class HumanTrained:
    """A natural elbow and how good it is.

    Attributes:
        policy: The policy.
        curves: Of its training.
        scores: By name: the policy, and what simpler rules reach; ``floor`` is the frames' own swivel on the fitted
            lengths.
    """

    policy: NaturalElbow
    curves: Fitted[WaypointNet]
    scores: dict[str, HumanScore]


def train_human(
    frames: HumanFrames,
    config: HumanConfig | None = None,
    *,
    mesh: Mesh | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> HumanTrained:
    """Trains a natural elbow on the beginning of a recording and evaluates it on the rest.

    Frames are divided by time, never at random: neighbors are nearly equal.

    Args:
        frames: The recording.
        config: How; None for the defaults.
        mesh: Devices that share the work; None for one.
        progress: Is told the share done.

    Returns:
        Policy, curves and scores.

    Raises:
        ValueError: Nothing is left to train or to evaluate on.
    """
    config = HumanConfig() if config is None else config
    known = round(frames.count * (1 - config.held_out))
    if not 10 <= known < frames.count:
        raise ValueError(f"held_out={config.held_out:g} leaves {known} of {frames.count} frames to train on")
    arm = human_arm(frames[:known]).arm
    weights, samples = jax.random.split(jax.random.key(config.seed))
    hand, turn = jnp.asarray(frames.hand[:known]), jnp.asarray(frames.rotation[:known])
    seen = hand_features(arm, hand, turn).astype(jnp.float32)
    nets = make_networks(weights, config.members, config.width)
    nets = eqx.filter_vmap(lambda net: net.normalized(seen[:, None]))(nets)
    policy = NaturalElbow(nets, arm)
    center, cos, _ = elbow_circle(arm, Pose(hand, turn))
    radius = jnp.linalg.norm(cos, axis=-1, keepdims=True)
    columns = (unit(hand), center, radius, jnp.asarray(frames.elbow[:known]))
    data = (seen, *(x.T.astype(jnp.float32) for x in columns))

    def error(nets: WaypointNet, row: Array, member: Array) -> Array:
        """Of one network on one frame that the row's number picks."""
        features, *circle = data
        which, noise = jax.random.split(jax.random.fold_in(jax.random.fold_in(samples, row), member))
        i = jax.random.randint(which, (), 0, known)
        x = features[:, i] + _NOISE * nets.scale[:, 0] * jax.random.normal(noise, (FEATURES,), jnp.float32)
        return _distance(nets(x[:, None, None])[:, 0, 0], *(part[:, i] for part in circle))

    def loss(nets: WaypointNet, rows: Array) -> tuple[Array, Array]:
        members = jnp.arange(config.members)
        each = jax.vmap(lambda net, m: jnp.sum(jax.vmap(lambda row: error(net, row, m))(rows)))(nets, members)
        return jnp.sum(each), jnp.asarray(len(rows), jnp.float32)

    curves = fit(policy.nets, loss, config.loop, mesh=mesh, progress=progress)
    policy = NaturalElbow(curves.params, arm)
    return HumanTrained(policy, curves, evaluate_human(policy, frames, known))


def evaluate_human(policy: NaturalElbow, frames: HumanFrames, known: int) -> dict[str, HumanScore]:
    """Elbow errors of a policy and of simpler rules on the frames from ``known`` on.

    Args:
        policy: Trained on the first ``known`` frames.
        frames: The recording.
        known: What the simpler rules may learn from, too.

    Returns:
        Scores by name.
    """
    pose = _pose(frames)
    center, cos, sin = (np.asarray(x) for x in elbow_circle(policy.arm, pose))
    own = np.arctan2(np.sum((frames.elbow - center) * sin, axis=1), np.sum((frames.elbow - center) * cos, axis=1))
    learned = np.asarray(policy.swivel(jnp.asarray(pose.position), jnp.asarray(pose.rotation)))
    grid = np.linspace(-np.pi, np.pi, 360, endpoint=False)

    def errors(swivel: np.ndarray, rows: slice) -> np.ndarray:
        elbow = center[rows] + np.cos(swivel)[:, None] * cos[rows] + np.sin(swivel)[:, None] * sin[rows]
        return np.linalg.norm(elbow - frames.elbow[rows], axis=1)

    before, after = slice(0, known), slice(known, frames.count)
    constant = grid[np.argmin([np.median(errors(np.full(known, s), before)) for s in grid])]
    down = np.arctan2(-sin[:, 2], -cos[:, 2])  # the lowest point of the circle
    features = np.concatenate([frames.hand, frames.rotation.reshape(-1, 9)], axis=1)
    nearest = _nearest(features[after], features[before], own[before])
    swivels = {
        "policy": learned[after],
        "nearest neighbors": nearest,
        "constant swivel": np.full(frames.count - known, constant),
        "elbow down": down[after],
        "floor": own[after],
    }
    return {name: _score(errors(swivel, after)) for name, swivel in swivels.items()}


def _distance(pull: Array, line: Array, center: Array, radius: Array, elbow: Array) -> Array:
    """From the elbow where a network pulls it to the recorded one; a norm, not its square, as trackers slip."""
    miss = center + radius * across(pull, line) - elbow
    return jnp.sqrt(jnp.sum(miss**2) + _ROUND**2)


def _nearest(features: np.ndarray, known: np.ndarray, swivel: np.ndarray, count: int = 8) -> np.ndarray:
    """Mean direction of the nearest known frames' swivels."""
    apart = np.sum(features**2, 1)[:, None] + np.sum(known**2, 1) - 2 * features @ known.T
    rows = np.argpartition(apart, count, axis=1)[:, :count]
    return np.arctan2(np.sin(swivel[rows]).mean(1), np.cos(swivel[rows]).mean(1))


def _pose(frames: HumanFrames) -> Pose:
    return Pose(jnp.asarray(frames.hand), jnp.asarray(frames.rotation))


def _score(errors: np.ndarray) -> HumanScore:
    return HumanScore(100 * float(np.median(errors)), 100 * float(np.percentile(errors, 90)))
