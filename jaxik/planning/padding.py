"""Arrays of a few sizes, so that paths of all lengths share a few compiled programs.

A path of K waypoints fills up its arrays with repetitions of its last waypoint (see :func:`jaxik.energy.counted`).
Self-motion and feasible arcs, the largest of the programs, are computed in parts of a single size.
"""

from dataclasses import replace
from itertools import count
from typing import Any, TypeVar

import jax
import numpy as np

from jaxik import energy as energies
from jaxik.arm import Arm
from jaxik.energy import Energy
from jaxik.numerics import compiled_sooner
from jaxik.obstacles import moves
from jaxik.paths import Path
from jaxik.planning.problem import AnyArcs, AnyMotion, PlanningProblem, motion_and_arcs
from jaxik.planning.ranges import apart
from jaxik.redundancy import has_swivel
from jaxik.targets import Target

T = TypeVar("T")

_SMALLEST, _DOUBLING = 32, 128  # sizes double up to the second, and from there on in two steps: little is wasted
_PART = 256  # targets per call: a call of few takes a millisecond, and many stay in cache
_FEW = 64  # the same of arms whose feasible intervals take milliseconds a target


def padded_size(length: int) -> int:
    """Return the size of arrays for a number of waypoints: 32, 64, 128, 192, 256, 384, 512, 768, ..."""
    sizes = (size for k in count() for size in _octave(_SMALLEST << k))
    return next(size for size in sizes if size >= length)


def _octave(size: int) -> tuple[int, ...]:
    return (size,) if size < _DOUBLING else (size, size + size // 2)


def padded(tree: T, size: int) -> T:
    """Return arrays ``(K, ...)`` as ``(size, ...)`` host arrays with the last row repeated."""
    return jax.tree.map(lambda x: (x := np.asarray(x))[np.minimum(np.arange(size), len(x) - 1)], tree)


def motion_and_arcs_in_parts(arm: Arm, target: Target, size: int | None = None) -> tuple[AnyMotion, AnyArcs]:
    """Return the self-motion of any number of targets ``(K,)`` and its feasible arcs, as host arrays.

    Args:
        arm: The arm.
        target: The targets, in the arm's dtype.
        size: Rows of the result, the last one repeated; None for K.
    """
    length = len(target.position)
    motions, arcs = zip(*motion_and_arcs_by_part(arm, target), strict=True)
    keep = np.minimum(np.arange(length if size is None else size), length - 1)
    names = {"arm", "shoulder_delta", "wrist_delta"}.intersection(motions[0]._fields)
    alone = dict.fromkeys(names)
    joined = jax.tree.map(
        lambda *x: np.concatenate([np.asarray(part) for part in x], axis=-1)[..., keep],
        *(motion._replace(**alone) for motion in motions),
    )
    motion = joined._replace(**{name: getattr(motions[0], name) for name in alone})
    return motion, jax.tree.map(lambda *x: np.concatenate([np.asarray(part) for part in x])[keep], *arcs)


def motion_and_arcs_by_part(arm: Arm, target: Target) -> list[tuple[AnyMotion, AnyArcs]]:
    """Return the same in parts of one size, the last one filled up with repetitions."""
    host = jax.tree.map(np.asarray, target)
    length, part, parts = len(host.position), _part(arm), []
    for first in range(0, length, part):
        rows = np.minimum(np.arange(first, first + part), length - 1)
        parts.append(_motion_and_arcs(_in_worlds(arm, rows), jax.tree.map(lambda x, r=rows: x[r], host)))
    return parts


def _part(arm: Arm) -> int:
    """Number of targets per call."""
    return _PART if has_swivel(arm) else _FEW


def _in_worlds(arm: Arm, rows: np.ndarray) -> Arm:
    """The arm in the worlds of some waypoints, where each has its own."""
    return replace(arm, surroundings=arm.surroundings.rows(rows)) if moves(arm) else arm


_motion_and_arcs = compiled_sooner(motion_and_arcs)


def padded_problem(arm: Arm, path: Path, size: int, energy: Energy | None = None) -> PlanningProblem:
    """Return the problem of a path without conditions on its ends, in host arrays of a size."""
    motion, arcs = motion_and_arcs_in_parts(_apart(arm), path.target, size)
    energy = energies.joint_motion() if energy is None else energy
    return PlanningProblem(motion, arcs, padded(path.time, size), energy)


_apart = compiled_sooner(apart)


def problem_shapes(arm: Arm, path: Path, size: int, energy: Energy) -> PlanningProblem:
    """Return what :func:`padded_problem` returns with the shapes of motion, arcs and times in the place of arrays."""
    part = np.arange(_part(arm)) % len(path)
    motion, arcs = _motion_and_arcs.shapes(_apart(arm), jax.tree.map(lambda x: x[part], path.target))
    motion = motion.map_rows(lambda x: jax.ShapeDtypeStruct((*x.shape[:-1], size), x.dtype))
    arcs = jax.tree.map(lambda x: jax.ShapeDtypeStruct((size, *x.shape[1:]), x.dtype), arcs)
    time: Any = jax.ShapeDtypeStruct((size,), path.time.dtype)
    return PlanningProblem(motion, arcs, time, energy)
