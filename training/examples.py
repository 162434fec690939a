"""Training examples: rows generated from their numbers and divided among devices.

Each row has a number in an endless list and is generated on the device that uses it, by one program for training and
validation. Memory therefore does not grow with the number of rows seen.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import numpy as np
from jax import Array
from jax.sharding import Mesh, NamedSharding, PartitionSpec

AXIS = "data"
_GROUPS = 16  # of a batch, one after the other


def data_mesh(devices: Sequence[Any] | None = None) -> Mesh:
    """Return a device mesh with one axis that divides the rows of a batch.

    Args:
        devices: The devices; None for all devices of all processes.

    Returns:
        The mesh.
    """
    return Mesh(np.array(jax.devices() if devices is None else devices), (AXIS,))


class Examples:
    """Generates examples from row numbers.

    Rows are processed in groups, one after the other, and the number of groups depends only on the batch. Rounding is
    therefore independent of the number of devices; otherwise Adam, which divides small gradients by their own
    magnitude, would diverge between device counts within a few steps.

    Args:
        make: Function of row numbers ``(n,)`` that returns a pytree of arrays; it must not depend on the trained
            parameters.
        mesh: Devices that share the rows, see :func:`data_mesh`; None for the first device of this process.
    """

    def __init__(self, make: Callable[[Array], Any], mesh: Mesh | None = None) -> None:
        self.mesh = data_mesh(jax.local_devices()[:1]) if mesh is None else mesh
        divided = PartitionSpec(AXIS)

        @jax.jit
        @partial(jax.shard_map, mesh=self.mesh, in_specs=divided, out_specs=divided, check_vma=False)
        def made(groups: Array) -> Any:
            return jax.lax.map(make, groups)

        self._made = made

    def __call__(self, first: int, count: int) -> Any:
        """Return the examples of consecutive rows, with groups along the first axis.

        Args:
            first: Number of the first row.
            count: Number of rows, a multiple of the number of devices.
        """
        devices = self.mesh.size
        groups = next(n for n in (_GROUPS, devices) if count % n == 0 and n % devices == 0)
        numbers = np.arange(first, first + count, dtype=np.int32).reshape(groups, -1)
        sharding = NamedSharding(self.mesh, PartitionSpec(AXIS))
        return self._made(jax.make_array_from_callback(numbers.shape, sharding, lambda part: numbers[part]))
