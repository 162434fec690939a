"""The training loop: one program for one or many devices and processes, resumable bit for bit.

The examples of a step depend only on the seed and the number of the step (:mod:`training.examples`), so a resumed run
continues exactly as an uninterrupted one.
"""

import json
import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Generic, TypeVar, cast

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax import Array
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from jaxik.atomic_file import write_atomically
from training.examples import AXIS, Examples

Params = TypeVar("Params")
Loss = Callable[[Any, Any], tuple[Array, Array]]

_HELD_OUT = -(1 << 31)  # rows with negative numbers are never trained on


@dataclass(frozen=True)
class LoopConfig:
    """Configuration of a training run.

    Attributes:
        steps: Maximum number of steps.
        batch: Rows per step.
        learning_rate: Peak learning rate, reached after a tenth of the steps, with cosine decay to a hundredth of it.
        weight_decay: Weight decay of AdamW.
        validate_every: Steps between validations; each also writes a checkpoint and a line of metrics.
        patience: Number of validations without improvement before early stopping.
        checkpoints: Folder for checkpoints, from which an interrupted run continues; None for none.
        metrics: File with one JSON object per line (step, loss, validation); None for none.
    """

    steps: int = 400
    batch: int = 256
    learning_rate: float = 3e-3
    weight_decay: float = 1e-4
    validate_every: int = 50
    patience: int = 6
    checkpoints: str | os.PathLike[str] | None = None
    metrics: str | os.PathLike[str] | None = None

    def stored(self, folder: str | os.PathLike[str] | None, name: str) -> "LoopConfig":
        """Return the configuration with checkpoints and metrics in a folder.

        Args:
            folder: Folder of the run; None to leave the configuration unchanged.
            name: Name of the checkpoints and the metrics in the folder.
        """
        if folder is None:
            return self
        return replace(self, checkpoints=Path(folder) / name, metrics=Path(folder) / f"{name}.jsonl")


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class LoopState(Generic[Params]):
    """State of a training run, as stored in a checkpoint.

    Attributes:
        params: Current parameters.
        optimizer: State of the optimizer.
        step: Number of steps done, ``()``.
        best: Parameters with the lowest validation loss.
        best_loss: Lowest validation loss, ``()``.
        stale: Number of validations since then, ``()``.
    """

    params: Params
    optimizer: optax.OptState
    step: Array
    best: Params
    best_loss: Array
    stale: Array


@dataclass(frozen=True)
class Fitted(Generic[Params]):
    """Result of a training run.

    Attributes:
        params: Parameters with the lowest validation loss.
        losses: Training loss of every step of this run, ``(steps,)``.
        validation: Step and loss of every validation of this run.
        step: Total number of steps, including those of interrupted runs.
        stopped_early: True if the validation loss stopped improving.
    """

    params: Params
    losses: np.ndarray
    validation: tuple[tuple[int, float], ...]
    step: int
    stopped_early: bool


def fit(
    params: Params,
    loss: Loss,
    config: LoopConfig,
    *,
    examples: Examples | None = None,
    validation: Loss | None = None,
    validation_rows: int = 256,
    mesh: Mesh | None = None,
    progress: Callable[[float], None] = lambda fraction: None,
) -> Fitted[Params]:
    """Train parameters.

    Args:
        params: Initial parameters, a pytree of arrays.
        loss: Function of the parameters and a group of rows (row numbers ``(n,)``, or the examples made from them) that
            returns the sum of the rows' losses and the sum of their weights.
        config: Configuration of the run.
        examples: Generator of the examples; None to pass row numbers to the loss.
        validation: Loss on held-out rows; None for ``loss`` itself. The rows are never trained on.
        validation_rows: Number of held-out rows.
        mesh: Devices that share the batch, see :func:`training.data_mesh`; None for those of the examples.
        progress: Called with the completed fraction after every step.

    Returns:
        The parameters with the lowest validation loss, and the loss curves.

    Raises:
        ValueError: The batch or the validation rows do not divide among the devices, two meshes are given, there are
            more rows than numbers, or a checkpoint in the folder has other parameters.
        FloatingPointError: The loss is not finite.
    """
    if examples is not None and mesh not in (None, examples.mesh):
        raise ValueError(f"expected one mesh, got examples on {examples.mesh} and mesh={mesh}; omit mesh")
    examples = Examples(lambda rows: rows, mesh) if examples is None else examples
    mesh = examples.mesh
    if config.steps * config.batch > 1 << 31:
        raise ValueError(f"expected at most {1 << 31} rows in total, got {config.steps} steps of {config.batch} rows")
    for name, rows in (("batch", config.batch), ("validation_rows", validation_rows)):
        if rows % mesh.size:
            raise ValueError(f"expected {name} to be a multiple of the {mesh.size} devices, got {rows} rows")
    optimizer = make_optimizer(config)
    everywhere = NamedSharding(mesh, PartitionSpec())
    place = lambda tree: jax.tree.map(lambda x: _replicated(x, everywhere), tree)  # noqa: E731
    state = LoopState(
        params,
        optimizer.init(cast(Any, params)),
        jnp.zeros((), int),
        params,
        jnp.asarray(jnp.inf, float),
        jnp.zeros((), int),
    )
    store = _Store(config)
    state = place(store.latest(state))
    step, validate = _programs(loss, validation or loss, optimizer, mesh)
    # Use blocks of the batch size if they fit: their program is compiled anyway.
    block = config.batch if validation_rows % config.batch == 0 else validation_rows
    held_out = [examples(_HELD_OUT + first, block) for first in range(0, validation_rows, block)]
    losses: list[Array] = []
    validations: list[tuple[int, float]] = []
    count = int(state.step)
    stopped = int(state.stale) >= config.patience
    while count < config.steps and not stopped:
        state, value = step(state, examples(count * config.batch, config.batch))
        losses.append(value)
        count += 1
        progress(count / config.steps)
        if count % config.validate_every == 0 or count == config.steps:
            state, held = validate(state, held_out)
            now, recent = float(state.best_loss), float(losses[-1])
            if not np.isfinite(recent):
                raise FloatingPointError(f"the loss is {recent} at step {count}; use a smaller learning rate")
            validations.append((count, held))
            stopped = int(state.stale) >= config.patience
            store.save(count, state, {"step": count, "loss": recent, "validation": held, "best": now})
    store.close()
    best = jax.device_get(state.best)
    return Fitted(
        jax.tree.map(jnp.asarray, best), np.array([float(x) for x in losses]), tuple(validations), count, stopped
    )


