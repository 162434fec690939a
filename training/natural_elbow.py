"""Where people put their elbow: the policies' network trained on recorded arms, and what simpler rules would say.

Nothing prices a human posture, so here the network says the swivel itself. It sees one hand pose at a time: that makes
it a function of the posture, which a plan can have as an energy.
"""

import os
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.sharding import Mesh
from jaxtyping import Float

from jaxik import columns as col
from jaxik.arm import Arm, ArmModel
from jaxik.ik import solve_ik
from jaxik.kinematics import joint_positions
from jaxik.model_file import model_content, model_from_content
from jaxik.numerics import tolerances
from jaxik.swivel_reference import StereographicReference
from jaxik.targets import Pose
from training import policy_files
from training.human_data import HumanFrames, human_arm
from training.loop import Fitted, LoopConfig, fit
from training.network import WaypointNet

_KIND = "natural-elbow"
_FEATURES, _LAYERS = 22, (0, 0)
_NOISE = 0.2  # on features of spread one: neighboring frames are nearly equal, and must not be learned by heart
_ROUND = 1e-2  # smooths the length of an error at zero; lengths are about one


class NaturalElbow(eqx.Module):
    """A person's elbow as a function of the hand.

    Attributes:
        nets: Some networks with a leading axis, trained on different samples; they vote.
        arm: The person's arm, shoulder at the origin, x forward, y left, z up; a right one.
    """

    nets: WaypointNet
    arm: Arm

    def direction(
        self, position: Float[Array, "*batch 3"], rotation: Float[Array, "*batch 3 3"]
    ) -> Float[Array, "*batch 3"]:
        """Where the elbow is, seen from the line between shoulder and hand, for hand poses relative to the shoulder.

        Args:
            position: Where forearm and hand meet, in the person's lengths, ``(*batch, 3)``.
            rotation: z where the hand points, x towards the thumb, ``(*batch, 3, 3)``.

        Returns:
            Unit vectors across that line, ``(*batch, 3)``.

        **Differentiability**: smooth, but where the networks' votes cancel.
        """
        x = hand_features(self.arm, position, rotation).astype(jnp.float32)
        line = jnp.moveaxis(_unit(position), -1, 0).astype(jnp.float32)
        pulls = eqx.filter_vmap(lambda net: net(x.reshape(len(x), 1, -1)))(self.nets)
        votes = jax.vmap(_across, in_axes=(0, None))(pulls.reshape(-1, *line.shape), line)
        total = _across(jnp.mean(votes, axis=0), line)
        return jnp.moveaxis(total, 0, -1).astype(position.dtype)

    def swivel(
        self, position: Float[Array, "*batch 3"], rotation: Float[Array, "*batch 3 3"]
    ) -> Float[Array, "*batch"]:
        """The same as swivel of the person's arm, ``(*batch,)`` [rad]."""
        toward = self.direction(position, rotation)
        zero, quarter = _reference(self.arm, _unit(position))
        return jnp.arctan2(jnp.sum(toward * quarter, axis=-1), jnp.sum(toward * zero, axis=-1))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes a file that :func:`load_natural_elbow` reads."""
        model = ArmModel(self.arm, tuple(f"human_{i}" for i in range(1, 8)), "human_arm", "")
        members, width = self.nets.first.shape[:2]
        facts = {"members": int(members), "width": int(width), "arm": model_content(model)}
        policy_files.write(path, _KIND, facts, self.nets)


def load_natural_elbow(path: str | os.PathLike[str]) -> NaturalElbow:
    """Reads what :meth:`NaturalElbow.save` wrote.

    Args:
        path: The file.

    Returns:
        The same elbows, bit for bit.

    Raises:
        FileFormatError: Not such a file.
        OSError: It cannot be read.
    """
    header = policy_files.read_header(path, _KIND)
    nets = _networks(jax.random.key(0), header["members"], header["width"])
    return NaturalElbow(policy_files.read(path, nets), model_from_content(header["arm"]).arm)


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
            steps=600, learning_rate=2e-3, weight_decay=1e-3, validate_every=100, patience=6
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
    nets = _networks(weights, config.members, config.width)
    nets = eqx.filter_vmap(lambda net: net.normalized(seen[:, None]))(nets)
    policy = NaturalElbow(nets, arm)
    center, cos, _ = elbow_circle(arm, Pose(hand, turn))
    radius = jnp.linalg.norm(cos, axis=-1, keepdims=True)
    columns = (_unit(hand), center, radius, jnp.asarray(frames.elbow[:known]))
    data = (seen, *(x.T.astype(jnp.float32) for x in columns))

    def error(nets: WaypointNet, row: Array, member: Array) -> Array:
        """Of one network on one frame that the row's number picks."""
        features, *circle = data
        which, noise = jax.random.split(jax.random.fold_in(jax.random.fold_in(samples, row), member))
        i = jax.random.randint(which, (), 0, known)
        x = features[:, i] + _NOISE * nets.scale[:, 0] * jax.random.normal(noise, (_FEATURES,), jnp.float32)
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


