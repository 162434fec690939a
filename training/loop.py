"""The training loop: one program for one device, many devices and many processes, resumable bit for bit.

What a step learns from depends on the seed and the step's number alone (:mod:`training.examples`), so a resumed run
continues as if it had not stopped.
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

_HELD_OUT = -(1 << 31)  # rows below zero are never trained on


@dataclass(frozen=True)
class LoopConfig:
    """How to train.

    Attributes:
        steps: At most so many.
        batch: Rows a step.
        learning_rate: Largest, after a tenth of the steps; it falls to a hundredth on a cosine.
        weight_decay: Of AdamW.
        validate_every: Steps between looks at held-out rows, which also write a checkpoint and a line of metrics.
        patience: Looks without a better one before it stops early.
        checkpoints: Folder for checkpoints; a run that finds one there continues it. None for none.
        metrics: File for one JSON object a line: step, loss, validation. None for none.
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
        """The same with checkpoints and metrics in a folder, under a name; as it is without a folder."""
        if folder is None:
            return self
        return replace(self, checkpoints=Path(folder) / name, metrics=Path(folder) / f"{name}.jsonl")


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class LoopState(Generic[Params]):
    """Everything a run is; what a checkpoint holds.

    Attributes:
        params: As trained so far.
        optimizer: State of the optimizer.
        step: Steps done, ``()``.
        best: The parameters with the least validation loss.
        best_loss: That loss, ``()``.
        waited: Looks since, ``()``.
    """

    params: Params
    optimizer: optax.OptState
    step: Array
    best: Params
    best_loss: Array
    waited: Array


