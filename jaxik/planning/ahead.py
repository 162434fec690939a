"""Compilation of a plan's programs side by side: which ones they are is known before the first of them has run."""

from collections.abc import Hashable

import jax
import jax.numpy as jnp
import numpy as np

from jaxik.arm import Arm
from jaxik.energy import Energy
from jaxik.numerics import on_one_cpu
from jaxik.paths import Path
from jaxik.planning.motion import compile_search
from jaxik.planning.padding import padded_size, problem_shapes
from jaxik.planning.search_size import searched_size, searched_waypoints
from jaxik.redundancy import has_swivel

_begun: set[Hashable] = set()


def compile_ahead(arm: Arm, path: Path, energy: Energy, size: int) -> None:
    """Begin to compile search and refinement of a path whose ends are free, while its feasible arcs are computed.

    Args:
        arm: The arm.
        path: The path, as host arrays of the arm's dtype.
        energy: Energy to minimize.
        size: Rows of the problem's arrays.
    """
    if not on_one_cpu(arm, path, energy):
        return
    searched = searched_size(searched_waypoints(arm, path.target))
    leaves, structure = jax.tree.flatten((arm, energy))
    key = structure, tuple((np.shape(x), jnp.result_type(x)) for x in leaves), type(path.target), size, searched
    if key not in _begun:
        _begun.add(key)
        compile_search(problem_shapes(arm, path, size, energy), problem_shapes(arm, path, searched, energy))


def compile_before_placing(arm: Arm, path: Path, energy: Energy) -> None:
    """Begin to compile the same for a path that is yet to be placed, which is taken to keep its size.

    For S-R-S arms, which are placed in less time than a wrong guess of the size would cost, this does nothing.

    Args:
        arm: The arm.
        path: The path.
        energy: Energy to minimize.
    """
    if energy.paddable and not has_swivel(arm):
        path = jax.tree.map(np.asarray, path.checked().astype(arm.axes.dtype))
        compile_ahead(arm, path, energy, padded_size(len(path)))
