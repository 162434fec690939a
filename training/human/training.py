"""Training of a natural elbow on a recording of a person's arm, and its comparison with simpler rules."""

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
from training.waypoint_net import WaypointNet

_NOISE = 0.2  # on normalized features, against overfitting: neighboring frames are nearly equal
_ROUND = 1e-2  # smooths the norm of an error at zero; arm lengths are about one


@dataclass(frozen=True)
class HumanConfig:
    """Configuration of the training of a natural elbow.

    Attributes:
        seed: Seed of the initial weights and the samples.
        members: Number of networks in the ensemble.
        width: Width of their two layers.
        held_out: Fraction of the frames, at the end of the recording, that is held out for evaluation.
        loop: Configuration of the training loop.
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
        """Return the configuration with checkpoints and metrics in a folder.

        Args:
            folder: Folder of the run; None to leave the configuration unchanged.
        """
        return self if folder is None else replace(self, loop=self.loop.stored(folder, "human"))


@dataclass(frozen=True)
class HumanScore:
    """Elbow errors on held-out frames, in percent of the recording's unit of length, about one straight arm.

    Attributes:
        median: Median error [%].
        p90: 90th percentile of the error [%].
    """

    median: float
    p90: float


@dataclass(frozen=True)
class HumanTrained:
    """A trained natural elbow with its evaluation.

    Attributes:
        policy: The natural elbow.
        curves: Result of the training loop.
        scores: Errors by name, of the policy and of simpler rules; ``floor`` is the error of the recorded swivel on an
            arm of the fitted lengths.
    """

    policy: NaturalElbow
    curves: Fitted[WaypointNet]
    scores: dict[str, HumanScore]


def train_human(
    frames: HumanFrames,
    config: HumanConfig | None = None,
    *,
    mesh: Mesh | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
) -> HumanTrained:
    """Train a natural elbow on the beginning of a recording and evaluate it on the rest.

    The frames are split by time, not at random, because neighboring frames are nearly equal.

    Args:
        frames: The recording.
        config: Configuration; None for the defaults.
        mesh: Devices that share the batch, see :func:`training.data_mesh`; None for one.
        progress: Called with the completed fraction.

    Returns:
        The natural elbow, its loss curves and scores.

    Raises:
        ValueError: There are too few frames to train or to evaluate on.
    """
    config = HumanConfig() if config is None else config
    known = round(frames.count * (1 - config.held_out))
    if not 10 <= known < frames.count:
        raise ValueError(
            f"expected 10 frames to train on and 1 to evaluate on, got {known} of {frames.count}; change held_out"
        )
    arm = human_arm(frames[:known]).arm
    weights, samples = jax.random.split(jax.random.key(config.seed))
    hand, turn = jnp.asarray(frames.hand[:known]), jnp.asarray(frames.rotation[:known])
    features = hand_features(arm, hand, turn).astype(jnp.float32)
    nets = make_networks(weights, config.members, config.width)
    nets = eqx.filter_vmap(lambda net: net.normalized(features[:, None]))(nets)
    policy = NaturalElbow(nets, arm)
    center, cos, _ = elbow_circle(arm, Pose(hand, turn))
    radius = jnp.linalg.norm(cos, axis=-1, keepdims=True)
    columns = (unit(hand), center, radius, jnp.asarray(frames.elbow[:known]))
    data = (features, *(x.T.astype(jnp.float32) for x in columns))

    def error(nets: WaypointNet, row: Array, member: Array) -> Array:
        """Error of one network on one frame, selected by the row's number."""
        inputs, *circle = data
        which, noise = jax.random.split(jax.random.fold_in(jax.random.fold_in(samples, row), member))
        i = jax.random.randint(which, (), 0, known)
        x = inputs[:, i] + _NOISE * nets.scale[:, 0] * jax.random.normal(noise, (FEATURES,), jnp.float32)
        return _distance(nets(x[:, None, None])[:, 0, 0], *(part[:, i] for part in circle))

    def loss(nets: WaypointNet, rows: Array) -> tuple[Array, Array]:
        members = jnp.arange(config.members)
        each = jax.vmap(lambda net, m: jnp.sum(jax.vmap(lambda row: error(net, row, m))(rows)))(nets, members)
        return jnp.sum(each), jnp.asarray(len(rows), jnp.float32)

    curves = fit(policy.nets, loss, config.loop, mesh=mesh, progress=progress)
    policy = NaturalElbow(curves.params, arm)
    return HumanTrained(policy, curves, evaluate_human(policy, frames, known))


def evaluate_human(policy: NaturalElbow, frames: HumanFrames, known: int) -> dict[str, HumanScore]:
    """Return the elbow errors of a policy and of simpler rules on the frames from ``known`` on.

    Args:
        policy: Natural elbow trained on the first ``known`` frames.
        frames: The recording.
        known: Number of frames that the simpler rules may learn from.

    Returns:
        Errors by name.
    """
    pose = _pose(frames)
    center, cos, sin = (np.asarray(x) for x in elbow_circle(policy.arm, pose))
    own = np.arctan2(np.sum((frames.elbow - center) * sin, axis=1), np.sum((frames.elbow - center) * cos, axis=1))
    learned = np.asarray(policy.swivel(policy.arm, pose))
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
    """Distance from the predicted to the recorded elbow; not squared, to be robust against slipped trackers."""
    error = center + radius * across(pull, line) - elbow
    return jnp.sqrt(jnp.sum(error**2) + _ROUND**2)


def _nearest(features: np.ndarray, known: np.ndarray, swivel: np.ndarray, count: int = 8) -> np.ndarray:
    """Circular mean of the swivels of the nearest known frames."""
    distance = np.sum(features**2, 1)[:, None] + np.sum(known**2, 1) - 2 * features @ known.T
    rows = np.argpartition(distance, count, axis=1)[:, :count]
    return np.arctan2(np.sin(swivel[rows]).mean(1), np.cos(swivel[rows]).mean(1))


def _pose(frames: HumanFrames) -> Pose:
    return Pose(jnp.asarray(frames.hand), jnp.asarray(frames.rotation))


def _score(errors: np.ndarray) -> HumanScore:
    return HumanScore(100 * float(np.median(errors)), 100 * float(np.percentile(errors, 90)))