@dataclass(frozen=True)
class Fitted(Generic[Params]):
    """The outcome of a run.

    Attributes:
        params: Those with the least validation loss.
        losses: Training loss of every step of this run, ``(steps,)``.
        validation: (step, loss) of every look of this run.
        step: Steps done in all.
        stopped_early: Whether validation stopped getting better.
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
    progress: Callable[[float], None] = lambda share: None,
) -> Fitted[Params]:
    """Trains parameters.

    Args:
        params: A pytree of arrays.
        loss: Of parameters and row numbers ``(n,)``, or the examples made of them: the rows' sum of losses and the sum
            of their weights.
        config: How.
        examples: What the loss gets in the place of row numbers; None for the numbers.
        validation: The same of held-out rows; None for ``loss`` itself on rows that are never trained on.
        validation_rows: How many rows it looks at.
        mesh: Devices that share the batch, see :func:`training.data_mesh`; None for those of the examples.
        progress: Is told the share done, after every step.

    Returns:
        The parameters with the least validation loss, and the curves.

    Raises:
        ValueError: The batch or the validation rows do not divide among the devices, there are two meshes or more rows
            than numbers, or a checkpoint in the folder holds another kind of parameters.
        FloatingPointError: The loss is no longer a number.
    """
    if examples is not None and mesh not in (None, examples.mesh):
        raise ValueError(f"got examples on {examples.mesh} and mesh={mesh}; leave mesh out")
    examples = Examples(lambda rows: rows, mesh) if examples is None else examples
    mesh = examples.mesh
    if config.steps * config.batch > 1 << 31:
        raise ValueError(f"{config.steps} steps of {config.batch} rows are more than the {1 << 31} there are")
    for name, rows in (("batch", config.batch), ("validation_rows", validation_rows)):
        if rows % mesh.size:
            raise ValueError(f"{name} of {rows} rows does not divide among {mesh.size} devices; make it a multiple")
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
    step, look = _programs(loss, validation or loss, optimizer, mesh)
    # In blocks of a batch, where that comes out even: the program that makes those exists anyway.
    block = config.batch if validation_rows % config.batch == 0 else validation_rows
    held_out = [examples(_HELD_OUT + first, block) for first in range(0, validation_rows, block)]
    losses: list[Array] = []
    looks: list[tuple[int, float]] = []
    count = int(state.step)
    stopped = int(state.waited) >= config.patience
    while count < config.steps and not stopped:
        state, value = step(state, examples(count * config.batch, config.batch))
        losses.append(value)
        count += 1
        progress(count / config.steps)
        if count % config.validate_every == 0 or count == config.steps:
            state, held = look(state, held_out)
            now, recent = float(state.best_loss), float(losses[-1])
            if not np.isfinite(recent):
                raise FloatingPointError(f"the loss became {recent} at step {count}; try a smaller learning rate")
            looks.append((count, held))
            stopped = int(state.waited) >= config.patience
            store.save(count, state, {"step": count, "loss": recent, "validation": looks[-1][1], "best": now})
    store.close()
    best = jax.device_get(state.best)
    return Fitted(jax.tree.map(jnp.asarray, best), np.array([float(x) for x in losses]), tuple(looks), count, stopped)


def make_optimizer(config: LoopConfig) -> optax.GradientTransformation:
    """AdamW behind a bound on the gradient's size, with a warm-up and a cosine."""
    rate = optax.warmup_cosine_decay_schedule(
        0.0, config.learning_rate, max(1, config.steps // 10), max(2, config.steps), config.learning_rate / 100
    )
    return optax.chain(optax.clip_by_global_norm(1.0), optax.adamw(rate, weight_decay=config.weight_decay))


def _programs(
    loss: Loss, validation: Loss, optimizer: optax.GradientTransformation, mesh: Mesh
) -> tuple[Callable[..., tuple[LoopState, Array]], Callable[..., tuple[LoopState, float]]]:
    """One step and one look: each device has groups of its own, whose sums every device adds up in their order."""
    shared, divided = PartitionSpec(), PartitionSpec(AXIS)

    def summed(one: Callable[[Any], Any], groups: Any) -> Any:
        """Sum over the groups of all devices."""
        everyone = jax.lax.all_gather(jax.lax.map(one, groups), AXIS, tiled=True)
        return jax.tree.map(lambda x: jnp.sum(x, axis=0), everyone)

    @partial(jax.shard_map, mesh=mesh, in_specs=(shared, divided), out_specs=(shared, shared), check_vma=False)
    def gradient(params: Any, groups: Any) -> tuple[Array, Any]:
        (total, weight), slope = summed(lambda g: jax.value_and_grad(loss, has_aux=True)(params, g), groups)
        share = 1.0 / jnp.maximum(weight, 1.0)
        return total * share, jax.tree.map(lambda g: g * share.astype(g.dtype), slope)

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
        new = LoopState(params, optimizer_state, state.step + 1, state.best, state.best_loss, state.waited)
        return new, value

    @jax.jit
    def judged(state: LoopState, value: Array) -> LoopState:
        value = value.astype(state.best_loss.dtype)
        better = value < state.best_loss
        best = jax.tree.map(lambda new, old: jnp.where(better, new, old), state.params, state.best)
        waited = jnp.where(better, 0, state.waited + 1)
        return LoopState(state.params, state.optimizer, state.step, best, jnp.minimum(value, state.best_loss), waited)

    def look(state: LoopState, held_out: list[Any]) -> tuple[LoopState, float]:
        """Keeps the best parameters, and says what the present ones lose."""
        blocks = [measured(state.params, block) for block in held_out]
        total, weight = (sum(x[1:], start=x[0]) for x in zip(*blocks, strict=True))
        value = total / jnp.maximum(weight, 1.0)
        return judged(state, value), float(value)

    return step, look


def _replicated(x: Any, sharding: NamedSharding) -> Array:
    value = np.asarray(x)
    return jax.make_array_from_callback(value.shape, sharding, lambda part: value[part])


class _Store:
    """Checkpoints and the metrics file of a run; the first process writes."""

    def __init__(self, config: LoopConfig) -> None:
        self._manager: Any = None
        self._writes = jax.process_index() == 0
        self._metrics = Path(config.metrics) if config.metrics is not None and self._writes else None
        if config.checkpoints is not None:
            from training.checkpoints import open_checkpoints

            self._manager = open_checkpoints(config.checkpoints)

    def latest(self, like: LoopState) -> LoopState:
        """The newest checkpoint, or the state given; metrics of later steps are forgotten."""
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
        """One look: a checkpoint and a line of metrics."""
        if self._manager is not None:
            from training.checkpoints import save

            save(self._manager, step, state)
        if self._metrics is not None:
            with open(self._metrics, "a", encoding="utf-8") as file:
                file.write(json.dumps(metrics) + "\n")

    def close(self) -> None:
        """Waits for what is being written."""
        if self._manager is not None:
            self._manager.close()