def hand_features(arm: Arm, position: Array, rotation: Array) -> Array:
    """What the network sees of hand poses, ``(22, *batch)``.

    Where the hand is in arm lengths, how far, how it is turned, and how it is turned against the elbow's circle.
    """
    reach = jnp.linalg.norm(arm.elbow - arm.shoulder) + jnp.linalg.norm(arm.wrist - arm.elbow)
    where = position / reach.astype(position.dtype)
    line = _unit(position)
    circle = jnp.stack([line, *_reference(arm, line)], axis=-2)
    turned = [m.reshape(*m.shape[:-2], 9) for m in (rotation, circle @ rotation)]
    far = jnp.linalg.norm(where, axis=-1, keepdims=True)
    return jnp.moveaxis(jnp.concatenate([where, far, *turned], axis=-1), -1, 0)


def elbow_circle(arm: Arm, target: Pose) -> tuple[Array, Array, Array]:
    """Center of the elbow's circle and the vectors to its points at swivel 0 and 90 degrees, ``(*batch, 3)`` each.

    From three solutions of the closed form, which three points of a circle are enough for.

    **Differentiability**: as :func:`jaxik.solve_ik`.
    """
    dtype = target.position.dtype

    def elbow(swivel: float) -> Array:
        at = jnp.full(target.position.shape[:-1], swivel, dtype)
        return joint_positions(arm, solve_ik(arm, target, at).q[..., 0, :])[..., 1, :]

    ahead, side, behind = (elbow(swivel) for swivel in (0.0, np.pi / 2, np.pi))
    center = (ahead + behind) / 2
    return center, (ahead - behind) / 2, side - center


def _networks(key: Array, members: int, width: int) -> WaypointNet:
    keys = jax.random.split(key, members)

    def one(key: Array) -> WaypointNet:
        net = WaypointNet(_FEATURES, 3, width, _LAYERS, key)
        # Without a first guess the direction of a zero output has no slope to learn in.
        return eqx.tree_at(lambda n: n.last, net, jax.random.normal(key, net.last.shape, jnp.float32) / width**0.5)

    return eqx.filter_vmap(one)(keys)


def _distance(pull: Array, line: Array, center: Array, radius: Array, elbow: Array) -> Array:
    """From the elbow where a network pulls it to the recorded one; a norm, not its square, as trackers slip."""
    miss = center + radius * _across(pull, line) - elbow
    return jnp.sqrt(jnp.sum(miss**2) + _ROUND**2)


def _across(pull: Array, line: Array) -> Array:
    """The direction of a pull across a line, ``(3, ...)``: the point of the elbow's circle that gives way most."""
    across = pull - jnp.sum(pull * line, axis=0) * line
    return across / jnp.sqrt(jnp.sum(across**2, axis=0) + 1e-6)


def _reference(arm: Arm, line: Array) -> tuple[Array, Array]:
    """Directions of swivel 0 and 90 degrees across lines ``(*batch, 3)``."""
    n = jnp.moveaxis(line, -1, 0)
    pole, first = (v.astype(n.dtype).reshape(3, *(1,) * (n.ndim - 1)) for v in arm.reference.vectors())
    zero, _ = StereographicReference(pole, first).zero_direction(n, tolerances(n.dtype))
    return jnp.moveaxis(zero, 0, -1), jnp.moveaxis(col.cross(n, zero), 0, -1)


def _unit(v: Array) -> Array:
    return v / jnp.sqrt(jnp.sum(v**2, axis=-1, keepdims=True) + 1e-12)


def _nearest(features: np.ndarray, known: np.ndarray, swivel: np.ndarray, count: int = 8) -> np.ndarray:
    """Mean direction of the nearest known frames' swivels."""
    apart = np.sum(features**2, 1)[:, None] + np.sum(known**2, 1) - 2 * features @ known.T
    rows = np.argpartition(apart, count, axis=1)[:, :count]
    return np.arctan2(np.sin(swivel[rows]).mean(1), np.cos(swivel[rows]).mean(1))


def _pose(frames: HumanFrames) -> Pose:
    return Pose(jnp.asarray(frames.hand), jnp.asarray(frames.rotation))


def _score(errors: np.ndarray) -> HumanScore:
    return HumanScore(100 * float(np.median(errors)), 100 * float(np.percentile(errors, 90)))
