"""Checkpoints of a training run (orbax)."""

import os
from pathlib import Path
from typing import Any, TypeVar

import jax
import numpy as np

from jaxik.errors import MissingExtraError

try:
    import orbax.checkpoint as ocp
except ImportError as error:
    raise MissingExtraError('checkpoints need orbax: pip install "jaxik[learn]"') from error

Tree = TypeVar("Tree")
KEPT = 2  # the newest and one more, in case the newest is damaged


def open_checkpoints(folder: str | os.PathLike[str]) -> ocp.CheckpointManager:
    """Open the checkpoints in a folder, which is created if it does not exist."""
    options = ocp.CheckpointManagerOptions(max_to_keep=KEPT, create=True, enable_async_checkpointing=False)
    return ocp.CheckpointManager(Path(folder).absolute(), options=options)


def save(manager: ocp.CheckpointManager, step: int, state: Any) -> None:
    """Write a state; it becomes visible under its step once it is complete."""
    manager.save(step, args=ocp.args.StandardSave(_leaves(state)))


def restore(manager: ocp.CheckpointManager, like: Tree) -> Tree:
    """Return the newest state, bit for bit, or ``like`` itself if there is none.

    Raises:
        ValueError: The checkpoint does not have the shapes of ``like``.
    """
    step = manager.latest_step()
    if step is None:
        return like
    expected = _leaves(like)
    wrong = f"the checkpoint of step {step} in {manager.directory} belongs to another training run"
    advice = "other sizes, arm or precision; use another folder or delete this one"
    try:
        found = manager.restore(step, args=ocp.args.StandardRestore(expected))
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{wrong} ({advice}): {str(error).splitlines()[0][:200]}") from None
    for name, leaf in expected.items():
        if np.shape(found[name]) != leaf.shape or found[name].dtype != leaf.dtype:
            got = f"{found[name].dtype}{np.shape(found[name])}"
            raise ValueError(f"{wrong} ({advice}): got {got}, expected {leaf.dtype}{leaf.shape}")
    return jax.tree.unflatten(jax.tree.structure(like), [found[name] for name in sorted(found)])


def _leaves(tree: Any) -> dict[str, np.ndarray]:
    """Leaves by their number, so that the stored names do not depend on class names."""
    return {f"{i:04d}": np.asarray(leaf) for i, leaf in enumerate(jax.tree.leaves(tree))}