def make_optimizer(config: LoopConfig) -> optax.GradientTransformation:
    """Return AdamW with gradient clipping, linear warm-up and cosine decay."""
    rate = optax.warmup_cosine_decay_schedule(
        0.0, config.learning_rate, max(1, config.steps // 10), max(2, config.steps), config.learning_rate / 100
    )
    return optax.chain(optax.clip_by_global_norm(1.0), optax.adamw(rate, weight_decay=config.weight_decay))


def _programs(
    loss: Loss, validation: Loss, optimizer: optax.GradientTransformation, mesh: Mesh
) -> tuple[Callable[..., tuple[LoopState, Array]], Callable[..., tuple[LoopState, float]]]:
    """Training step and validation; every device adds up the sums of all groups in the same order."""
    shared, divided = PartitionSpec(), PartitionSpec(AXIS)

    def summed(one: Callable[[Any], Any], groups: Any) -> Any:
        """Sum over the groups of all devices."""
        everyone = jax.lax.all_gather(jax.lax.map(one, groups), AXIS, tiled=True)
        return jax.tree.map(lambda x: jnp.sum(x, axis=0), everyone)

    @partial(jax.shard_map, mesh=mesh, in_specs=(shared, divided), out_specs=(shared, shared), check_vma=False)
    def gradient(params: Any, groups: Any) -> tuple[Array, Any]:
        (total, weight), slope = summed(lambda g: jax.value_and_grad(loss, has_aux=True)(params, g), groups)
        scale = 1.0 / jnp.maximum(weight, 1.0)
        return total * scale, jax.tree.map(lambda g: g * scale.astype(g.dtype), slope)

    @jax.jit
    @partial(jax.shard_map, mesh=mesh, in_specs=(shared, divided), out_specs=(shared, shared), check_vma=False)
    def measured(params: Any, groups: Any) -> tuple[Array, Array]:
        return summed(lambda g: validation(params, g), groups)

    @jax.jit
    def step(state: LoopState, groups: Any) -> tuple[LoopState, Array]:
        value, slope = gradient(state.params, groups)
        with jax.numpy_dtype_promotion("standard"):  # optax mixes its integer step count with floats
            updates, optimizer_state = optimizer.update(slope, state.optimizer, state.params)
        params: Any = optax.apply_updates(state.params, updates)
        new = LoopState(params, optimizer_state, state.step + 1, state.best, state.best_loss, state.stale)
        return new, value

    @jax.jit
    def judged(state: LoopState, value: Array) -> LoopState:
        value = value.astype(state.best_loss.dtype)
        better = value < state.best_loss
        best = jax.tree.map(lambda new, old: jnp.where(better, new, old), state.params, state.best)
        stale = jnp.where(better, 0, state.stale + 1)
        return LoopState(state.params, state.optimizer, state.step, best, jnp.minimum(value, state.best_loss), stale)

    def validate(state: LoopState, held_out: list[Any]) -> tuple[LoopState, float]:
        """Evaluate the current parameters and keep the best ones."""
        blocks = [measured(state.params, block) for block in held_out]
        total, weight = (sum(x[1:], start=x[0]) for x in zip(*blocks, strict=True))
        value = total / jnp.maximum(weight, 1.0)
        return judged(state, value), float(value)

    return step, validate


def _replicated(x: Any, sharding: NamedSharding) -> Array:
    value = np.asarray(x)
    return jax.make_array_from_callback(value.shape, sharding, lambda part: value[part])


class _Store:
    """Checkpoints and the metrics file of a run, written by the first process."""

    def __init__(self, config: LoopConfig) -> None:
        self._manager: Any = None
        self._writes = jax.process_index() == 0
        self._metrics = Path(config.metrics) if config.metrics is not None and self._writes else None
        if config.checkpoints is not None:
            from training.checkpoints import open_checkpoints

            self._manager = open_checkpoints(config.checkpoints)

    def latest(self, like: LoopState) -> LoopState:
        """Return the newest checkpoint or the given state, and drop the metrics of later steps."""
        from training.checkpoints import restore

        state = like if self._manager is None else restore(self._manager, like)
        if self._metrics is not None:
            done = int(state.step)
            kept = []
            if done and self._metrics.exists():
                lines = self._metrics.read_text(encoding="utf-8").splitlines()
                kept = [line for line in lines if json.loads(line)["step"] <= done]
            self._metrics.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(self._metrics, "".join(f"{line}\n" for line in kept))
        return state

    def save(self, step: int, state: LoopState, metrics: dict[str, Any]) -> None:
        """Write a checkpoint and a line of metrics."""
        if self._manager is not None:
            from training.checkpoints import save

            save(self._manager, step, state)
        if self._metrics is not None:
            with open(self._metrics, "a", encoding="utf-8") as file:
                file.write(json.dumps(metrics) + "\n")

    def close(self) -> None:
        """Wait for pending writes."""
        if self._manager is not None:
            self._manager.close()
